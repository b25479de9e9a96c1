"""``gesta demo``: the whole line in under a minute, on simulated motion, against a server of its own.

It is a client like any other: all it does goes over HTTP and WebSocket, as ``app.client`` does it.
"""

from __future__ import annotations

import logging
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import httpx
import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from app.client import ApiError, GestaClient, GestaError, Message, Stream, trajectory
from app.client.answers import Generated
from app.motion.evaluation import TOLERANCE, evaluate
from app.motion.resampling import smooth
from app.motion.simulation import GRIP, demonstrations, recording
from app.motion.trajectory import Demonstration, Floats, Recording, Segment, Trajectory

MODEL = "table-top"
ACTION = "displace"
GOAL = GRIP + 0.33 * np.array([np.sin(0.45), np.cos(0.45), 0.0])
"""Where the generated movement is to end: between the demonstrated places [m]."""

TRAINING_SEED, RECORDING_SEED, N_ACTIONS = 1, 2, 5
START_S, STOP_S = 60.0, 30.0
"""How long the server may take to start and to stop [s]."""

COLOURS = {"grasp": "cyan", "displace": "green", "push": "yellow", "retract": "magenta"}


class DemoFailed(Exception):
    """The demonstration cannot go on; the message says what to do."""


@dataclass(frozen=True)
class Shown:
    """What was shown: the recognised segments, the labelled recording they are of, and the picture."""

    segments: list[Message]
    recording: Recording
    session_id: str
    picture: Path


def demo(
    folder: Annotated[Path, typer.Option(help="Where database, models and picture go.")] = Path("demo"),
    speed: Annotated[float, typer.Option(min=0.1, hidden=True, help="Of the stream; 1: real time.")] = 1.0,
) -> None:
    """Show the whole line: demonstrations, training, live recognition, a new movement. Under a minute."""
    logging.getLogger("httpx").setLevel(logging.WARNING)
    console = Console(highlight=False)
    try:
        shown = run(folder, console, speed)
    except (DemoFailed, GestaError) as error:
        console.print(f"[red]The demo stopped:[/] {error}", soft_wrap=True)
        raise typer.Exit(1) from error
    _farewell(folder, shown, console)


def run(folder: Path, console: Console, speed: float = 1.0) -> Shown:
    """Run the demonstration in ``folder``; speed: of the stream, 1 for real time. Raises DemoFailed."""
    if find_spec("matplotlib") is None:
        raise DemoFailed("it draws with matplotlib, which is missing: pip install 'gesta\\[demo]'")
    folder.mkdir(parents=True, exist_ok=True)
    console.print("\n[bold]Gesta[/] learns actions from demonstrations, recognises them, re-enacts them.\n")
    with serving(folder) as url, GestaClient(url) as client:
        _step(console, "Server", f"{url}/v1, a process of its own, data in {folder}/")
        taught = demonstrations(TRAINING_SEED)
        _upload(client, taught, console)
        _train(client, console)
        seen = recording(RECORDING_SEED, N_ACTIONS)
        session_id, segments = _recognise(client, seen, speed, console)
        _tell_measures(seen, segments, console)
        picture = _generate(client, taught, folder, console)
    return Shown(segments, seen, session_id, picture)


@contextmanager
def serving(folder: Path) -> Iterator[str]:
    """Run ``gesta serve`` with database, store and log in ``folder``; yield its address.

    Raises DemoFailed where it does not start.
    """
    log = folder / "server.log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "app.cli", "serve", "--host", "127.0.0.1", "--port", "0"],
            env={**os.environ, **_settings(folder), "GESTA_JOB_WORKER": "embedded"},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
        )
    try:
        yield _address(process, log)
    finally:
        stop(process)


