"""One small recording written down in every format that is read, to be read back."""

from __future__ import annotations

from collections.abc import Callable
from math import isnan
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
from mcap_ros2.writer import Writer
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from app.formats.capture import Declared
from app.formats.definitions import definition
from app.motion.trajectory import Floats

RATE = 50.0
N_FRAMES = 30
FIRST = 11
"""The number of the first frame; frame 1 is at time 0."""
TIMES = (np.arange(N_FRAMES) + FIRST - 1) / RATE
METRES = Declared("m", "z")
Z_UP = Declared(up_axis="z")

GAP = slice(5, 8)
POSE = "geometry_msgs/msg/PoseStamped"


def tracks() -> dict[str, Floats]:
    """Return hand and box [m], to a tenth of a millimetre; the box is missing in ``GAP``."""
    rng = np.random.default_rng(3)
    found = {name: np.round(rng.normal(0.0, 0.5, (N_FRAMES, 3)), 4) + 0.0 for name in ("Hand", "Box")}
    found["Box"][GAP] = np.nan
    return found


def cells(scale: float = 1000.0, separator: str = "\t", up: str = "z") -> list[str]:
    """Return the coordinates of each frame as text, in a unit and a system, empty where missing."""
    columns = []
    for track in tracks().values():
        turned = track if up == "z" else np.column_stack([track[:, 0], track[:, 2], -track[:, 1]])
        columns += list(turned.T)
    rows = np.round(np.column_stack(columns) * scale, 4).tolist()
    return [separator.join("" if isnan(value) else repr(value) for value in row) for row in rows]


def table(head: str, before: Callable[[int], str], after: list[str]) -> bytes:
    return (head + "".join(f"{before(at)}{row}\n" for at, row in enumerate(after))).encode()


def frame_and_time(separator: str, first: int = FIRST) -> Callable[[int], str]:
    return lambda at: f"{at + first}{separator}{TIMES[at]:.5f}{separator}"


def qtm(*, columns: bool = True, kinds: bool = False) -> bytes:
    head = f"NO_OF_FRAMES\t{N_FRAMES}\nFREQUENCY\t50\nDATA_INCLUDED\t3D\nMARKER_NAMES\tHand\tBox\n"
    head += "TRAJECTORY_TYPES\tMeasured\tMixed\n" if kinds else ""
    names = [f"{name} {axis}" for name in ("Hand", "Box") for axis in "XYZ"]
    if columns:
        return table(head + "\t".join(["Frame", "Time", *names]) + "\t\n", frame_and_time("\t"), cells())
    return table(head, lambda _: "", cells())


def nexus() -> bytes:
    axes, units = ",".join("XYZXYZ"), ",".join(["mm"] * 6)
    head = f"Trajectories\n50\n,,Hand,,,Box,,\nFrame,Sub Frame,{axes}\n,,{units}\n"
    return table(head, lambda at: f"{at + FIRST},0,", cells(separator=","))


def motive(unit: str = "Meters", scale: float = 1.0) -> bytes:
    head = (
        f"Format Version,1.23,Export Frame Rate,50.0,Total Exported Frames,{N_FRAMES},"
        f"Rotation Type,Quaternion,Length Units,{unit},Coordinate Space,Global\n\n"
        f",Type,{','.join(7 * ['Rigid Body'] + 3 * ['Marker'])}\n"
        f',Name,{",".join(7 * ["Hand"])},"Box","Box","Box"\n'
        ",ID,1,1,1,1,1,1,1,2,2,2\n"
        f",,{','.join(4 * ['Rotation'] + 6 * ['Position'])}\n"
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,X,Y,Z\n"
    )
    return table(head, lambda at: frame_and_time(",", FIRST - 1)(at) + "0,0,0,1,", cells(scale, ",", up="y"))


def trc(separator: str = "\t", unit: str = "mm", scale: float = 1000.0) -> bytes:
    lines = [
        ["PathFileType", "4", "(X/Y/Z)", "file.trc"],
        ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"],
        ["50", "50", str(N_FRAMES), "2", unit],
        ["Frame#", "Time", "Hand", "", "", "Box", "", ""],
        ["", "", "X1", "Y1", "Z1", "X2", "Y2", "Z2"],
    ]
    head = "".join(separator.join(line) + "\n" for line in lines) + "\n"
    return table(head, frame_and_time(separator), cells(scale, separator))


