"""BVH (Biovision hierarchy): a skeleton and its angles, of which the places of the joints are worked out.

A joint's coordinate system lies at its offset, moved by its position channels, in that of its parent, and is
turned by its rotation channels in the order in which they stand, each about the axes that the one before has
turned. Neither length unit nor up axis is written down.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.formats.capture import Capture, Declared, distinct, resolve, said_and_found, timeline
from app.formats.errors import Unreadable
from app.formats.sheet import read_text

if TYPE_CHECKING:
    from app.motion.trajectory import Floats

NAME, TITLE = "bvh", "BVH"

AXES = ("X", "Y", "Z")
KINDS = ("position", "rotation")

Line = tuple[int, list[str]]
"""Number of a line, and its words."""


@dataclass
class Joint:
    """A joint: index of its parent (-1: none), offset in its parent's system, channels in order."""

    name: str
    parent: int
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    channels: tuple[str, ...] = ()


def read(path: Path, declared: Declared) -> Capture:
    """Return the recording in a file. Raises FormatError."""
    geometry = resolve(TITLE, declared)
    numbered = enumerate(read_text(path).splitlines(), start=1)
    lines = iter([(number, words) for number, line in numbered if (words := line.split())])
    joints = _hierarchy(lines)
    said, period = (_after(next(lines, None), key) for key in ("Frames:", "Frame Time:"))
    width = sum(len(joint.channels) for joint in joints)
    rows = [_numbers(line, width) for line in lines]
    if not rows or not joints:
        raise Unreadable("", "has no frames")
    if not 0 < period < np.inf:
        raise Unreadable("Frame Time", f"{period:g} is no positive number of seconds")
    places = geometry.to_metres(_places(joints, np.array(rows)))
    frames, rate = np.arange(1, len(rows) + 1), 1.0 / period
    names = distinct([joint.name for joint in joints])
    return Capture(
        NAME,
        timeline(frames, rate, None, first=1),
        frames,
        {name: places[at] for at, name in enumerate(names)},
        rate,
        notes=said_and_found("frames", said, len(rows)),
    )


def _hierarchy(lines: Iterator[Line]) -> list[Joint]:
    """Return the joints, each after its parent; the lines go on after MOTION. End sites are no joints."""
    joints: list[Joint] = []
    open_joints: list[int | None] = []
    current: int | None = None
    for number, words in lines:
        match words:
            case ["MOTION"]:
                return joints
            case ["ROOT" | "JOINT", *name]:
                parent = open_joints[-1] if open_joints else -1
                if parent is None:
                    raise Unreadable(f"line {number}", "an end site has no joints")
                joints.append(Joint(" ".join(name).removesuffix("{").strip(), parent))
                current = len(joints) - 1
            case ["End", *_]:
                current = None
            case ["}"] if open_joints:
                open_joints.pop()
            case ["OFFSET", *_] if current is not None:
                joints[current].offset = tuple(_numbers((number, words[1:]), 3))
            case ["CHANNELS", _, *channels] if current is not None:
                joints[current].channels = tuple(_channel(number, channel) for channel in channels)
            case ["HIERARCHY"] | ["{"] | ["OFFSET", *_]:
                pass
            case _:
                raise Unreadable(f"line {number}", f"{' '.join(words)[:40]!r} is unknown in a hierarchy")
        if words[-1] == "{":
            open_joints.append(current)
    raise Unreadable("", "ends before MOTION")


def _channel(number: int, channel: str) -> str:
    if channel[:1] not in AXES or channel[1:] not in KINDS:
        raise Unreadable(
            f"line {number}", f"channel {channel!r} is neither Xposition nor Xrotation nor the like"
        )
    return channel


def _after(line: Line | None, key: str) -> float:
    """Return the number in ``Frames: 69`` or ``Frame Time: 0.01``."""
    number, words = line or (0, [])
    text = " ".join(words)
    if not text.startswith(key):
        raise Unreadable(f"line {number}", f"needs {key!r} after MOTION")
    [value] = _numbers((number, [text.removeprefix(key).strip()]), 1)
    return value


def _numbers(line: Line, count: int) -> list[float]:
    number, words = line
    if len(words) != count:
        raise Unreadable(f"line {number}", f"has {len(words)} numbers, needs {count}")
    try:
        return [float(word) for word in words]
    except ValueError as error:
        raise Unreadable(f"line {number}", str(error)) from error


def _places(joints: list[Joint], rows: Floats) -> Floats:
    """Return where joints are, (n_joints, n_frames, 3), by the channels' values (n_frames, n_channels)."""
    places = np.empty((len(joints), len(rows), 3))
    turned: list[Floats] = []
    at = 0
    for index, joint in enumerate(joints):
        move = np.tile(joint.offset, (len(rows), 1))
        turn = np.broadcast_to(np.eye(3), (len(rows), 3, 3))
        for channel in joint.channels:
            axis, values = AXES.index(channel[0]), rows[:, at]
            if channel[1:] == "position":
                move[:, axis] += values
            else:
                turn = turn @ _rotation(axis, np.radians(values))
            at += 1
        if joint.parent >= 0:
            move = places[joint.parent] + np.einsum("nij,nj->ni", turned[joint.parent], move)
            turn = turned[joint.parent] @ turn
        places[index] = move
        turned.append(turn)
    return places


def _rotation(axis: int, angles: Floats) -> Floats:
    """Return the rotations (n, 3, 3) about an axis by angles (n,) [rad]."""
    turn = np.zeros((len(angles), 3, 3))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turn[:, axis, axis] = 1.0
    turn[:, first, first] = turn[:, second, second] = np.cos(angles)
    turn[:, second, first] = np.sin(angles)
    turn[:, first, second] = -turn[:, second, first]
    return turn