def stop(process: subprocess.Popen[bytes]) -> None:
    """End a server in order, or where it does not end, at once."""
    process.terminate()
    try:
        process.wait(STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _settings(folder: Path) -> dict[str, str]:
    return {
        "GESTA_DATABASE_URL": f"sqlite:///{folder / 'gesta.db'}",
        "GESTA_STORE_URL": f"{folder / 'models_store'}",
    }


def _address(process: subprocess.Popen[bytes], log: Path) -> str:
    """Return the address that the server says it listens on, once it answers there."""
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline and process.poll() is None:
        if found := re.search(r"listens on (http://\S+)/v1", log.read_text()):
            try:
                httpx.get(f"{found[1]}/readyz", timeout=START_S).raise_for_status()
            except httpx.HTTPError as error:
                raise DemoFailed(f"the server is not ready ({error}); see {log}") from error
            return found[1]
        time.sleep(0.05)
    raise DemoFailed(f"the server did not start; see {log}")


def _upload(client: GestaClient, taught: Sequence[Demonstration], console: Console) -> None:
    try:
        client.create_model(MODEL, ["object"], description="Simulated table-top actions.")
    except ApiError as error:
        if error.code != "already_exists":
            raise
    sent = [(shown.action, _as_json(shown.trajectory)) for shown in taught]
    added = client.add_demonstrations(MODEL, sent)
    counts = Counter(shown.action for shown in taught)
    listed = ", ".join(f"{counts[action]} {_coloured(action)}" for action in counts)
    _step(console, "Demonstrations", f"{len(taught)} uploaded over HTTP: {listed}")
    if added["duplicates"]:
        _more(console, f"{len(added['duplicates'])} of them were there from an earlier run")


def _train(client: GestaClient, console: Console) -> None:
    job = client.train(MODEL)
    columns = (TextColumn("[bold]{task.description:<15}[/]"), BarColumn(24), TimeElapsedColumn())
    with Progress(*columns, TextColumn("{task.fields[message]}"), console=console) as progress:
        task = progress.add_task("Training", total=None, message="")

        def watch(told: Message) -> None:
            at = told["progress"]
            progress.update(task, completed=at["done"], total=at["total"] or None, message=at["message"])

        number = client.result(job["id"], watch)["version"]
        progress.update(task, completed=1, total=1, message="done")
    version = client.version(MODEL, number)
    client.promote(MODEL, "production", number)
    _more(console, f"version {number}, promoted to [bold]production[/]")
    if (found := version["evaluation"]) is not None:
        _more(console, f"cross-validated: {found['accuracy']:.1%} of {found['n']} classified right")


def _recognise(
    client: GestaClient, seen: Recording, speed: float, console: Console
) -> tuple[str, list[Message]]:
    """Stream a recording at the pace of its times; return the session's id and the segments found."""
    _step(console, "Recognition", f"{len(seen.segments)} actions streamed over WebSocket as they happen")
    heading = f"{'found':<9}{'start':>6}{'end':>7}"
    _more(console, f"[dim]{heading}   {heading.replace('found', 'truth')}   decided")
    segments = []
    with client.stream(MODEL, name="demo") as stream, ThreadPoolExecutor(1) as pool:
        begin = time.monotonic()
        playing = pool.submit(_play, stream, seen.trajectory, speed)
        with console.status("streaming") as status:
            for message in stream:
                now = speed * (time.monotonic() - begin)
                if message["type"] == "segment":
                    segments.append(message)
                    _more(console, _line(message, seen, now))
                elif message["type"] == "hypothesis":
                    status.update(f"{now:5.2f} s  {_guess(message)}")
        playing.result()
    return stream.state.started["session_id"], segments


def _play(stream: Stream, motion: Trajectory, speed: float) -> None:
    """Send every frame when its time has come, and the end."""
    begin, sent = time.monotonic(), 0
    due = (motion.times - motion.times[0]) / speed
    while sent < len(motion):
        time.sleep(max(float(due[sent]) - (time.monotonic() - begin), 0.0))
        ready = int(np.searchsorted(due, time.monotonic() - begin, side="right"))
        part = motion.part(sent, max(ready, sent + 1))
        stream.send(part.times, part.hand, part.objects)
        sent += len(part)
    stream.end()


def _line(found: Message, seen: Recording, now: float) -> str:
    """Return what is printed of a segment: it, the truth beside it, and when it was decided."""
    times, span = seen.trajectory.times, Segment(found["start_seq"], found["end_seq"])
    true = max(seen.segments, key=lambda truth: _shared(truth, span))
    beside = f"[red]{'nothing':<22}[/]"
    if _shared(true, span) > 0:
        end = times[min(true.end, len(times) - 1)]
        beside = f"{_coloured(true.action, 9)}{times[true.start]:6.2f}{end:7.2f}"
    here = f"{_coloured(found['action'], 9)}{found['t_start']:6.2f}{found['t_end']:7.2f}"
    return f"{here}   {beside}   [dim]{now - found['t_end']:.2f} s later[/]"


def _shared(one: Segment, other: Segment) -> int:
    """Return how many frames two segments share."""
    return max(min(one.end, other.end) - max(one.start, other.start), 0)


def _guess(hypothesis: Message) -> str:
    best = max(hypothesis["actions"], key=lambda guess: float(guess["posterior"]))
    if best["action"] is None:
        return "looks like nothing that was learned"
    return "at rest" if best["action"] == "rest" else f"looks like {_coloured(best['action'])}"


def _tell_measures(seen: Recording, segments: Sequence[Message], console: Console) -> None:
    found = [Segment(each["start_seq"], each["end_seq"], each["action"]) for each in segments]
    measures = evaluate([(seen.trajectory.times, seen.segments, found)])
    right = round((measures.delineated or 0.0) * measures.n_true)
    share = measures.frame_accuracy or 0.0
    _more(
        console,
        f"{right} of {measures.n_true} delineated within {TOLERANCE} s, {share:.0%} of their frames right",
    )


def _generate(client: GestaClient, taught: Sequence[Demonstration], folder: Path, console: Console) -> Path:
    """Ask for a movement to a place where nobody went, draw it and return the picture."""
    alike = [shown.trajectory for shown in taught if shown.action == ACTION]
    start, goal = alike[0].hand[0].round(3), GOAL.round(3)
    motion = client.generate(MODEL, "production", ACTION, start, goal, rate_hz=100)
    nearest = min(float(np.linalg.norm(shown.hand[-1] - goal)) for shown in alike)
    _step(
        console,
        "Generation",
        f"{_coloured(ACTION)} to {_point(goal)}, {nearest:.2f} m from the nearest demonstrated goal",
    )
    picture = folder / f"{ACTION}.png"
    _draw(motion, alike, picture)
    off = max(
        float(np.abs(np.subtract(motion["position"][at], point)).max())
        for at, point in ((0, start), (-1, goal))
    )
    _more(console, f"{motion['t'][-1]:.2f} s, {off * 1e6:.1f} µm off the points asked for")
    _more(console, f"drawn in {picture}")
    return picture


def _draw(motion: Generated, alike: Sequence[Trajectory], picture: Path) -> None:
    """Draw a generated movement before the demonstrations it was learned from."""
    figure = import_module("matplotlib.figure").Figure(figsize=(12, 6), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.7, 1.0))
    speeds = figure.add_subplot(grid[0, 1])
    _draw_path(figure.add_subplot(grid[:, 0], projection="3d"), motion, alike)
    _draw_profiles(speeds, figure.add_subplot(grid[1, 1], sharex=speeds), motion, alike)
    figure.suptitle(
        f"A new movement: {motion['action']}, by version {motion['version']} of {motion['model']}"
    )
    figure.savefig(picture, dpi=130)


