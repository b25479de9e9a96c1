"""The controller's rules find what is wrong with a trajectory, each its own fault."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from app.formats.ros import multi_dof_joint_trajectory
from tests.formats.controller import STANDSTILL, faults
from tests.formats.motions import minimum_jerk

Message = dict[str, Any]


@pytest.fixture
def message() -> Message:
    return multi_dof_joint_trajectory(minimum_jerk(), "world")


def _nothing(message: Message) -> None:
    pass


def _lower_bound(message: Message) -> None:
    message["points"][-1]["velocities"][0]["linear"]["y"] = -STANDSTILL


def _only_positions(message: Message) -> None:
    for point in message["points"]:
        point["velocities"], point["accelerations"] = [], []


def _one_point(message: Message) -> None:
    del message["points"][:-1]


@pytest.mark.parametrize("change", [_nothing, _lower_bound, _only_positions, _one_point])
def test_a_sound_trajectory_has_no_faults(message: Message, change: Callable[[Message], None]) -> None:
    change(message)
    assert faults(message) == []


def _no_points(message: Message) -> None:
    message["points"].clear()


def _no_joints(message: Message) -> None:
    message["joint_names"].clear()
    for point in message["points"]:
        point["transforms"], point["velocities"], point["accelerations"] = [], [], []


def _a_strange_joint(message: Message) -> None:
    message["joint_names"] = ["foot"]


def _two_joints(message: Message) -> None:
    message["joint_names"] *= 2
    for point in message["points"]:
        for field in ("transforms", "velocities", "accelerations"):
            point[field] *= 2


def _a_time_of_day(message: Message) -> None:
    message["header"]["stamp"]["sec"] = 1


def _a_time_twice(message: Message) -> None:
    message["points"][7]["time_from_start"] = message["points"][6]["time_from_start"]


def _a_time_before_the_start(message: Message) -> None:
    message["points"][0]["time_from_start"] = {"sec": -1, "nanosec": 0}


def _too_many_nanoseconds(message: Message) -> None:
    message["points"][-1]["time_from_start"] = {"sec": 0, "nanosec": 1_000_000_000}


def _no_position(message: Message) -> None:
    message["points"][3]["transforms"] = []


def _two_velocities(message: Message) -> None:
    message["points"][3]["velocities"] *= 2


def _two_accelerations(message: Message) -> None:
    message["points"][3]["accelerations"] *= 2


def _an_effort(message: Message) -> None:
    message["points"][3]["effort"] = [0.0, 0.0, 0.0]


def _no_number(message: Message) -> None:
    message["points"][3]["velocities"][0]["linear"]["z"] = math.nan


def _no_finite_number(message: Message) -> None:
    message["points"][3]["transforms"][0]["translation"]["x"] = math.inf


def _a_moving_end(message: Message) -> None:
    message["points"][-1]["velocities"][0]["linear"]["y"] = -2 * STANDSTILL


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (_no_points, "no points"),
        (_no_joints, "no joint names"),
        (_a_strange_joint, "joint 'foot' is not the controller's"),
        (_two_joints, "2 joints, not 1"),
        (_a_time_of_day, "the stamp is not zero, so the trajectory was over long ago"),
        (_a_time_twice, "points[7]: time does not increase, from 60000000 to 60000000 ns"),
        (_a_time_before_the_start, "points[0]: {'sec': -1, 'nanosec': 0} lies before the start"),
        (_too_many_nanoseconds, "points[49]: {'sec': 0, 'nanosec': 1000000000} is no time"),
        (_no_position, "points[3]: 0 positions for 3 joints"),
        (_two_velocities, "points[3]: 6 velocities for 3 joints"),
        (_two_accelerations, "points[3]: 6 accelerations for 3 joints"),
        (_an_effort, "points[3]: effort is not supported"),
        (_no_number, "points[3]: velocities are not finite"),
        (_no_finite_number, "points[3]: positions are not finite"),
        (_a_moving_end, f"still moves at the end, at {2 * STANDSTILL} m/s"),
    ],
)
def test_each_rule_finds_its_fault(message: Message, change: Callable[[Message], None], fault: str) -> None:
    change(message)
    assert faults(message) == [fault]


def test_a_controller_may_let_a_trajectory_end_in_motion(message: Message) -> None:
    _a_moving_end(message)
    assert faults(message, allow_nonzero_velocity_at_trajectory_end=True) == []
