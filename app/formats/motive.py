"""OptiTrack Motive, CSV export 1.2x: rigid bodies, markers and bones, of which the positions are read.

The first line names rate, length unit and coordinate space. Motive's world is Y up; newer versions can export
it turned without saying so, which is what a declared ``z`` says. An empty cell is a gap.
"""

from __future__ import annotations

from pathlib import Path

from app.formats.capture import Capture, Declared, Geometry, resolve, said_and_found, timeline, unit_of
from app.formats.errors import NotRead, Unreadable
from app.formats.sheet import AXES, Sheet, positions, read_text

NAME, TITLE = "motive-csv", "Motive CSV"


def read(path: Path, declared: Declared) -> Capture:
    """Return the recording in a file. Raises FormatError."""
    sheet = Sheet(read_text(path), ",")
    cells = sheet.row(0)
    header = dict(zip(cells[::2], cells[1::2], strict=False))
    if not header.get("Format Version", "").startswith("1.2"):
        raise NotRead(
            f"Motive CSV of format version {header.get('Format Version')!r}; versions 1.2x are read"
        )
    if (space := header.get("Coordinate Space", "Global")) != "Global":
        raise NotRead(f"this Motive CSV file is in {space!r} coordinates; export them as 'Global'")
    top = _top(sheet)
    found = _columns(sheet, top)
    indices = sheet.filled(top + 1)
    frames = sheet.whole_numbers(indices, 0)
    rate = _number(sheet, header, "Export Frame Rate")
    return Capture(
        NAME,
        timeline(frames, rate, sheet.numbers(indices, [1])[:, 0], first=0),
        frames,
        positions(sheet, indices, found, _geometry(header, declared)),
        rate,
        notes=said_and_found("frames", _number(sheet, header, "Total Exported Frames"), len(indices)),
    )


def _geometry(header: dict[str, str], declared: Declared) -> Geometry:
    said = header.get("Length Units")
    unit = unit_of(said, "Length Units") if said else None
    return resolve(TITLE, declared, unit, None if declared.up_axis else "y")


def _top(sheet: Sheet) -> int:
    """Return the row over the first frame, which names the axes."""
    for index in range(2, min(len(sheet.rows), 12)):
        if sheet.rows[index][:1] == ["Frame"]:
            return index
    raise Unreadable("", "has no row that begins with Frame over its columns")


def _columns(sheet: Sheet, top: int) -> dict[int, str]:
    """Return column -> name of all positions; what is called alike is told apart by its kind."""
    kinds, names, what, axes = (sheet.row(row) for row in (2, 3, top - 1, top))
    width = min(len(kinds), len(names), len(what), len(axes))
    starts = [
        column
        for column in range(2, width - 2)
        if what[column : column + 3] == ["Position"] * 3
        and tuple(axis.casefold() for axis in axes[column : column + 3]) == AXES
    ]
    found: dict[int, str] = {}
    for column in starts:
        name = names[column]
        found[column] = f"{name} ({kinds[column]})" if name in found.values() else name
    return found


def _number(sheet: Sheet, header: dict[str, str], key: str) -> float | None:
    return sheet.number(key, header[key]) if header.get(key) else None