def _draw_path(axes: Any, motion: Generated, alike: Sequence[Trajectory]) -> None:
    for shown in alike:
        axes.plot(*shown.hand.T, color="0.6", linewidth=0.7, alpha=0.5)
    path = np.array(motion["position"])
    axes.plot(*path.T, color="tab:blue", linewidth=3, label="generated")
    axes.plot([], [], color="0.6", linewidth=0.7, label="demonstrations")
    axes.scatter(*path[0], color="tab:green", s=70, label="start", depthshade=False)
    axes.scatter(*path[-1], color="tab:red", s=160, marker="*", label="new goal", depthshade=False)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.locator_params(nbins=5)
    axes.view_init(elev=30, azim=-70)
    axes.legend(loc="upper left", frameon=False)


def _draw_profiles(speeds: Any, heights: Any, motion: Generated, alike: Sequence[Trajectory]) -> None:
    for shown in alike:
        clean = smooth(shown)
        since = clean.times - clean.times[0]
        speeds.plot(since, _norms(np.gradient(clean.hand, since, axis=0)), color="0.6", lw=0.7, alpha=0.5)
        heights.plot(since, clean.hand[:, 2], color="0.6", lw=0.7, alpha=0.5)
    times, height = np.array(motion["t"]), np.array(motion["position"])[:, 2]
    spread = np.array(motion["std"])[:, 2]
    speeds.plot(times, _norms(np.array(motion["velocity"])), color="tab:blue", lw=3)
    heights.fill_between(times, height - spread, height + spread, color="tab:blue", alpha=0.2, lw=0)
    heights.plot(times, height, color="tab:blue", lw=3)
    speeds.set(ylabel="speed [m/s]", ylim=(0, None))
    heights.set(xlabel="time [s]", ylabel="height ± standard deviation [m]", xlim=(0, None))
    for axes in (speeds, heights):
        axes.spines[["top", "right"]].set_visible(False)


