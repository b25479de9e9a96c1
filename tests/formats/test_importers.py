"""Files of the field beside the project, each against a reading that shares nothing with ours."""

from __future__ import annotations

import csv
import json
import warnings
from dataclasses import replace
from pathlib import Path

import c3d
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from app.formats.capture import Capture, Declared
from app.formats.errors import NotRead
from app.formats.labels import read_labels, renamed, segments
from app.formats.mapping import TrackMapping, trajectory
from app.formats.proposal import propose
from app.formats.reading import read
from app.motion.trajectory import Floats, Recording, Segment
from tests.conftest import SHARED

pytestmark = pytest.mark.shared

IMPORTERS = SHARED / "importers"
VMCI = SHARED / "vmci_pick_place"
RUNS = [path.stem for path in sorted((VMCI / "raw").glob("*.tsv"))]
Z_UP = Declared(up_axis="z")
METRES = Declared("m", "z")
NANOMETRE = 1e-9

EB015 = ("Eb015pi_intel_int16", "Eb015pr_intel_float", "Eb015vr_dec_float")
NAN_SERVE, PROBING = "kinematics_tennis_serve_nan", "kinematics_racing_probing_medial_epicondyle_R"
MARKERS = {"hand": "Hand top", "thumb": "Thumb", "index": "Index", "elbow": "Elbow", "object": "Box back"}
ACTIONS = {
    "approach_forward": "grasp",
    "approach_right": "grasp",
    "move_obj_table": "displace",
    "move_obj_shelf": "displace",
    "move_to_rest_right": "retract",
    "move_to_rest_down": "retract",
    "idle": "idle",
}


def stacked(capture: Capture) -> Floats:
    """Return all tracks (n_frames, n_tracks, 3)."""
    return np.stack(list(capture.tracks.values()), axis=1)


def table(path: Path, delimiter: str, skip: int, columns: list[int] | None = None) -> Floats:
    """Return the numbers of a text file by numpy, NaN where a cell is empty."""
    rows = [line.split(delimiter) for line in path.read_text().splitlines()[skip:] if line.strip(delimiter)]
    width = min(map(len, rows))
    text = [delimiter.join(row[:width]) for row in rows]
    found: Floats = np.genfromtxt(text, delimiter=delimiter, usecols=columns)
    return found


def agree(capture: Capture, positions: Floats) -> None:
    """Positions (n_frames, n_tracks, 3) [m] are the same to a nanometre, gaps included."""
    np.testing.assert_allclose(stacked(capture), positions, rtol=0.0, atol=NANOMETRE)


def by_py_c3d(path: Path) -> tuple[list[str], Floats]:
    with warnings.catch_warnings(), path.open("rb") as file:
        warnings.simplefilter("ignore")
        reader = c3d.Reader(file)
        frames = np.array([points for _, points, _ in reader.read_frames()])
        names = [str(label).strip() for label in reader.point_labels]
    return names, np.where(frames[..., 3:4] < 0, np.nan, frames[..., :3].astype(float))


@pytest.mark.parametrize("name", [*EB015, NAN_SERVE])
def test_c3d_as_py_c3d_reads_it(name: str) -> None:
    path = IMPORTERS / "c3d" / f"{name}.c3d"
    capture = read(path, Z_UP if name == NAN_SERVE else Declared())
    names, positions = by_py_c3d(path)
    scale = 1.0 if name == NAN_SERVE else 1000.0
    assert list(capture.tracks) == names[: len(capture.tracks)]
    np.testing.assert_allclose(stacked(capture), positions / scale, rtol=0.0, atol=2e-7)
    assert np.isnan(stacked(capture)[..., 0]).sum() == (145 if name == NAN_SERVE else 226)
    assert (capture.rate, capture.times[1]) == (50.0, 0.02)


def test_c3d_as_numpy_reads_it() -> None:
    """PROBING is float, Intel: 41 points of four numbers a frame, from the block that the header names."""
    path = IMPORTERS / "c3d" / f"{PROBING}.c3d"
    content = path.read_bytes()
    block = int(np.frombuffer(content, "<u2", 1, 16)[0])
    points = np.frombuffer(content, "<f4", 140 * 41 * 4, (block - 1) * 512).reshape(140, 41, 4)
    capture = read(path, Z_UP)
    agree(capture, points[..., :3].astype(float))
    assert capture.rate == 69.5


def test_encodings_of_c3d_agree() -> None:
    one, *others = (stacked(read(IMPORTERS / "c3d" / f"{name}.c3d")) for name in EB015)
    for other in others:
        np.testing.assert_allclose(other, one, rtol=0.0, atol=1.1e-7)


