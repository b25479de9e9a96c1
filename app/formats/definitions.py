"""The definitions of the ROS 2 messages that are written, as a file carries them beside the messages."""

from __future__ import annotations

from collections.abc import Iterator

DEFINITIONS = {
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec\n",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
    ),
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "nav_msgs/Path": "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "trajectory_msgs/MultiDOFJointTrajectory": (
        "std_msgs/Header header\n"
        "string[] joint_names\n"
        "trajectory_msgs/MultiDOFJointTrajectoryPoint[] points\n"
    ),
    "trajectory_msgs/MultiDOFJointTrajectoryPoint": (
        "geometry_msgs/Transform[] transforms\n"
        "geometry_msgs/Twist[] velocities\n"
        "geometry_msgs/Twist[] accelerations\n"
        "builtin_interfaces/Duration time_from_start\n"
    ),
}
"""The fields of a message by its name, ``package/Type``."""

SEPARATOR = 80 * "="


def definition(name: str) -> str:
    """Return the definition of a message and, each once, of all that it is made of (``ros2msg``)."""
    own, *parts = dict.fromkeys(_made_of(name))
    return DEFINITIONS[own] + "".join(f"{SEPARATOR}\nMSG: {part}\n{DEFINITIONS[part]}" for part in parts)


def _made_of(name: str) -> Iterator[str]:
    yield name
    for field in DEFINITIONS[name].splitlines():
        part = field.split()[0].removesuffix("[]")
        if part in DEFINITIONS:
            yield from _made_of(part)
