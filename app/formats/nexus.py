"""Vicon Nexus, ASCII export as CSV: sections one below the other, of which ``Trajectories`` is read.

Lengths are in the unit over each column; which axis is up is not written down. An empty cell is a gap.
"""

from __future__ import annotations

from pathlib import Path

from app.formats.capture import Capture, Declared, resolve, timeline, unit_of
from app.formats.errors import Unreadable
from app.formats.sheet import Sheet, positions, read_text, triples

NAME, TITLE = "nexus-csv", "Vicon Nexus CSV"

SECTIONS = ("Trajectories", "Devices", "Joints", "Segments", "Model Outputs", "Force Plates", "Events")
"""The first cells by which a file is known."""


def read(path: Path, declared: Declared) -> Capture:
    """Return the recording in a file. Raises FormatError."""
    sheet = Sheet(read_text(path), ",")
    starts = {cells[0]: index for index in range(len(sheet.rows)) if len(cells := sheet.row(index)) == 1}
    others = [name for name in SECTIONS[1:] if name in starts]
    if "Trajectories" not in starts:
        raise Unreadable(
            "", f"has no section Trajectories, only {', '.join(others) or 'others'}: export it too"
        )
    top = starts["Trajectories"]
    rate = sheet.number(f"line {top + 2}", "".join(sheet.row(top + 1)))
    names, kinds, units = (sheet.row(top + 2 + row) for row in range(3))
    if kinds[:2] != ["Frame", "Sub Frame"]:
        raise Unreadable(f"line {top + 4}", "needs the columns Frame and Sub Frame before all others")
    found = triples(kinds, names)
    said = {units[column + axis] for column in found for axis in range(3) if column + axis < len(units)}
    if len(said) != 1:
        raise Unreadable(f"line {top + 5}", f"needs one length unit for all positions, has {sorted(said)}")
    geometry = resolve(TITLE, declared, unit_of(said.pop(), f"line {top + 5}"))
    indices = sheet.block(top + 5)
    frames = sheet.whole_numbers(indices, 0)
    return Capture(
        NAME,
        timeline(frames, rate, None, first=1),
        frames,
        positions(sheet, indices, found, geometry),
        rate,
        notes=(f"sections not read: {', '.join(others)}",) if others else (),
    )