def test_c3d_of_sgi_machines_and_n3d_are_refused_by_name() -> None:
    with pytest.raises(NotRead, match=r"SGI machine.*MIPS"):
        read(IMPORTERS / "c3d" / "sgi_real.c3d", METRES)
    with pytest.raises(NotRead, match="N3D"):
        read(IMPORTERS / "misc" / "kinematics_sample_optotrak.n3d", METRES)


@pytest.mark.parametrize("path", [VMCI / "raw" / f"{run}.tsv" for run in RUNS], ids=RUNS)
def test_qtm_as_numpy_and_as_its_segmenters_read_it(path: Path) -> None:
    capture = read(path, Z_UP)
    numbers = table(path, "\t", 11)
    agree(capture, numbers[:, 2:41].reshape(-1, 13, 3) / 1000)
    assert capture.frames.tolist() == numbers[:, 0].tolist()
    assert capture.times == pytest.approx((numbers[:, 0] - 1) / 60, abs=1e-12)
    sequence = read(VMCI / "sequences" / f"{path.stem}.csv", METRES)
    assert sequence.frames.tolist() == capture.frames.tolist()
    for name, marker in MARKERS.items():
        np.testing.assert_allclose(sequence.tracks[name], capture.tracks[marker], rtol=0.0, atol=NANOMETRE)


def test_qtm_with_kinds_of_trajectories() -> None:
    path = IMPORTERS / "qtm_tsv" / "hand_embodiment_recording_first1000.tsv"
    capture = read(path, Z_UP)
    agree(capture, table(path, "\t", 12)[:, 2:65].reshape(1000, 21, 3) / 1000)
    assert capture.notes == ("header says 6000 frames, file has 1000",)
    assert list(capture.tracks)[0::20] == ["hand_top", "pillow_right"]


def test_nexus() -> None:
    path = IMPORTERS / "vicon_csv" / "markers_nexus.csv"
    capture = read(path, Z_UP)
    agree(capture, table(path, ",", 5)[:, 2:155].reshape(580, 51, 3) / 1000)
    assert list(capture.tracks)[:9:8] == ["boite:gauche_ext", "Daphnee:ASISr"]
    assert (capture.rate, capture.times[-1]) == (100.0, 5.79)


def test_motive() -> None:
    path = IMPORTERS / "optitrack_csv" / "sample_optitrack_take.csv"
    capture = read(path)
    starts = [6, 10, 14, 18, *range(22, 49, 3)]
    y_up = table(path, ",", 7)[:, [start + axis for start in starts for axis in range(3)]].reshape(250, 13, 3)
    agree(capture, np.stack([y_up[..., 0], -y_up[..., 2], y_up[..., 1]], axis=-1))
    assert list(capture.tracks)[:5] == [
        "Rigid Body 1",
        "Rigid Body 1_1",
        "Rigid Body 1_2",
        "Rigid Body 1_3",
        "Unlabeled:108",
    ]
    assert np.isnan(stacked(capture)).any()


def test_trc_of_commas() -> None:
    path = IMPORTERS / "trc" / "markers_comma_separated.trc"
    capture = read(path, Z_UP)
    agree(capture, table(path, ",", 6)[:, 2:155].reshape(93, 51, 3) / 1000)
    assert capture.notes == ("header says 652 frames, file has 93",)
    assert list(capture.tracks)[0::50] == ["ASISl", "boite_arriere_gauche"]


def by_scipy(path: Path) -> dict[str, Floats]:
    """Return the places of joints (n_frames, 3) by recursion, with rotations of scipy."""
    hierarchy, _, motion = path.read_text().partition("MOTION")
    words = iter(hierarchy.replace("End Site", "JOINT .end").split())
    rows = np.loadtxt(motion.strip().splitlines()[2:])
    columns = iter(rows.T)
    places: dict[str, Floats] = {}

    def joint(name: str, place: Floats, turn: Rotation) -> None:
        for word in words:
            if word == "OFFSET":
                place = place + turn.apply(np.tile([float(next(words)) for _ in range(3)], (len(rows), 1)))
            elif word == "CHANNELS":
                channels = {next(words): next(columns) for _ in range(int(next(words)))}
                moves = [channels.get(f"{axis}position", np.zeros(len(rows))) for axis in "XYZ"]
                place = place + turn.apply(np.stack(moves, axis=1))
                order = "".join(channel[0] for channel in channels if channel.endswith("rotation"))
                angles = [channels[f"{axis}rotation"] for axis in order]
                turn = turn * Rotation.from_euler(order, np.stack(angles, axis=1), degrees=True)
            elif word == "JOINT":
                joint(next(words), place, turn)
            elif word == "}":
                break
        places[name] = place

    assert [next(words), next(words)] == ["HIERARCHY", "ROOT"]
    joint(next(words), np.zeros((len(rows), 3)), Rotation.identity(len(rows)))
    del places[".end"]
    return places


