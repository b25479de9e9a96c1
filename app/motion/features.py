"""Goal-directed features of a movement and their inverse (Sec. III-A of the paper).

A movement from ``start`` to ``goal`` is described, frame by frame, by

- columns 0..2: its *deviation* [m]: the aligned position minus the point of the straight start-goal line
  sampled at regular intervals;
- column 3: the height of the hand over the table [m];
- columns 4..: the distance of the hand to each object [m].

The **alignment** is the rotation that lays the goal on the first axis. The roll about that axis is free in
space; the third axis stays in the plane of the movement and up. Where the movement is shorter than
``BLEND`` its direction means nothing, and where it is vertical its heading does; both are blended into a
fixed heading, the world's first axis, so that features stay continuous when a movement shrinks to nothing
or turns upright. Beyond ``BLEND`` the alignment is exact and turns with the world about up. No alignment
can do both without one place where it flips: it lies half of ``BLEND`` against the fixed heading, where a
blend is nothing and the fixed heading stands in for it.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from app.motion.errors import InvalidTrajectory
from app.motion.trajectory import Floats

N_DEVIATIONS = 3
"""Columns that tell the shape of the movement; those behind them tell its context."""

BLEND = 5e-3
"""Length below which a movement's direction, or its heading, is blended into a fixed one [m]."""

_NOTHING = 1e-12  # a vector shorter than this has no direction [m]


Axis = tuple[float, float, float]


def alignment(start: Floats, goal: Floats) -> Floats:
    """Return the (3, 3) rotation whose rows are the aligned axes: ``aligned = rotation @ world``.

    start, goal: (3,) [m].
    """
    return np.array(axes(goal[0] - start[0], goal[1] - start[1], goal[2] - start[2]))


@njit(cache=True, nogil=True)
def axes(x: float, y: float, z: float) -> tuple[Axis, Axis, Axis]:
    """Return the aligned axes of a movement that goes (x, y, z) [m]."""
    length, level = np.sqrt(x * x + y * y + z * z), np.sqrt(x * x + y * y)
    ax, ay, az = _direction(x + max(0.0, BLEND - length), y, z)
    hx, hy, _ = _direction(x + max(0.0, BLEND - level), y, 0.0)
    # Sideways is level and square to the heading, then made square to the first axis.
    overlap = ay * hx - ax * hy
    sx, sy, sz = _direction(-hy - overlap * ax, hx - overlap * ay, -overlap * az)
    return (ax, ay, az), (sx, sy, sz), (ay * sz - az * sy, az * sx - ax * sz, ax * sy - ay * sx)


@njit(cache=True, nogil=True)
def _direction(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the unit vector along (x, y, z), the first axis where that is nothing."""
    length = np.sqrt(x * x + y * y + z * z)
    if length < _NOTHING:
        return 1.0, 0.0, 0.0
    return x / length, y / length, z / length


def encode(hand: Floats, objects: Floats, table_height: float) -> Floats:
    """Return the (n_frames, 4 + n_objects) features [m] of one movement.

    hand: (n_frames, 3) [m], its first and last frame are start and goal; objects: (n_objects, n_frames, 3)
    [m]; table_height [m]. Dropouts stay NaN. Raises InvalidTrajectory where an end point is a dropout.
    """
    for frame in (0, len(hand) - 1):
        if len(hand) == 0 or np.isnan(hand[frame]).any():
            raise InvalidTrajectory("hand", frame, "an end point of a movement must not be a dropout")
    deviation = (hand - line(hand[0], hand[-1], len(hand))) @ alignment(hand[0], hand[-1]).T
    distances = np.linalg.norm(objects - hand, axis=2)
    return np.column_stack([deviation, hand[:, 2] - table_height, *distances])


def decode(deviation: Floats, start: Floats, goal: Floats) -> Floats:
    """Return the (n_frames, 3) positions [m] that deviate so from the line start-goal; inverts ``encode``.

    deviation: (n_frames, 3) [m]; start, goal: (3,) [m].
    """
    return line(start, goal, len(deviation)) + deviation @ alignment(start, goal)


def line(start: Floats, goal: Floats, n_frames: int) -> Floats:
    """Return (n_frames, 3) points at regular intervals from start to goal, both met exactly [m]."""
    fraction = np.linspace(0.0, 1.0, n_frames)[:, None]
    return start * (1.0 - fraction) + goal * fraction
