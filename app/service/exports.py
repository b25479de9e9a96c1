"""A generated trajectory in the formats of the field, for a robot or a viewer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from app.formats import bag, ros
from app.formats.table import csv
from app.motion.errors import InvalidRequest
from app.motion.generation import GeneratedMotion

WORLD = "world"
"""The coordinate frame that a trajectory is in where none is named."""

MAX_BAG = 20_000
"""Frames that are put into a bag: more would hold the server up for seconds."""

__all__ = ["WORLD", "Pose", "csv"]


@dataclass(frozen=True)
class Pose:
    """What a robot needs to know beside the positions: their coordinate frame, and how the hand is turned.

    orientation: x, y, z, w of a unit quaternion.
    """

    frame_id: str
    orientation: ros.Quaternion

    @classmethod
    def of(cls, frame_id: str | None, orientation: Sequence[float] | None) -> Self:
        """Return the pose asked for. Raises InvalidRequest for what is no unit quaternion."""
        if orientation is None:
            return cls(frame_id or WORLD, ros.UNTURNED)
        x, y, z, w = orientation
        norm = float(np.linalg.norm(orientation))
        if abs(norm - 1.0) > 1e-3:
            detail = f"must be a unit quaternion x, y, z, w; its norm is {norm:.4g}"
            raise InvalidRequest("orientation", detail)
        return cls(frame_id or WORLD, (x / norm, y / norm, z / norm, w / norm))

    def path(self, motion: GeneratedMotion) -> ros.Message:
        """Return a movement as ``nav_msgs/Path``."""
        return ros.path(motion, self.frame_id, self.orientation)

    def trajectory(self, motion: GeneratedMotion) -> ros.Message:
        """Return a movement as ``trajectory_msgs/MultiDOFJointTrajectory``."""
        return ros.multi_dof_joint_trajectory(motion, self.frame_id, self.orientation)

    def bag(self, motion: GeneratedMotion) -> bytes:
        """Return a movement as MCAP file. Raises InvalidRequest for one of too many frames."""
        if len(motion.times) > MAX_BAG:
            detail = f"gives {len(motion.times)} frames, a bag may have {MAX_BAG}"
            raise InvalidRequest("rate", detail)
        return bag.mcap(motion, self.frame_id, self.orientation)
