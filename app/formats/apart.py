"""``python -m app.formats.apart PATH DECLARED LIMITS``: read a file under limits, write it to stdout.

What is written: 8 bytes, the length of a header, little-endian; the header, JSON; then float64 and int64 as
they are, little-endian: times (n,), frames (n,), tracks (k, n, 3). Of an error, the header alone.
"""

from __future__ import annotations

import json
import os
import resource
import sys
from pathlib import Path
from typing import BinaryIO

LENGTH = 8


def main(arguments: list[str]) -> int:
    """Set the limits, then load the readers and read: path, declared [unit, axis] and limits as JSON.

    Return the status to exit with, which says what there was too little of.
    """
    path, declared, limits = Path(arguments[0]), json.loads(arguments[1]), json.loads(arguments[2])
    for limit, most in limits.items():
        resource.setrlimit(getattr(resource, limit), tuple(most))
    out = os.dup(1)
    os.dup2(2, 1)  # what a library says is no result
    try:
        with os.fdopen(out, "wb") as file:
            _answer(file, path, declared)
    except MemoryError:
        return os.EX_UNAVAILABLE
    except OSError:
        return os.EX_IOERR
    return os.EX_OK


def _answer(out: BinaryIO, path: Path, declared: list[str | None]) -> None:
    from app.formats.capture import Declared  # noqa: PLC0415 (under the limits, and what they load too)
    from app.formats.errors import FormatError  # noqa: PLC0415
    from app.formats.reading import read  # noqa: PLC0415

    try:
        capture = read(path, Declared(*declared))  # type: ignore[arg-type]
    except FormatError as error:
        _write(out, {"error": type(error).__name__, "arguments": error.args})
        return
    header = {
        "format": capture.format,
        "n_frames": len(capture),
        "tracks": list(capture.tracks),
        "rate": capture.rate,
        "labels": [[label.action, label.start_s, label.end_s] for label in capture.labels],
        "notes": capture.notes,
        "systems": dict(capture.systems),
    }
    arrays = [capture.times, capture.frames, *capture.tracks.values()]
    _write(out, header, *(array.tobytes() for array in arrays))


def _write(out: BinaryIO, header: dict[str, object], *content: bytes) -> None:
    told = json.dumps(header).encode()
    for part in (len(told).to_bytes(LENGTH, "little"), told, *content):
        out.write(part)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
