"""A reader's process with readers that misbehave, by the name of the file they are given."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from app.formats import apart, reading
from app.formats.capture import Capture, Declared


def small(*notes: str) -> Capture:
    return Capture("hostile", np.arange(2.0), np.arange(2), {"hand": np.zeros((2, 3))}, notes=notes)


def loop(_: Path) -> Capture:
    while True:
        pass


def sleep(_: Path) -> Capture:
    time.sleep(60)
    return small()


def allocate(_: Path) -> Capture:
    blocks = []
    while True:
        blocks.append(bytearray(64 << 20))


def die(_: Path) -> Capture:
    os.kill(os.getpid(), signal.SIGSEGV)
    return small()


def leave(_: Path) -> Capture:
    os._exit(3)


def large(_: Path) -> Capture:
    n_frames = 200_000
    return Capture(
        "hostile", np.arange(float(n_frames)), np.arange(n_frames), {"hand": np.zeros((n_frames, 3))}
    )


def fill(path: Path) -> Capture:
    path.with_suffix(".more").write_bytes(bytes(8 << 20))
    return small()


def chatter(_: Path) -> Capture:
    os.write(1, b"chatter" * 1000)
    print("chatter", flush=True)
    return small()


def forge(_: Path) -> Capture:
    os._exit(0)


def environment(_: Path) -> Capture:
    return small(*sorted(os.environ))


BEHAVIOURS: tuple[Callable[[Path], Capture], ...] = (
    loop,
    sleep,
    allocate,
    die,
    leave,
    large,
    fill,
    chatter,
    forge,
    environment,
)


def read(path: Path, declared: Declared = Declared()) -> Capture:
    return {behaviour.__name__: behaviour for behaviour in BEHAVIOURS}[path.stem](path)


if __name__ == "__main__":
    reading.read = read
    sys.exit(apart.main(sys.argv[1:]))
