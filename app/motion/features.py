"""Goal-directed features of a movement and their inverse (Sec. III-A of the paper).

A movement from ``start`` to ``goal`` is described, frame by frame, by

- columns 0..2: its *deviation* [m]: the aligned position minus the point of the straight start-goal line
  sampled at regular intervals;
- column 3: the height of the hand over the table [m];
- columns 4..: the distance of the hand to each object [m].

The **alignment** is the rotation that lays the goal on the first axis. The roll about that axis is free in
space; the third axis stays in the plane of the movement and up. Where the movement is shorter than
``BLEND`` its direction means nothing, and where it is vertical its heading does; both are blended into a
fixed heading there, so that features stay continuous when a movement shrinks to nothing or turns upright.
Beyond ``BLEND`` the alignment is exact and turns with the world about up.
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


@njit(cache=True, nogil=True)
def alignment(start: Floats, goal: Floats) -> Floats:
    """Return the (3, 3) rotation whose rows are the aligned axes: ``aligned = rotation @ world``.

    start, goal: (3,) [m].
    """
    x, y, z = goal[0] - start[0], goal[1] - start[1], goal[2] - start[2]
    length, level = np.sqrt(x * x + y * y + z * z), np.sqrt(x * x + y * y)
    along_x = x + max(0.0, BLEND - length)
    scale = 1.0 / max(np.sqrt(along_x * along_x + y * y + z * z), 1e-300)
    ax, ay, az = along_x * scale, y * scale, z * scale
    heading_x = x + max(0.0, BLEND - level)
    scale = 1.0 / max(np.sqrt(heading_x * heading_x + y * y), 1e-300)
    hx, hy = heading_x * scale, y * scale
    # Sideways is level and square to the heading, then made square to the first axis.
    overlap = ay * hx - ax * hy
    sx, sy, sz = -hy - overlap * ax, hx - overlap * ay, -overlap * az
    scale = 1.0 / max(np.sqrt(sx * sx + sy * sy + sz * sz), 1e-300)
    sx, sy, sz = sx * scale, sy * scale, sz * scale
    rotation = np.empty((3, 3))
    rotation[0, 0], rotation[0, 1], rotation[0, 2] = ax, ay, az
    rotation[1, 0], rotation[1, 1], rotation[1, 2] = sx, sy, sz
    rotation[2, 0] = ay * sz - az * sy
    rotation[2, 1] = az * sx - ax * sz
    rotation[2, 2] = ax * sy - ay * sx
    return rotation


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
