"""Places that ROS messages tell, each stamped, and named by topic or by the coordinate system that moves.

Messages are taken apart by the standard definitions of their types, never by those in a file: what is not
known by name is not read. ROS is in metres, Z up (REP-103).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

Encoding = Literal["ros1", "cdr"]

Place = tuple[str, Any, Any]
"""What moves (empty: the topic says it), header, point."""

NANOSECONDS = 1_000_000_000
TRANSFORMS = "geometry_msgs/TransformStamped[] transforms"


def _transform(message: Any) -> Place:
    return f":{message.child_frame_id}", message.header, message.transform.translation


PLACES: dict[str, Callable[[Any], list[Place]]] = {
    "geometry_msgs/msg/PoseStamped": lambda message: [("", message.header, message.pose.position)],
    "geometry_msgs/msg/PointStamped": lambda message: [("", message.header, message.point)],
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: [
        ("", message.header, message.pose.pose.position)
    ],
    "nav_msgs/msg/Odometry": lambda message: [("", message.header, message.pose.pose.position)],
    "geometry_msgs/msg/TransformStamped": lambda message: [_transform(message)],
    "tf2_msgs/msg/TFMessage": lambda message: [_transform(moved) for moved in message.transforms],
    "tf/msg/tfMessage": lambda message: [_transform(moved) for moved in message.transforms],
}
"""Type of a message -> the places it tells."""


@dataclass
class Stream:
    """What was told of one thing: times [ns], positions [m], and the coordinate systems that they are in."""

    stamps: list[int] = field(default_factory=list)
    positions: list[tuple[float, float, float]] = field(default_factory=list)
    systems: set[str] = field(default_factory=set)


class Streams:
    """All that a bag tells, by what it is of."""

    def __init__(self) -> None:
        self.of: dict[str, Stream] = {}
        self.topics: dict[str, str] = {}
        self.n_unstamped = 0

    def add(self, topic: str, kind: str, encoding: Encoding, logged: int, content: bytes) -> None:
        """Take a message of a type, logged at a time [ns], which counts where the message has no stamp.

        Raises what rosbags does of a damaged message.
        """
        kind = kind if "/msg/" in kind else kind.replace("/", "/msg/", 1)
        self.topics[topic] = kind
        if kind not in PLACES:
            return
        store = typestore(encoding)
        message = (store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr)(content, kind)
        for moves, header, point in PLACES[kind](message):
            stream = self.of.setdefault(topic + moves, Stream())
            stamp = header.stamp.sec * NANOSECONDS + header.stamp.nanosec
            self.n_unstamped += not stamp
            stream.stamps.append(stamp or logged)
            stream.positions.append((point.x, point.y, point.z))
            stream.systems.add(header.frame_id)

    def __iter__(self) -> Iterator[tuple[str, Stream]]:
        return iter(self.of.items())


@cache
def typestore(encoding: Encoding) -> Typestore:
    """Return the standard definitions of ROS 1 or ROS 2."""
    if encoding == "cdr":
        return get_typestore(Stores.ROS2_JAZZY)
    store = get_typestore(Stores.ROS1_NOETIC)
    for kind in ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"):
        store.register(get_types_from_msg(TRANSFORMS, kind))
    return store
