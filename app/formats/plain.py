"""Tables that people write themselves: a row a frame under a header of names.

``t`` or ``time_s`` is the time [s], ``frame`` the number of a frame; ``NAME.x,NAME.y,NAME.z`` or
``NAME_x,NAME_y,NAME_z`` are a track, an empty cell is a dropout; a column ``action`` (else ``label``) names
what is done: rows in a run of one name are a label, which ends with the row after. Length unit and up axis
are declared by the caller.
"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.formats.capture import Capture, Declared, Label, resolve
from app.formats.errors import Unreadable
from app.formats.sheet import AXES, Sheet, positions, read_text

if TYPE_CHECKING:
    from app.motion.trajectory import Floats

NAME, TITLE = "csv", "CSV"

TIMES, FRAMES, LABELS = ("t", "time_s"), ("frame",), ("action", "label")
DELIMITERS = ",;\t"


def read(path: Path, declared: Declared) -> Capture:
    """Return the recording in a file. Raises FormatError."""
    text = read_text(path)
    header = text.split("\n", 1)[0]
    sheet = Sheet(text, max(DELIMITERS, key=header.count))
    names = sheet.row(0)
    at = {key: names.index(key) for key in (*TIMES, *FRAMES, *LABELS) if key in names}
    if not (time := [at[key] for key in TIMES if key in at]):
        raise Unreadable("line 1", "needs a column t or time_s with the time in seconds")
    found = _columns(names)
    if not found:
        raise Unreadable("line 1", "needs columns NAME.x, NAME.y, NAME.z (or NAME_x, …) side by side")
    indices = sheet.filled(1)
    times = sheet.numbers(indices, [time[0]])[:, 0]
    frames = sheet.whole_numbers(indices, at["frame"]) if "frame" in at else np.arange(len(indices))
    tracks = positions(sheet, indices, found, resolve(TITLE, declared))
    spoken = [at[key] for key in LABELS if key in at][:1]
    cells = [(sheet.rows[index][spoken[0] :] or [""])[0] for index in indices] if spoken else []
    known = {*at.values(), *(start + axis for start in found for axis in range(3))}
    others = [name for column, name in enumerate(names) if column not in known]
    notes = (f"columns not read: {', '.join(others)}",) if others else ()
    return Capture(NAME, times, frames, tracks, labels=_labels(cells, times), notes=notes)


def _columns(names: list[str]) -> dict[int, str]:
    """Return column -> name of each track."""
    found = {}
    for start in range(len(names) - 2):
        bases = {name[:-2] for name in names[start : start + 3] if name[-2:-1] in (".", "_")}
        axes = tuple(name[-1:].casefold() for name in names[start : start + 3])
        if len(bases) == 1 and "" not in bases and axes == AXES:
            found[start] = bases.pop()
    return found


def _labels(cells: list[str], times: Floats) -> tuple[Label, ...]:
    """Return a label for each run of rows with one name; the last one ends a period after its last row."""
    if len(times) < 2:
        return ()
    ends = np.append(times, times[-1] + np.median(np.diff(times)))
    labels, start = [], 0
    for action, run in groupby(cells):
        stop = start + len(list(run))
        if action:
            labels.append(Label(action, float(ends[start]), float(ends[stop])))
        start = stop
    return tuple(labels)
