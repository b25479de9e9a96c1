"""A movement as a bag: an MCAP file of ROS 2 messages, which viewers open and play and ``ros2 bag`` replays.

The whole movement stands at its start: ``/trajectory`` as a controller takes it, ``/path`` as a line in
space. Then it plays: ``/tf`` moves the hand's coordinate system, and ``/pose`` says the same in one message
a frame. The file's clock starts at 0 with the movement.
"""

from __future__ import annotations

from io import BytesIO

from mcap.records import Schema
from mcap_ros2.writer import Writer

from app.formats.definitions import definition
from app.formats.motion import Motion
from app.formats.ros import (
    UNTURNED,
    Quaternion,
    multi_dof_joint_trajectory,
    nanoseconds,
    path,
    transforms,
)


def mcap(motion: Motion, frame_id: str, orientation: Quaternion = UNTURNED) -> bytes:
    """Return the file; of the same movement the same bytes."""
    file = BytesIO()
    writer = Writer(file)
    trajectory = _register(writer, "trajectory_msgs", "MultiDOFJointTrajectory")
    line = _register(writer, "nav_msgs", "Path")
    tf = _register(writer, "tf2_msgs", "TFMessage")
    stamped = _register(writer, "geometry_msgs", "PoseStamped")
    whole = multi_dof_joint_trajectory(motion, frame_id, orientation)
    writer.write_message("/trajectory", trajectory, whole, log_time=0)
    way = path(motion, frame_id, orientation)
    writer.write_message("/path", line, way, log_time=0)
    moves = transforms(motion, frame_id, orientation)
    for at, move, pose in zip(nanoseconds(motion.times), moves, way["poses"], strict=True):
        writer.write_message("/tf", tf, move, log_time=at)
        writer.write_message("/pose", stamped, pose, log_time=at)
    writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()


def _register(writer: Writer, package: str, name: str) -> Schema:
    return writer.register_msgdef(f"{package}/msg/{name}", definition(f"{package}/{name}"))
