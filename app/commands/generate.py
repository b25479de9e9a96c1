"""``gesta generate``: a movement of a learned action between two points, as table, JSON or bag."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from app.client import GestaClient, Message
from app.client.answers import Generated
from app.commands.asking import URL, Model, Url, Version, asking, number_of
from app.commands.terminal import AsJson, failure, show_json, show_table, tell

FORMS = {".csv": "text/csv", ".json": "application/json", ".mcap": "application/vnd.mcap"}
"""How a file's form is asked for, by the end of its name."""
N_ROWS = 11
"""Of the table that is shown where no file is written."""
VIA_STD_M = 0.01


def point(text: str) -> list[float]:
    """Return x, y, z [m]."""
    return _numbers(text, 3, "needs x,y,z in metres")


def via(text: str) -> Message:
    """Return a point to pass: x, y, z [m], the fraction of the duration, how near [m]."""
    needed = "needs x,y,z,fraction or x,y,z,fraction,std"
    numbers = _numbers(text, 5 if text.count(",") > 3 else 4, needed)
    return {"position": numbers[:3], "fraction": numbers[3], "std_m": (numbers[4:] or [VIA_STD_M])[0]}


def _numbers(text: str, count: int, needed: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise typer.BadParameter(needed) from error
    if len(numbers) != count:
        raise typer.BadParameter(needed)
    return numbers


def _form(path: Path | None) -> Path | None:
    if path is not None and path.suffix.lower() not in FORMS:
        raise typer.BadParameter(f"needs a name that ends with {', '.join(FORMS)}")
    return path


Point = Annotated[Any, typer.Option(parser=point, metavar="X,Y,Z", help="[m]")]


def generate(
    model: Model,
    action: Annotated[str, typer.Argument(help="A learned action.")],
    start: Point,
    goal: Point,
    version: Version = None,
    rate: Annotated[float, typer.Option(help="Frames per second.")] = 100.0,
    duration: Annotated[float | None, typer.Option(help="[s]; default: as demonstrated.")] = None,
    velocity: Annotated[float | None, typer.Option(help="Limit [m/s].")] = None,
    acceleration: Annotated[float | None, typer.Option(help="Limit [m/s^2].")] = None,
    via: Annotated[
        list[Any] | None,
        typer.Option(
            parser=via,
            metavar="X,Y,Z,F[,STD]",
            help="Pass a point [m] at a fraction of the duration; repeat.",
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option(callback=_form, help="File to write: .csv, .json or .mcap.")
    ] = None,
    as_json: AsJson = False,
    url: Url = URL,
) -> None:
    """Generate a movement. What stands against it is told; ends with 1 where it is not feasible as asked."""
    limits = {"velocity_m_s": velocity, "acceleration_m_s2": acceleration}
    asked = {"rate_hz": rate, "duration_s": duration, "via": via or [], "limits": limits}
    with asking(url) as client:
        number = number_of(client, model, version)
        motion = client.generate(model, number, action, start, goal, **asked)
        if output is not None:
            output.write_bytes(_in_form(client, motion, {"start": start, "goal": goal, **asked}, output))
            tell(f"{output}: {len(motion['t'])} frames, {motion['t'][-1]:.2f} s, version {number} of {model}")
    if as_json:
        show_json(motion)
    elif output is None:
        _show(motion)
    _tell_feasibility(motion)


def _in_form(client: GestaClient, motion: Generated, body: Message, output: Path) -> bytes:
    """Return the movement in the form of a file; it is the same whatever form is asked for."""
    form = FORMS[output.suffix.lower()]
    if form == FORMS[".json"]:
        return json.dumps(motion).encode()
    path = f"/models/{motion['model']}/versions/{motion['version']}/actions/{motion['action']}/trajectories"
    content = client.request("POST", path, body, {"Accept": form})
    return content.encode() if isinstance(content, str) else bytes(content)


def _show(motion: Generated) -> None:
    last = len(motion["t"]) - 1
    rows = []
    for at in sorted({round(last * row / (N_ROWS - 1)) for row in range(N_ROWS)}):
        speed = sum(value**2 for value in motion["velocity"][at]) ** 0.5
        rows.append((motion["t"][at], *motion["position"][at], speed))
    title = f"{motion['action']}, version {motion['version']} of {motion['model']}: {last + 1} frames"
    show_table(("t [s]", "x [m]", "y [m]", "z [m]", "speed [m/s]"), *rows, title=title)


def _tell_feasibility(motion: Generated) -> None:
    """Tell warnings and violations; raise the end of the command where there are any of these."""
    found = motion["feasibility"]
    for warning in found["warnings"]:
        tell(f"{warning['code']}: {warning['detail']}", "yellow")
    if found["feasible"]:
        return
    for each in found["violations"]:
        tell(f"{each['kind']}: {each['value']:.4g} at {each['t']:.2f} s, may be {each['limit']:.4g}", "red")
    raise failure("the movement is not feasible as asked")