def bvh() -> bytes:
    """A root and a joint that moves freely; what is missing cannot be said."""
    joint = "OFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n"
    head = (
        f"HIERARCHY\nROOT Hand\n{{\n{joint}JOINT Box\n{{\n{joint}End Site\n{{\nOFFSET 0 0 1\n}}\n}}\n}}\n"
        f"MOTION\nFrames: {N_FRAMES}\nFrame Time: {1 / RATE}\n"
    )
    hand, box = (np.nan_to_num(track) for track in tracks().values())
    rows = np.column_stack([hand, box - hand]).tolist()
    return (head + "".join(" ".join(map(repr, row)) + "\n" for row in rows)).encode()


def csv(separator: str = ",", between: str = ".") -> bytes:
    names = [f"{name}{between}{axis}" for name in ("Hand", "Box") for axis in "xyz"]
    head = separator.join(["frame", "time_s", *names]) + "\n"
    return table(head, frame_and_time(separator), cells(1.0, separator))


def npz(path: Path) -> None:
    arrays: dict[str, Any] = {"times": TIMES, **tracks()}
    np.savez(path, **arrays)


def c3d(path: Path, screen: str | None = None, angles: list[str] | None = None) -> None:
    file = ezc3d.c3d()
    if screen:
        file.add_parameter("POINT", "Y_SCREEN", [screen])
    if angles:
        file.add_parameter("POINT", "ANGLES", angles)
    names = list(tracks())
    points = np.ones((4, len(names), N_FRAMES))
    points[:3] = np.stack(list(tracks().values())).transpose(2, 0, 1) * 1000.0
    file["header"]["points"]["first_frame"] = FIRST - 1
    file["parameters"]["POINT"]["RATE"]["value"] = [RATE]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["LABELS"]["value"] = names
    file["data"]["points"] = points
    file.write(str(path))


def poses() -> list[tuple[str, int, tuple[float, ...]]]:
    """Return topic, stamp [ns] and position of all that is seen."""
    return [
        (f"/{name}", round(at * 1e9) + 10**18, tuple(position))
        for name, track in tracks().items()
        for at, position in zip(TIMES, track.tolist(), strict=True)
        if not isnan(position[0])
    ]


def mcap(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        kind = writer.register_msgdef(POSE, definition("geometry_msgs/PoseStamped"))
        for topic, stamp, (x, y, z) in poses():
            header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "world"}
            message = {"header": header, "pose": {"position": {"x": x, "y": y, "z": z}}}
            writer.write_message(topic, kind, message, log_time=stamp)
        writer.finish()  # type: ignore[no-untyped-call]


def _pose(types: Any, stamp: int, position: tuple[float, ...], **more: int) -> Any:
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return types[POSE](
        header=types["std_msgs/msg/Header"](**more, stamp=time, frame_id="world"),
        pose=types["geometry_msgs/msg/Pose"](
            position=types["geometry_msgs/msg/Point"](*position),
            orientation=types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        ),
    )


def bag(path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    with rosbag1.Writer(path) as writer:
        connections = {
            f"/{name}": writer.add_connection(f"/{name}", POSE, typestore=store) for name in tracks()
        }
        for topic, stamp, position in poses():
            message = _pose(store.types, stamp, position, seq=0)
            writer.write(connections[topic], stamp, store.serialize_ros1(message, POSE))


def bag2(folder: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with rosbag2.Writer(folder, version=8) as writer:
        connections = {
            f"/{name}": writer.add_connection(f"/{name}", POSE, typestore=store) for name in tracks()
        }
        for topic, stamp, position in poses():
            message = _pose(store.types, stamp, position)
            writer.write(connections[topic], stamp, store.serialize_cdr(message, POSE))


def db3(path: Path) -> None:
    folder = path.with_suffix("")
    bag2(folder)
    next(folder.glob("*.db3")).rename(path)


def content(of: Callable[..., bytes], **options: Any) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        path.write_bytes(of(**options))

    return write


FILES: dict[str, tuple[str, Callable[[Path], Any], Declared]] = {
    "c3d": (".c3d", c3d, Z_UP),
    "qtm-tsv": (".tsv", content(qtm), Z_UP),
    "nexus-csv": (".csv", content(nexus), Z_UP),
    "motive-csv": (".csv", content(motive), Declared()),
    "trc": (".trc", content(trc), Z_UP),
    "bvh": (".bvh", content(bvh), METRES),
    "mcap": (".mcap", mcap, Declared()),
    "rosbag1": (".bag", bag, Declared()),
    "rosbag2": (".db3", db3, Declared()),
    "npz": (".npz", npz, METRES),
    "csv": (".csv", content(csv), METRES),
}
"""Format -> end of the file's name, what writes it, and what its caller has to declare."""
