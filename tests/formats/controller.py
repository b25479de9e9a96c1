"""What a controller has against a trajectory.

The rules are those by which ``joint_trajectory_controller`` of ros2_controllers accepts a goal
(``validate_trajectory_msg``), applied to the x, y and z of the joint as a controller of three prismatic
joints is given them, and that every number is finite and every time is one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

Message = dict[str, Any]

CONTROLLED = ("hand",)

STANDSTILL = float(np.finfo(np.float32).eps)
"""A velocity up to this is zero to the controller."""


def faults(message: Message, *, allow_nonzero_velocity_at_trajectory_end: bool = False) -> list[str]:
    """Return what a controller has against a ``trajectory_msgs/MultiDOFJointTrajectory``, at best nothing."""
    points = [_flat(point) for point in message["points"]]
    times = [point["time_from_start"] for point in message["points"]]
    found = [*_of_the_whole(message, len(points)), *_of_times(times)]
    n_joints = 3 * len(message["joint_names"])
    for at, point in enumerate(points):
        found += [f"points[{at}]: {fault}" for fault in _of_a_point(point, n_joints)]
    if points and not allow_nonzero_velocity_at_trajectory_end:
        fastest = max(map(abs, points[-1]["velocities"]), default=0.0)
        found += [f"still moves at the end, at {fastest} m/s"] * (fastest > STANDSTILL)
    return found


def _flat(point: Message) -> dict[str, list[float]]:
    """Return the values of a point by the fields of ``trajectory_msgs/JointTrajectoryPoint``."""
    return {
        "positions": [value for each in point["transforms"] for value in each["translation"].values()],
        "velocities": [value for each in point["velocities"] for value in each["linear"].values()],
        "accelerations": [value for each in point["accelerations"] for value in each["linear"].values()],
        "effort": list(point.get("effort", [])),
    }


def _of_the_whole(message: Message, n_points: int) -> Iterator[str]:
    joints = message["joint_names"]
    if not joints:
        yield "no joint names"
    elif len(joints) != len(CONTROLLED):
        yield f"{len(joints)} joints, not {len(CONTROLLED)}"
    yield from (f"joint {joint!r} is not the controller's" for joint in joints if joint not in CONTROLLED)
    if any(message["header"]["stamp"].values()):
        yield "the stamp is not zero, so the trajectory was over long ago"
    if not n_points:
        yield "no points"


def _of_times(times: list[Message]) -> Iterator[str]:
    for at, time in enumerate(times):
        if not 0 <= time["nanosec"] < 1_000_000_000 or not -(2**31) <= time["sec"] < 2**31:
            yield f"points[{at}]: {time} is no time"
        elif time["sec"] < 0:
            yield f"points[{at}]: {time} lies before the start"
    stamps = [1_000_000_000 * time["sec"] + time["nanosec"] for time in times]
    for at, (before, after) in enumerate(pairwise(stamps)):
        if after <= before:
            yield f"points[{at + 1}]: time does not increase, from {before} to {after} ns"


def _of_a_point(point: dict[str, list[float]], n_joints: int) -> Iterator[str]:
    for field in ("positions", "velocities", "accelerations"):
        values = point[field]
        if len(values) != n_joints and (values or field == "positions"):
            yield f"{len(values)} {field} for {n_joints} joints"
        if not all(map(math.isfinite, values)):
            yield f"{field} are not finite"
    if point["effort"]:
        yield "effort is not supported"