def _norms(vectors: Floats) -> Floats:
    lengths: Floats = np.linalg.norm(vectors, axis=1)
    return lengths


def _farewell(folder: Path, shown: Shown, console: Console) -> None:
    settings = " ".join(f"{name}={shlex.quote(value)}" for name, value in _settings(folder).items())
    models = f"http://127.0.0.1:8000/v1/models/{MODEL}"
    body = '{"start": [0.0, 0.25, 0.04], "goal": [0.3, 0.2, 0.04]}'
    lines = [
        "\n[bold]Where it is[/]",
        f"  {shown.picture}  the generated movement",
        f"  {folder / 'gesta.db'}, {folder / 'models_store'}  all that the server knows",
        f"  {folder / 'server.log'}  what it said; it has stopped",
        "\n[bold]Try next[/]",
        f"  {settings} {_command()} serve",
        "[dim]and in another terminal[/]",
        f"  curl {models}/versions/production",
        f"  curl {models}/versions/production/actions/push/trajectories "
        f"-H 'Content-Type: application/json' -d '{body}'",
        f"  curl http://127.0.0.1:8000/v1/sessions/{shown.session_id}/segments",
        "",
    ]
    for line in lines:
        console.print(line, soft_wrap=True)


def _command() -> str:
    """Return how to call ``gesta`` from here."""
    beside = Path(sys.executable).with_name("gesta")
    if shutil.which("gesta") == str(beside) or not beside.exists():
        return "gesta"
    return shlex.quote(os.path.relpath(beside))


def _step(console: Console, name: str, text: str) -> None:
    console.print(f"[bold]{name:<16}[/]{text}", soft_wrap=True)


def _more(console: Console, text: str) -> None:
    console.print(f"{'':16}{text}", soft_wrap=True)


def _coloured(action: str | None, width: int = 0) -> str:
    name = action or "unknown"
    return f"[{COLOURS.get(name, 'white')}]{name:<{width}}[/]"


def _point(position: Floats) -> str:
    return f"({', '.join(f'{value:.2f}' for value in position)}) m"


def _as_json(motion: Trajectory) -> Message:
    return trajectory(motion.times, motion.hand, motion.objects)