@pytest.mark.parametrize("name", ["test_freebvh", "test_mocapbank"])
def test_bvh_as_scipy_turns_it(name: str) -> None:
    path = IMPORTERS / "bvh" / f"{name}.bvh"
    capture, places = read(path, Declared("cm", "z")), by_scipy(path)
    assert capture.tracks.keys() == places.keys()
    for joint, place in places.items():
        np.testing.assert_allclose(capture.tracks[joint], place / 100, rtol=0.0, atol=NANOMETRE)


def test_mcap_as_others_read_it_and_as_it_was_made() -> None:
    path = IMPORTERS / "mcap" / "vmci_subject2_run1.mcap"
    capture = read(path)
    by_topic: dict[str, list[list[float]]] = {"/hand/pose": [], "/object/pose": []}
    with path.open("rb") as file:
        for _, channel, _, message in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            place = message.pose.position
            by_topic[channel.topic].append([place.x, place.y, place.z])
    store, reader = get_typestore(Stores.ROS2_HUMBLE), McapReader(path)
    reader.open()
    stamps = [
        message.header.stamp.sec * 10**9 + message.header.stamp.nanosec  # type: ignore[attr-defined]
        for connection, _, data in reader.messages(reader.connections)
        if connection.topic == "/hand/pose"
        for message in [store.deserialize_cdr(data, connection.msgtype)]
    ]
    reader.close()
    agree(capture, np.stack([by_topic[topic] for topic in capture.tracks], axis=1))
    assert capture.times == pytest.approx((np.array(stamps) - stamps[0]) / 1e9, abs=1e-12)
    sequence = read(VMCI / "sequences" / "subject2_run1.csv", METRES)
    np.testing.assert_allclose(capture.tracks["/hand/pose"], sequence.tracks["hand"], atol=NANOMETRE)
    np.testing.assert_allclose(capture.tracks["/object/pose"], sequence.tracks["object"], atol=NANOMETRE)
    assert capture.times == pytest.approx(sequence.times - sequence.times[0], abs=1e-4)


def rows_of(run: str) -> list[Segment]:
    with (VMCI / "segments.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["sequence"] == run]
    return [Segment(int(row["start_row"]), int(row["end_row"]), row["action"]) for row in rows]


@pytest.mark.parametrize("run", RUNS)
def test_a_lab_gets_from_its_own_files_to_labelled_recordings(run: str) -> None:
    """Raw file and segmentation beside it, as ``segments.csv`` has them, but for ends past the last frame."""
    capture = read(VMCI / "raw" / f"{run}.tsv", Z_UP)
    labels = read_labels((VMCI / "raw" / f"{run}_manually_segmented.json").read_bytes(), capture)
    motion = trajectory(capture, TrackMapping.of({"hand": "Hand top", "objects": {"object": "Box back"}}))
    found = segments(renamed(labels, ACTIONS), motion)
    last = len(motion) - 1
    assert list(found) == [replace(row, end=min(row.end, last)) for row in rows_of(run)]
    assert len(Recording(motion, found).demonstrations()) == len(found)


@pytest.mark.parametrize("run", RUNS)
def test_columns_of_labels_are_the_segments(run: str) -> None:
    """A table has a row for each frame: where two labels of an action touch, it cannot tell them apart."""
    capture = read(VMCI / "sequences" / f"{run}.csv", METRES)
    motion = trajectory(capture, TrackMapping.of({"hand": "hand", "objects": {"object": "object"}}))
    labels = renamed(capture.labels, {action: action for action in ACTIONS.values()})
    assert list(segments(labels, motion)) == rows_of(run)


@pytest.mark.parametrize("run", RUNS)
def test_a_mapping_is_proposed_by_names_and_by_motion(run: str) -> None:
    capture = read(VMCI / "raw" / f"{run}.tsv", Z_UP)
    named = propose(capture).mapping
    assert named.as_json() == {"hand": ["Hand top"], "objects": {"object": ["Box back"]}}
    aliases = {name: name.replace("Box", "Marker") for name in capture.tracks}
    tracks = {aliases[name]: track for name, track in capture.tracks.items()}
    moved = propose(Capture(capture.format, capture.times, capture.frames, tracks))
    assert moved.mapping.objects["object"] in (("Marker back",), ("Marker left",))
    assert "since it moves with 'Hand top' at times" in moved.reasons[1]


def test_every_file_is_known_here() -> None:
    """A new sample asks for a test of its own."""
    samples = [path for path in IMPORTERS.glob("*/*") if path.parent.name != "LICENSES"]
    assert len(samples) == 14
    assert json.dumps(RUNS).count("subject") == 15
