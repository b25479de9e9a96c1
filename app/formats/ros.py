"""A movement as ROS 2 messages: plain data in the shapes of their fields, ready for JSON or for CDR.

The hand moves without turning: its orientation is one unit quaternion for the whole movement, and its
angular velocities and accelerations are zero. Times are told from the start of the movement, in whole
nanoseconds; a stamp of zero in the header asks a controller to start at once. Numbers are written as they
are: whether the movement ends at rest, as controllers want it to, is up to whoever generated it. The
standard deviation has no place in these messages.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from app.formats.motion import Motion
from app.motion.trajectory import Floats

Message = dict[str, Any]

Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""

UNTURNED: Quaternion = (0.0, 0.0, 0.0, 1.0)

HAND = "hand"
"""The name of the joint that moves, and of its coordinate system."""


def nanoseconds(times: Floats) -> list[int]:
    """Return times (n,) [s], rounded [ns]."""
    rounded: list[int] = np.rint(times * 1e9).astype(np.int64).tolist()
    return rounded


def path(motion: Motion, frame_id: str, orientation: Quaternion = UNTURNED) -> Message:
    """Return the movement as ``nav_msgs/Path``, each pose stamped with its time from the start."""
    return {
        "header": _header(0, frame_id),
        "poses": [
            {
                "header": _header(at, frame_id),
                "pose": {"position": _vector(position), "orientation": _quaternion(orientation)},
            }
            for at, position in zip(nanoseconds(motion.times), motion.positions.tolist(), strict=True)
        ],
    }


def multi_dof_joint_trajectory(motion: Motion, frame_id: str, orientation: Quaternion = UNTURNED) -> Message:
    """Return the movement as ``trajectory_msgs/MultiDOFJointTrajectory`` of one joint, the hand."""
    points = zip(
        motion.positions.tolist(),
        motion.velocities.tolist(),
        motion.accelerations.tolist(),
        nanoseconds(motion.times),
        strict=True,
    )
    return {
        "header": _header(0, frame_id),
        "joint_names": [HAND],
        "points": [
            {
                "transforms": [_transform(position, orientation)],
                "velocities": [_twist(velocity)],
                "accelerations": [_twist(acceleration)],
                "time_from_start": _time(at),
            }
            for position, velocity, acceleration, at in points
        ],
    }


def transforms(motion: Motion, frame_id: str, orientation: Quaternion = UNTURNED) -> list[Message]:
    """Return n ``tf2_msgs/TFMessage``, one a frame: where the hand is, with respect to ``frame_id``."""
    return [
        {
            "transforms": [
                {
                    "header": _header(at, frame_id),
                    "child_frame_id": HAND,
                    "transform": _transform(position, orientation),
                }
            ]
        }
        for at, position in zip(nanoseconds(motion.times), motion.positions.tolist(), strict=True)
    ]


def _header(at: int, frame_id: str) -> Message:
    return {"stamp": _time(at), "frame_id": frame_id}


def _time(at: int) -> Message:
    """Return a time [ns] as ``builtin_interfaces/Time`` or ``Duration``, which have the same fields."""
    sec, nanosec = divmod(at, 1_000_000_000)
    return {"sec": sec, "nanosec": nanosec}


def _transform(position: Sequence[float], orientation: Quaternion) -> Message:
    return {"translation": _vector(position), "rotation": _quaternion(orientation)}


def _twist(linear: Sequence[float]) -> Message:
    return {"linear": _vector(linear), "angular": _vector((0.0, 0.0, 0.0))}


def _vector(xyz: Sequence[float]) -> Message:
    x, y, z = xyz
    return {"x": x, "y": y, "z": z}


def _quaternion(xyzw: Quaternion) -> Message:
    x, y, z, w = xyzw
    return {"x": x, "y": y, "z": z, "w": w}
