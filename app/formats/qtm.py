"""Qualisys Track Manager, 3D motion data as TSV: header lines, names of columns perhaps, a row a frame.

Lengths are in millimetres; which axis is up was chosen at the calibration and is not written down. An empty
cell is a gap, and so is (0, 0, 0), as some versions write it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from app.formats.capture import Capture, Declared, resolve, said_and_found, timeline
from app.formats.errors import NotRead, Unreadable
from app.formats.sheet import AXES, Sheet, positions, read_text

if TYPE_CHECKING:
    from app.motion.trajectory import Floats

NAME, TITLE = "qtm-tsv", "QTM TSV"


class Header(NamedTuple):
    """Keys and values, events, names of the columns if there are any, the row of the first frame."""

    values: dict[str, list[str]]
    events: list[str]
    columns: list[str]
    first: int


def read(path: Path, declared: Declared) -> Capture:
    """Return the recording in a file. Raises FormatError."""
    sheet = Sheet(read_text(path), "\t", quoted=False)
    header = _header(sheet)
    if (kind := header.values.get("DATA_INCLUDED", ["3D"])[0]) != "3D":
        raise NotRead(f"this QTM TSV file holds {kind} data; export 3D data (markers) from QTM instead")
    indices = sheet.filled(header.first)
    columns, n_before = _columns(header, len(sheet.row(header.first)))
    tracks = positions(sheet, indices, columns, resolve(TITLE, declared, "mm"))
    n_zeros = sum(_drop_zeros(track) for track in tracks.values())
    rate = _number(sheet, header, "FREQUENCY")
    frames = sheet.whole_numbers(indices, 0) if n_before else np.arange(1, len(indices) + 1)
    column = sheet.numbers(indices, [1])[:, 0] if n_before else None
    return Capture(
        NAME,
        timeline(frames, rate, column, first=1),
        frames,
        tracks,
        rate,
        notes=(
            *said_and_found("frames", _number(sheet, header, "NO_OF_FRAMES"), len(indices)),
            *([f"{n_zeros} positions of exactly (0, 0, 0) are read as gaps"] if n_zeros else ()),
            *header.events,
        ),
    )


def _header(sheet: Sheet) -> Header:
    values: dict[str, list[str]] = {}
    events: list[str] = []
    for index, cells in enumerate(sheet.rows):
        if not any(cells):
            continue
        key = cells[0]
        if key == "Frame" or key.endswith(" X"):
            return Header(values, events, sheet.row(index), index + 1)
        if not key.replace("_", "").isupper():
            return Header(values, events, [], index)
        if key == "EVENT":
            events.append("event " + ", ".join(sheet.row(index)[1:]))
        else:
            values[key] = sheet.row(index)[1:] or [""]
    raise Unreadable("", "has a header but no frames")


def _columns(header: Header, width: int) -> tuple[dict[int, str], int]:
    """Return column -> name of each marker, and how many columns stand before the first: 0 or 2."""
    names = header.values.get("MARKER_NAMES", [])
    if header.columns:
        n_before = 2 if header.columns[:2] == ["Frame", "Time"] else 0
        return _by_columns(header.columns, n_before, f"line {header.first}"), n_before
    if not names:
        raise Unreadable("", "has neither MARKER_NAMES nor names of columns")
    n_before = 0 if width <= 3 * len(names) else 2
    return {n_before + 3 * at: name for at, name in enumerate(names)}, n_before


def _by_columns(columns: list[str], n_before: int, place: str) -> dict[int, str]:
    """Return column -> name of what is called ``NAME X``, ``NAME Y``, ``NAME Z``."""
    found = {}
    for start in range(n_before, len(columns), 3):
        split = [column.rpartition(" ") for column in columns[start : start + 3]]
        names, axes = {name for name, _, _ in split}, tuple(axis.casefold() for _, _, axis in split)
        if len(names) > 1 or axes != AXES:
            raise Unreadable(place, f"column {start + 1}: needs NAME X, NAME Y, NAME Z side by side")
        found[start] = names.pop()
    return found


def _drop_zeros(track: Floats) -> int:
    zero = (track == 0.0).all(axis=1)
    track[zero] = np.nan
    return int(zero.sum())


def _number(sheet: Sheet, header: Header, key: str) -> float | None:
    """Return a number of the header; None where there is none, or the clock was external (``EXT``)."""
    cell = header.values.get(key, [""])[0]
    return None if cell in ("", "EXT") else sheet.number(key, cell)
