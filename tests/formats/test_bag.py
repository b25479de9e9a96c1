"""Bags read back what was written, by the format's own library and by an independent one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import Stores, get_typestore

from app.formats import ros
from app.formats.bag import mcap
from app.formats.definitions import definition
from app.motion.generation import GeneratedMotion
from tests.formats.motions import minimum_jerk

TURNED = (0.0, 0.6, 0.0, 0.8)
TYPES = {
    "/trajectory": "trajectory_msgs/msg/MultiDOFJointTrajectory",
    "/path": "nav_msgs/msg/Path",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/pose": "geometry_msgs/msg/PoseStamped",
}
FRAME_IDS = ["", "world", "a table, ä"]

Logged = tuple[str, int, Any]
"""Topic, time [ns], message."""


@pytest.fixture(scope="module")
def motion() -> GeneratedMotion:
    return minimum_jerk(n_frames=120, rate=60.0)


def expected(motion: GeneratedMotion, frame_id: str) -> Iterator[Logged]:
    path = ros.path(motion, frame_id, TURNED)
    yield "/trajectory", 0, ros.multi_dof_joint_trajectory(motion, frame_id, TURNED)
    yield "/path", 0, path
    transforms = ros.transforms(motion, frame_id, TURNED)
    for at, transform, pose in zip(ros.nanoseconds(motion.times), transforms, path["poses"], strict=True):
        yield "/tf", at, transform
        yield "/pose", at, pose


def plain(value: Any) -> Any:
    """Return a message of either library as plain data."""
    if isinstance(value, list):
        return [plain(item) for item in value]
    if isinstance(value, int | float | str):
        return value
    names = [field.name for field in fields(value)] if is_dataclass(value) else value.__slots__
    return {name: plain(getattr(value, name)) for name in names if name != "__msgtype__"}


@pytest.mark.parametrize("frame_id", FRAME_IDS)
def test_its_own_library_reads_it(motion: GeneratedMotion, frame_id: str) -> None:
    reader = make_reader(BytesIO(mcap(motion, frame_id, TURNED)), True, [DecoderFactory()])
    read = [
        (channel.topic, message.log_time, plain(decoded))
        for _, channel, message, decoded in reader.iter_decoded_messages()
    ]
    assert read == list(expected(motion, frame_id))


@pytest.mark.parametrize("frame_id", FRAME_IDS)
def test_an_independent_library_reads_it(motion: GeneratedMotion, frame_id: str, tmp_path: Path) -> None:
    """Neither the reader nor the definitions that it decodes by are those of the writer."""
    file = tmp_path / "movement.mcap"
    file.write_bytes(mcap(motion, frame_id, TURNED))
    store = get_typestore(Stores.ROS2_JAZZY)
    reader = McapReader(file)
    reader.open()
    read = [
        (connection.topic, at, plain(store.deserialize_cdr(data, connection.msgtype)))
        for connection, at, data in reader.messages(reader.connections)
    ]
    reader.close()
    assert read == list(expected(motion, frame_id))


def test_it_is_a_bag_of_ros_2(motion: GeneratedMotion) -> None:
    reader = make_reader(BytesIO(mcap(motion, "world")), validate_crcs=True)
    summary = reader.get_summary()
    assert reader.get_header().profile == "ros2"
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_start_time == 0
    assert summary.statistics.message_end_time == ros.nanoseconds(motion.times)[-1]
    schemas = {channel.topic: summary.schemas[channel.schema_id] for channel in summary.channels.values()}
    assert {topic: schema.name for topic, schema in schemas.items()} == TYPES
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    for schema in schemas.values():
        assert schema.encoding == "ros2msg"
        assert schema.data.decode() == definition(schema.name.replace("/msg/", "/"))


def test_it_plays_in_order_from_the_whole_to_the_last_frame(motion: GeneratedMotion) -> None:
    reader = make_reader(BytesIO(mcap(motion, "world")))
    as_filed = [
        (channel.topic, message.log_time)
        for _, channel, message in reader.iter_messages(log_time_order=False)
    ]
    assert [topic for topic, _ in as_filed[:2]] == ["/trajectory", "/path"]
    assert [at for _, at in as_filed] == sorted(at for _, at in as_filed)
    assert len(as_filed) == 2 + 2 * len(motion.times)


def test_of_the_same_movement_it_is_the_same(motion: GeneratedMotion) -> None:
    assert mcap(motion, "world") == mcap(motion, "world")
    assert mcap(motion, "world") != mcap(motion, "table")
