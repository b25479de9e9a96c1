"""TRC (track row column), as Cortex, Motive and OpenSim have it: tabs, or commas for tabs.

Rate and length unit are in the header; which axis is up is not. An empty cell is a gap.
"""

from __future__ import annotations

from pathlib import Path

from app.formats.capture import Capture, Declared, resolve, said_and_found, timeline, unit_of
from app.formats.errors import Unreadable
from app.formats.sheet import Sheet, positions, read_text

NAME, TITLE = "trc", "TRC"


def read(path: Path, declared: Declared) -> Capture:
    """Return the recording in a file. Raises FormatError."""
    text = read_text(path)
    sheet = Sheet(text, "\t" if "\t" in text.split("\n", 1)[0] else ",", quoted=False)
    if "(X/Y/Z)" not in sheet.row(0):
        raise Unreadable("line 1", "needs PathFileType with the axes (X/Y/Z)")
    header = dict(zip(sheet.row(1), sheet.row(2), strict=False))
    names = sheet.row(3)
    if [name.casefold() for name in names[:2]] != ["frame#", "time"]:
        raise Unreadable("line 4", "needs the columns Frame# and Time before all others")
    found = {2 + 3 * at: name for at, name in enumerate(names[2::3]) if name}
    geometry = resolve(TITLE, declared, unit_of(header["Units"], "Units") if "Units" in header else None)
    numbers = {
        key: sheet.number(key, header[key])
        for key in ("DataRate", "NumFrames", "NumMarkers")
        if key in header
    }
    indices = sheet.filled(5)
    frames, rate = sheet.whole_numbers(indices, 0), numbers.get("DataRate")
    return Capture(
        NAME,
        timeline(frames, rate, sheet.numbers(indices, [1])[:, 0], first=1),
        frames,
        positions(sheet, indices, found, geometry),
        rate,
        notes=(
            *said_and_found("frames", numbers.get("NumFrames"), len(indices)),
            *said_and_found("markers", numbers.get("NumMarkers"), len(found)),
        ),
    )
