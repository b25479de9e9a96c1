"""Topics with times of their own on the times of one; coordinate systems; stamps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer
from rosbags import rosbag1
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from app.formats.bag import mcap
from app.formats.capture import Capture
from app.formats.definitions import DEFINITIONS, definition
from app.formats.errors import InvalidMapping, Unreadable
from app.formats.mapping import TrackMapping, trajectory
from app.formats.messages import PLACES
from app.formats.reading import read
from app.motion.trajectory import Floats
from tests.formats.motions import minimum_jerk

EPOCH = 1_700_000_000
POINT = "std_msgs/Header header\ngeometry_msgs/Point point\n"
ODOMETRY = "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
COVARIANCE = "geometry_msgs/Pose pose\nfloat64[36] covariance\n"


def bag(path: Path, **topics: tuple[Floats, Floats, str]) -> Capture:
    """Write and read PoseStamped on ``/NAME``: times [s] from the epoch, positions [m], coordinate system."""
    with path.open("wb") as file:
        writer = Writer(file)
        kind = writer.register_msgdef(
            "geometry_msgs/msg/PoseStamped", definition("geometry_msgs/PoseStamped")
        )
        for name, (times, positions, system) in topics.items():
            for at, (x, y, z) in zip(
                np.rint(times * 1e9).astype(int).tolist(), positions.tolist(), strict=True
            ):
                stamp = {"sec": EPOCH + at // 10**9, "nanosec": at % 10**9}
                message = {
                    "header": {"stamp": stamp, "frame_id": system},
                    "pose": {"position": {"x": x, "y": y, "z": z}},
                }
                writer.write_message(f"/{name}", kind, message, log_time=EPOCH * 10**9 + at + 5_000_000)
        writer.finish()  # type: ignore[no-untyped-call]
    return read(path)


def line(times: Floats) -> Floats:
    return np.column_stack([times, 2.0 * times, 1.0 - times])


def test_slower_topics_are_interpolated_and_it_is_said(tmp_path: Path) -> None:
    fast, slow = np.arange(0, 1.001, 0.01), np.arange(0.055, 0.91, 0.05)
    capture = bag(tmp_path / "a.mcap", slow=(slow, line(slow), "w"), fast=(fast, line(fast), "w"))
    np.testing.assert_allclose(capture.times, fast, atol=1e-9)
    inside = (fast >= slow[0]) & (fast <= slow[-1])
    np.testing.assert_allclose(capture.tracks["/slow"][inside], line(fast[inside]), atol=1e-9)
    assert np.isnan(capture.tracks["/slow"][~inside]).all()
    assert capture.notes[0] == "interpolated to the times of /fast: /slow"
    assert capture.notes[1] == f"times count from {EPOCH}.000000000 s"


def test_a_pause_is_a_dropout(tmp_path: Path) -> None:
    fast = np.arange(0, 1.0, 0.01)
    slow = np.delete(np.arange(0, 1.0, 0.02), slice(10, 15))
    capture = bag(tmp_path / "a.mcap", fast=(fast, line(fast), "w"), slow=(slow, line(slow), "w"))
    missing = fast[np.isnan(capture.tracks["/slow"][:, 0])]
    pause = fast[(fast > slow[9] + 1e-6) & (fast < slow[10] - 1e-6)]
    assert missing.tolist() == [*pause, fast[-1]]


def test_positions_that_are_no_numbers_stay_with_their_messages(tmp_path: Path) -> None:
    fast, slow = np.arange(0, 0.2, 0.01), np.arange(0, 0.2, 0.02)
    positions = line(slow)
    positions[3] = np.nan
    capture = bag(tmp_path / "a.mcap", fast=(fast, line(fast), "w"), slow=(slow, positions, "w"))
    missing = np.flatnonzero(np.isnan(capture.tracks["/slow"][:, 0]))
    assert missing.tolist() == [5, 6, 7, 19]


def test_stamps_out_of_order_or_twice(tmp_path: Path) -> None:
    times = np.array([0.0, 0.02, 0.01, 0.02, 0.03])
    capture = bag(tmp_path / "a.mcap", hand=(times, line(times), "w"))
    assert capture.times == pytest.approx([0.0, 0.01, 0.02, 0.03])
    assert capture.notes[0] == "/hand: 1 messages of a stamp that was there already"


def test_a_lone_message_is_there_once(tmp_path: Path) -> None:
    fast = np.arange(0, 0.1, 0.01)
    capture = bag(tmp_path / "a.mcap", fast=(fast, line(fast), "w"), lone=(fast[3:4], line(fast[3:4]), "w"))
    assert np.flatnonzero(~np.isnan(capture.tracks["/lone"][:, 0])).tolist() == [3]


def test_what_is_in_different_systems_does_not_go_together(tmp_path: Path) -> None:
    times = np.arange(0, 0.1, 0.01)
    capture = bag(tmp_path / "a.mcap", a=(times, line(times), "map"), b=(times, line(times), "camera"))
    assert capture.systems == {"/a": "map", "/b": "camera"}
    with pytest.raises(InvalidMapping, match="'/a' in 'map', '/b' in 'camera'"):
        trajectory(capture, TrackMapping(("/a",), {"object": ("/b",)}))


def test_our_own_bags_come_back(tmp_path: Path) -> None:
    motion = minimum_jerk(40)
    (tmp_path / "a.mcap").write_bytes(mcap(motion, "world"))
    capture = read(tmp_path / "a.mcap")
    assert list(capture.tracks) == ["/tf:hand", "/pose"]
    np.testing.assert_allclose(capture.times, motion.times, atol=1e-9)
    for track in capture.tracks.values():
        np.testing.assert_array_equal(track, motion.positions)
    assert set(capture.systems.values()) == {"world"}


def test_a_bag_without_places_names_its_topics(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        kind = writer.register_msgdef("geometry_msgs/msg/Point", DEFINITIONS["geometry_msgs/Point"])
        writer.write_message("/p", kind, {"x": 0.0, "y": 0.0, "z": 0.0})
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(
        Unreadable, match=r"topics are /p \(geometry_msgs/msg/Point\); read are .*PoseStamped"
    ):
        read(tmp_path / "a.mcap")


def test_messages_of_other_encodings_are_named(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channel = writer.register_channel("/j", "json", writer.register_schema("Pose", "jsonschema", b"{}"))
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(Unreadable, match=r"topics are /j \(json messages\)"):
        read(tmp_path / "a.mcap")


def filled(types: Any, kind: str, system: str, at: int) -> tuple[Any, str]:
    """Return a message of a kind that tells (at, 2, 3) at second ``at``, and what moves by its name."""
    header = types["std_msgs/msg/Header"](
        seq=0, stamp=types["builtin_interfaces/msg/Time"](sec=at, nanosec=0), frame_id=system
    )
    turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    point = types["geometry_msgs/msg/Point"](float(at), 2.0, 3.0)
    pose = types["geometry_msgs/msg/Pose"](point, turn)
    if kind.endswith("PointStamped"):
        return types[kind](header, point), ""
    if kind.endswith("PoseStamped"):
        return types[kind](header, pose), ""
    if kind.endswith(("PoseWithCovarianceStamped", "Odometry")):
        spread = types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))
        if kind.endswith("Stamped"):
            return types[kind](header, spread), ""
        vector = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        speed = types["geometry_msgs/msg/TwistWithCovariance"](
            types["geometry_msgs/msg/Twist"](vector, vector), np.zeros(36)
        )
        return types[kind](header, "robot", spread, speed), ""
    moved = types["geometry_msgs/msg/Transform"](
        types["geometry_msgs/msg/Vector3"](float(at), 2.0, 3.0), turn
    )
    transform = types["geometry_msgs/msg/TransformStamped"](header, "hand", moved)
    return (transform if kind.endswith("TransformStamped") else types[kind]([transform])), ":hand"


@pytest.mark.parametrize("kind", PLACES)
def test_every_kind_of_message_tells_its_place(kind: str, tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    if kind not in store.fielddefs:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", kind))
    with rosbag1.Writer(tmp_path / "a.bag") as writer:
        topic = writer.add_connection("/topic", kind, typestore=store)
        for at in (1, 2):
            message, moves = filled(store.types, kind, "world", at)
            writer.write(topic, at * 10**9, store.serialize_ros1(message, kind))
    capture = read(tmp_path / "a.bag")
    assert capture.tracks["/topic" + moves].tolist() == [[1.0, 2.0, 3.0], [2.0, 2.0, 3.0]]
    assert capture.systems == {"/topic" + moves: "world"}


def test_without_stamps_the_log_counts(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "geometry_msgs/msg/PointStamped"
    with rosbag1.Writer(tmp_path / "a.bag") as writer:
        topic = writer.add_connection("/topic", kind, typestore=store)
        for at in (5, 7):
            message, _ = filled(store.types, kind, "", 0)
            writer.write(topic, at * 10**9, store.serialize_ros1(message, kind))
    capture = read(tmp_path / "a.bag")
    assert capture.times.tolist() == [0.0, 2.0]
    assert capture.notes[0] == "2 messages have no stamp: taken as of their log time"


def test_a_topic_that_changes_its_system_is_left_out(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "geometry_msgs/msg/PointStamped"
    with rosbag1.Writer(tmp_path / "a.bag") as writer:
        topic = writer.add_connection("/topic", kind, typestore=store)
        for at in (5, 7):
            message, _ = filled(store.types, kind, f"map{at}", at)
            writer.write(topic, at * 10**9, store.serialize_ros1(message, kind))
    with pytest.raises(Unreadable, match="/topic changes its coordinate system: not read"):
        read(tmp_path / "a.bag")
