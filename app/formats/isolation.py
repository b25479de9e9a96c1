"""Readers in a process of their own: what a hostile file does to one, it does to nobody else.

The process has limits on processor time, memory, what it writes and time by the clock, and none of this
one's environment. What it makes of the file comes back as JSON and plain numbers (``app.formats.apart``).
"""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from dataclasses import dataclass
from os import EX_IOERR, EX_UNAVAILABLE
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import IO, Any

import numpy as np

from app.formats.apart import LENGTH
from app.formats.capture import Capture, Declared, Label
from app.formats.errors import (
    FormatError,
    NotRead,
    ReaderStopped,
    UndeclaredGeometry,
    UnknownFormat,
    Unreadable,
)

HOUSE = Path(__file__).parents[2]
ENVIRONMENT = {"PYTHONPATH": str(HOUSE), "LC_ALL": "C.UTF-8", "OPENBLAS_NUM_THREADS": "1"}
"""Where the house is; UTF-8; one thread, since every thread reserves memory."""

ERRORS: dict[str, type[FormatError]] = {
    kind.__name__: kind for kind in (UnknownFormat, NotRead, Unreadable, UndeclaredGeometry)
}
"""What a reader may say."""

MIB = 1 << 20
LONGEST_NAME = 60
"""Characters of a file's name, of four bytes at most."""

PROGRAM = "app.formats.apart"


@dataclass(frozen=True)
class Limits:
    """What a reader may use: processor time and time by the clock [s], memory and what it writes [bytes]."""

    processor_s: int = 30
    wall_s: float = 60.0
    memory: int = 4096 * MIB
    output: int = 1024 * MIB


def read_apart(path: Path, declared: Declared = Declared(), limits: Limits = Limits()) -> Capture:
    """Return the recording in a file, or a ROS 2 bag's folder, as a process of its own reads it.

    Raises FormatError.
    """
    with TemporaryFile() as out:
        status = _run(path.absolute(), declared, limits, out)
        if status:
            raise ReaderStopped(f"{path.name}: {_why(status, limits)}")
        out.seek(0)
        return _answer(out)


def read_content_apart(
    content: bytes, name: str, declared: Declared = Declared(), limits: Limits = Limits()
) -> Capture:
    """Return the recording in the content of a file that its sender calls ``name``. Raises FormatError."""
    plain = re.sub(r"[^\w.\- ]", "_", Path(name).name)[-LONGEST_NAME:].lstrip(".") or "recording"
    with TemporaryDirectory(prefix="gesta-") as folder:
        path = Path(folder) / plain
        path.write_bytes(content)
        return read_apart(path, declared, limits)


def _run(path: Path, declared: Declared, limits: Limits, out: IO[bytes]) -> int:
    """Return how the process ended: 0, its exit code, or less a signal."""
    most = {
        "RLIMIT_CPU": (limits.processor_s, limits.processor_s + 1),
        "RLIMIT_AS": (limits.memory, limits.memory),
        "RLIMIT_FSIZE": (limits.output, limits.output),
        "RLIMIT_CORE": (0, 0),
    }
    said = json.dumps([declared.length_unit, declared.up_axis])
    command = [sys.executable, "-P", "-m", PROGRAM, str(path), said, json.dumps(most)]
    try:
        return subprocess.run(  # noqa: S603 (the program is this one)
            command,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=subprocess.DEVNULL,
            cwd="/",
            env=ENVIRONMENT,
            timeout=limits.wall_s,
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        raise ReaderStopped(f"{path.name}: took longer than {limits.wall_s:g} s to read") from None


def _why(status: int, limits: Limits) -> str:
    if status == -signal.SIGXCPU:
        return f"took more than {limits.processor_s} s of processor time to read"
    if status == EX_UNAVAILABLE:
        return f"takes more than {limits.memory // MIB} MiB of memory to read"
    if status in (EX_IOERR, -signal.SIGXFSZ):
        return f"is more than {limits.output // MIB} MiB when read"
    how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
    return f"the reader {how}: the file is damaged, or takes more than {limits.memory // MIB} MiB of memory"


def _answer(out: IO[bytes]) -> Capture:
    """Return what the process wrote, or raise it. Raises FormatError."""
    try:
        header: dict[str, Any] = json.loads(out.read(int.from_bytes(out.read(LENGTH), "little")))
        if "error" in header:
            refusal = ERRORS[header["error"]](*header["arguments"])
        else:
            return _capture(header, out)
    except (KeyError, TypeError, ValueError) as error:
        raise ReaderStopped(f"the reader's answer cannot be read: {error}") from error
    raise refusal


def _capture(header: dict[str, Any], out: IO[bytes]) -> Capture:
    n_frames = header["n_frames"]
    times, frames = (np.frombuffer(out.read(8 * n_frames), kind) for kind in ("<f8", "<i8"))
    tracks = {
        name: np.frombuffer(out.read(24 * n_frames), "<f8").reshape(n_frames, 3) for name in header["tracks"]
    }
    return Capture(
        header["format"],
        times,
        frames,
        tracks,
        header["rate"],
        labels=tuple(Label(*label) for label in header["labels"]),
        notes=tuple(header["notes"]),
        systems=header["systems"],
    )
