"""Messages have the fields that ROS 2 defines, and the numbers of the movement."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from app.formats import ros
from app.formats.definitions import DEFINITIONS, definition
from app.motion.timing import DURATIONS, MAX_FRAMES, RATES
from tests.formats.controller import faults
from tests.formats.motions import minimum_jerk

TURNED = (0.0, 0.6, 0.0, 0.8)
SHIPPED = {store: get_typestore(store) for store in (Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY)}
"""The messages of two distributions of ROS 2, as the independent library ``rosbags`` knows them."""

BASES = {"float64": float, "int32": int, "uint32": int, "string": str}

lengths = st.integers(2, 300)
rates = st.floats(*RATES)
seeds = st.integers(0, 2**32 - 1)


def misfits(store: Stores, name: str, value: Any, place: str = "") -> Iterator[str]:
    """Yield where plain data is not what a message consists of."""
    fields: Any = SHIPPED[store].fielddefs[name][1]
    if list(value) != [field for field, _ in fields]:
        yield f"{place}: {list(value)}"
        return
    for field, (kind, of) in fields:
        inner, type_ = of[0] if kind == Nodetype.SEQUENCE else (kind, of)
        for item in value[field] if kind == Nodetype.SEQUENCE else [value[field]]:
            if inner == Nodetype.NAME:
                yield from misfits(store, type_, item, f"{place}/{field}")
            elif type(item) is not BASES[type_[0]]:
                yield f"{place}/{field}: {item!r} is no {type_[0]}"


@pytest.mark.parametrize("store", SHIPPED)
def test_fields_are_those_of_ros(store: Stores) -> None:
    motion = minimum_jerk()
    trajectory = ros.multi_dof_joint_trajectory(motion, "world", TURNED)
    assert list(misfits(store, "trajectory_msgs/msg/MultiDOFJointTrajectory", trajectory)) == []
    assert list(misfits(store, "nav_msgs/msg/Path", ros.path(motion, "world", TURNED))) == []
    for transform in ros.transforms(motion, "world", TURNED):
        assert list(misfits(store, "tf2_msgs/msg/TFMessage", transform)) == []


def test_what_is_no_message_of_ros_is_found() -> None:
    message = ros.path(minimum_jerk(2), "world")
    message["poses"][1]["pose"]["position"] = {"x": 0.0, "y": 0, "z": 0.0}
    del message["poses"][0]["header"]["frame_id"]
    assert list(misfits(Stores.ROS2_JAZZY, "nav_msgs/msg/Path", message)) == [
        "/poses/header: ['stamp']",
        "/poses/pose/position/y: 0 is no float64",
    ]


@pytest.mark.parametrize("store", SHIPPED)
@pytest.mark.parametrize("name", DEFINITIONS)
def test_definitions_are_those_of_ros(store: Stores, name: str) -> None:
    package, type_ = name.split("/")
    assert definition(name) == SHIPPED[store].generate_msgdef(f"{package}/msg/{type_}", ros_version=2)[0]


@given(lengths, rates, seeds)
def test_a_trajectory_has_the_numbers_of_the_movement(n_frames: int, rate: float, seed: int) -> None:
    motion = minimum_jerk(n_frames, rate, seed)
    message = ros.multi_dof_joint_trajectory(motion, "table", TURNED)
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "table"}
    for at, point in enumerate(message["points"]):
        ([transform], [velocity], [acceleration]) = (
            point[field] for field in ("transforms", "velocities", "accelerations")
        )
        assert [*transform["translation"].values()] == motion.positions[at].tolist()
        assert transform["rotation"] == {"x": 0.0, "y": 0.6, "z": 0.0, "w": 0.8}
        assert [*velocity["linear"].values()] == motion.velocities[at].tolist()
        assert [*acceleration["linear"].values()] == motion.accelerations[at].tolist()
        assert not any((*velocity["angular"].values(), *acceleration["angular"].values()))
    assert len(message["points"]) == n_frames


@given(lengths, rates, seeds)
def test_a_path_and_its_transforms_lie_on_the_movement(n_frames: int, rate: float, seed: int) -> None:
    motion = minimum_jerk(n_frames, rate, seed)
    message = ros.path(motion, "table")
    transforms = ros.transforms(motion, "table")
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "table"}
    for pose, move, position in zip(message["poses"], transforms, motion.positions, strict=True):
        [transform] = move["transforms"]
        assert transform["child_frame_id"] == ros.HAND
        assert transform["header"] == pose["header"]
        assert transform["transform"]["translation"] == pose["pose"]["position"]
        assert transform["transform"]["rotation"] == pose["pose"]["orientation"]
        assert pose["pose"]["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
        assert [*pose["pose"]["position"].values()] == position.tolist()


@given(lengths, rates, seeds)
def test_a_controller_takes_it(n_frames: int, rate: float, seed: int) -> None:
    message = ros.multi_dof_joint_trajectory(minimum_jerk(n_frames, rate, seed), "world")
    assert faults(message) == []
    assert not any(message["points"][-1]["velocities"][0]["linear"].values())


def test_a_movement_that_does_not_end_at_rest_is_not_made_to() -> None:
    motion = minimum_jerk()
    motion.velocities[-1, 1] = 0.25
    message = ros.multi_dof_joint_trajectory(motion, "world")
    assert message["points"][-1]["velocities"][0]["linear"]["y"] == 0.25
    assert faults(message) == ["still moves at the end, at 0.25 m/s"]


@given(rates, st.floats(*DURATIONS))
def test_nanoseconds_increase_with_time(rate: float, duration: float) -> None:
    times = np.arange(min(int(rate * duration) + 2, MAX_FRAMES)) / rate
    rounded = np.array(ros.nanoseconds(times))
    assert rounded[0] == 0
    assert np.diff(rounded).min() > 0
    assert np.abs(rounded - times * 1e9).max() <= 0.5


@given(st.lists(st.integers(0, 600 * 10**9), min_size=2, max_size=50, unique=True).map(sorted))
def test_times_a_nanosecond_apart_stay_apart(stamps: list[int]) -> None:
    assert ros.nanoseconds(np.array(stamps) / 1e9) == stamps


def test_times_are_seconds_and_nanoseconds_of_the_same_moment() -> None:
    motion = minimum_jerk(n_frames=2500, rate=999.0)
    points = ros.multi_dof_joint_trajectory(motion, "world")["points"]
    times = [point["time_from_start"] for point in points]
    stamps = [pose["header"]["stamp"] for pose in ros.path(motion, "world")["poses"]]
    assert times == stamps
    assert [time["sec"] * 10**9 + time["nanosec"] for time in times] == ros.nanoseconds(motion.times)
    assert max(time["nanosec"] for time in times) < 10**9


def test_messages_are_json() -> None:
    message = ros.multi_dof_joint_trajectory(minimum_jerk(), "world")
    assert json.loads(json.dumps(message, allow_nan=False)) == message
