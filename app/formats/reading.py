"""Which reader is for a file: by the mark it begins with where its format has one, else by its name's end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.formats import bags, bvh, c3d, motive, nexus, npz, plain, qtm, trc
from app.formats.capture import Capture, Declared
from app.formats.errors import NotRead, UnknownFormat, Unreadable

HEAD = 4096
"""Bytes by which a file is known."""

Reader = Callable[[Path, Declared], Capture]


@dataclass(frozen=True)
class Format:
    """A format: its name and title, the ends of its files' names, the mark they begin with, its reader."""

    name: str
    title: str
    suffixes: tuple[str, ...]
    begins: Callable[[bytes], bool]
    read: Reader


def _starts(*marks: bytes) -> Callable[[bytes], bool]:
    return lambda head: head.removeprefix(b"\xef\xbb\xbf").startswith(marks)


def _is_c3d(head: bytes) -> bool:
    return len(head) > 1 and head[1] == 0x50 and 2 <= head[0] <= 8


def _never(_: bytes) -> bool:
    return False


FORMATS = (
    Format(c3d.NAME, c3d.TITLE, (".c3d",), _is_c3d, c3d.read),
    Format(qtm.NAME, qtm.TITLE, (".tsv",), _starts(b"NO_OF_", b"FILE_VERSION\t", b"Frame\tTime\t"), qtm.read),
    Format(
        nexus.NAME,
        nexus.TITLE,
        (".csv",),
        _starts(*(f"{name}{end}".encode() for name in nexus.SECTIONS for end in (",", "\r", "\n"))),
        nexus.read,
    ),
    Format(motive.NAME, motive.TITLE, (".csv",), _starts(b"Format Version,"), motive.read),
    Format(trc.NAME, trc.TITLE, (".trc",), _starts(b"PathFileType"), trc.read),
    Format(bvh.NAME, bvh.TITLE, (".bvh",), _starts(b"HIERARCHY"), bvh.read),
    Format(bags.MCAP, "MCAP", (".mcap",), _starts(b"\x89MCAP"), bags.read_mcap),
    Format(bags.BAG, "ROS 1 bag", (".bag",), _starts(b"#ROSBAG"), bags.read_rosbag1),
    Format(bags.BAG2, "ROS 2 bag", (".db3",), _starts(b"SQLite format 3"), bags.read_rosbag2),
    Format(npz.NAME, npz.TITLE, (".npz",), _starts(b"PK\x03\x04"), npz.read),
    Format(plain.NAME, plain.TITLE, (".csv", ".tsv"), _never, plain.read),
)
"""The last of those that share an end of name is the one without a mark."""

NOT_READ = {
    ".n3d": "NDI Optotrak N3D files are not read; export C3D from NDI First Principles instead",
}
"""Ends of names of formats that labs have, and what to do."""


def format_of(path: Path) -> Format:
    """Return the format of a file, or of a ROS 2 bag's folder. Raises UnknownFormat, NotRead, Unreadable."""
    suffix = path.suffix.lower()
    if suffix in NOT_READ:
        raise NotRead(NOT_READ[suffix])
    try:
        if path.is_dir():
            head = b"SQLite format 3" if (path / "metadata.yaml").is_file() else b""
        elif path.exists() and not path.is_file():
            raise Unreadable("", "is no regular file", path.name)
        else:
            with path.open("rb") as file:
                head = file.read(HEAD)
    except OSError as error:
        raise Unreadable("", error.strerror or "cannot be opened", path.name) from error
    marked = [known for known in FORMATS if known.begins(head)]
    named = [known for known in FORMATS if suffix in known.suffixes]
    if not marked and not named:
        known = ", ".join(f"{known.title} ({' '.join(known.suffixes)})" for known in FORMATS)
        raise UnknownFormat(f"{path.name or path} is in no format that is known: {known}")
    return marked[0] if marked else named[-1]


def read(path: Path, declared: Declared = Declared()) -> Capture:
    """Return the recording in a file, here and now; ``isolation.read_apart`` is for files of strangers.

    Raises FormatError.
    """
    known = format_of(path)
    try:
        with np.errstate(all="ignore"):  # what overflows is refused by name
            return known.read(path, declared)
    except Unreadable as error:
        raise Unreadable(error.place, error.reason, path.name) from error
    except MemoryError as error:
        raise Unreadable("", "does not fit into memory", path.name) from error
