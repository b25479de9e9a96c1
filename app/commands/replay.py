"""``gesta replay``: a recording as a stream, as if it happened now."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.progress import MofNCompleteColumn, Progress

from app.commands.asking import URL, Url, Version, asking, number_of
from app.commands.live import Block, run, until_stopped
from app.commands.recordings import HAND, MappingFile, Reading, Recorded, Unit, Unusable, Up
from app.commands.terminal import AsJson, progress

if TYPE_CHECKING:
    from app.client.wire import Floats

AT_ONCE = 100
"""Frames in a message where nothing is waited for."""


def replay(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    model: Annotated[str, typer.Option(help="Whose actions are to be found.")],
    version: Version = None,
    speed: Annotated[float, typer.Option(min=0, help="1: real time; 0: as fast as possible.")] = 1.0,
    name: Annotated[str | None, typer.Option(help="Of the session; default: that of the file.")] = None,
    mapping: MappingFile = None,
    unit: Unit = None,
    up: Up = None,
    as_json: AsJson = False,
    url: Url = URL,
) -> None:
    """Stream a recording and tell its segments as they are recognised; Ctrl-C ends it early."""
    with asking(url) as client, until_stopped() as stopped:
        recorded = Reading(unit, up, mapping).read_one(file)
        times, hand, objects = arrays(recorded)
        start = {
            "version": number_of(client, model, version),
            "geometry": recorded.geometry,
            "scene": recorded.scene,
            "objects": list(objects),
            "name": name or file.name,
            "options": {"hypotheses": False},
        }
        blocks = paced(times, hand, objects, speed, stopped)
        bar = progress("Replaying", MofNCompleteColumn(), as_json=as_json)
        with client.stream(model, **start) as stream, bar as shown:
            run(stream, _counted(blocks, shown, len(times)), as_json, stopped)


def arrays(recorded: Recorded) -> tuple[Floats, Floats, dict[str, Floats]]:
    """Return times (n,) [s], hand and objects (n, 3) of a recording; a dropout is NaN. Raises Unusable."""
    motion = recorded.trajectory
    try:
        tracks = {HAND: motion[HAND], **motion.get("objects", {})}
        rows = {
            name: np.array([[np.nan] * 3 if at is None else at for at in track], float)
            for name, track in tracks.items()
        }
        hand = rows.pop(HAND)
        times = (
            np.arange(len(hand)) / motion["rate_hz"] if "rate_hz" in motion else np.array(motion["t"], float)
        )
        for name, track in {HAND: hand, **rows}.items():
            if track.shape != (len(times), 3):
                raise ValueError(f"{name} has shape {track.shape}, needs ({len(times)}, 3)")
    except (AttributeError, LookupError, TypeError, ValueError, ZeroDivisionError) as error:
        raise Unusable(f"the trajectory needs t or rate_hz, hand and objects: {error}") from error
    return times, hand, rows


def _counted(blocks: Iterable[Block], shown: Progress, n_frames: int) -> Iterator[Block]:
    """Yield the blocks and show how many of their frames have gone."""
    [task] = shown.task_ids
    shown.update(task, total=n_frames)
    for block in blocks:
        yield block
        shown.advance(task, len(block.hand))


def paced(
    times: Floats, hand: Floats, objects: Mapping[str, Floats], speed: float, stopped: threading.Event
) -> Iterator[Block]:
    """Yield frames when their time has come, at a multiple of real time, 0: at once; until ``stopped``."""
    begin, sent = time.monotonic(), 0
    while sent < len(times) and not stopped.is_set():
        ready = sent + AT_ONCE
        if speed:
            due = float(times[sent] - times[0]) / speed
            if stopped.wait(max(due - (time.monotonic() - begin), 0.0)):
                return
            now = times[0] + speed * (time.monotonic() - begin)
            ready = max(int(times.searchsorted(now, side="right")), sent + 1)
        part = slice(sent, ready)
        yield Block(times[part], hand[part], {name: track[part] for name, track in objects.items()})
        sent = ready
