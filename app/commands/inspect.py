"""``gesta inspect``: what is in a file of motion capture, and which of its tracks may be hand and objects."""

from __future__ import annotations

import json
from collections import Counter
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from app.commands.recordings import Reading, Unit, Up
from app.commands.terminal import AsJson, failure, show, show_json, show_table, tell
from app.formats.errors import FormatError, InvalidMapping

if TYPE_CHECKING:
    from app.client import Message
    from app.formats.capture import Capture


def inspect(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    write: Annotated[Path | None, typer.Option(help="Write the proposed mapping to a file.")] = None,
    unit: Unit = None,
    up: Up = None,
    as_json: AsJson = False,
) -> None:
    """Tell what is in a recording, and propose a mapping. No server is asked."""
    try:
        capture = Reading(unit, up).capture(file)
    except (FormatError, OSError) as error:
        raise failure(f"{file}: {str(error).removeprefix(f'{file.name}: ')}") from error
    told = {"file": str(file), **_told(capture), **_proposed(capture)}
    show_json(told) if as_json else _show(told)
    if write is not None:
        _write(told, write)


def _told(capture: Capture) -> Message:
    return {
        "format": capture.format,
        "rate_hz": capture.rate or (1 / capture.period if capture.period else None),
        "n_frames": len(capture),
        "duration_s": float(capture.times[-1] - capture.times[0]),
        "tracks": [_track(capture, name) for name in capture.tracks],
        "labels": [vars(label) for label in capture.labels],
        "notes": list(capture.notes),
    }


def _track(capture: Capture, name: str) -> Message:
    """Return how much of a track is there, and where it goes [m]."""
    track = capture.tracks[name]
    missing = np.isnan(track[:, 0]).tolist()
    gaps = [len(list(run)) for is_gap, run in groupby(missing) if is_gap]
    seen = track[[not each for each in missing]]
    return {
        "name": name,
        "missing": sum(gaps) / len(missing),
        "gaps": len(gaps),
        "longest_gap_s": max(gaps, default=0) * capture.period,
        "min": seen.min(axis=0).tolist() if len(seen) else None,
        "max": seen.max(axis=0).tolist() if len(seen) else None,
    }


def _proposed(capture: Capture) -> Message:
    from app.formats.proposal import propose  # noqa: PLC0415 (it takes its time to load)

    try:
        mapping, reasons = propose(capture)
    except InvalidMapping as error:
        return {"mapping": None, "reasons": [str(error)]}
    return {"mapping": mapping.as_json(), "reasons": list(reasons)}


def _show(told: Message) -> None:
    rate = "" if told["rate_hz"] is None else f" at {told['rate_hz']:.4g} Hz"
    show(f"{told['file']}: {told['format']}, {told['n_frames']} frames{rate}, {told['duration_s']:.2f} s")
    rows = [
        (
            each["name"],
            f"{each['missing']:.1%}",
            each["gaps"],
            each["longest_gap_s"],
            *(_range(each, axis) for axis in range(3)),
        )
        for each in told["tracks"]
    ]
    show_table(("track", "missing", "gaps", "longest [s]", "x [m]", "y [m]", "z [m]"), *rows)
    if told["labels"]:
        counts = Counter(label["action"] for label in told["labels"])
        show("labels: " + ", ".join(f"{action} {count}" for action, count in counts.items()))
    show(*(f"note: {note}" for note in told["notes"]))
    if told["mapping"] is None:
        show("proposed mapping: none")
    else:
        show(f"proposed mapping: {json.dumps(told['mapping'])}")
    show(*(f"  {reason}" for reason in told["reasons"]))


def _range(track: Message, axis: int) -> Any:
    return None if track["min"] is None else f"{track['min'][axis]:.2f} … {track['max'][axis]:.2f}"


def _write(told: Message, path: Path) -> None:
    if told["mapping"] is None:
        raise failure("there is no mapping to write")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(json.dumps(told["mapping"], indent=2) + "\n")
    except FileExistsError as error:
        raise failure(f"{path} is there already") from error
    except OSError as error:
        raise failure(f"{path}: {error.strerror}") from error
    tell(f"{path}: look at it before you use it")
