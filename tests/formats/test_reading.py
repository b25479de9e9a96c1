"""The same recording reads back from every format; what a file does not say is asked for by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.formats.capture import Capture, Declared
from app.formats.errors import FormatError, NotRead, UndeclaredGeometry, UnknownFormat, Unreadable
from app.formats.reading import FORMATS, format_of, read
from tests.formats import recordings
from tests.formats.recordings import FILES, FIRST, METRES, N_FRAMES, RATE, TIMES, Z_UP, content

BAGS = ("mcap", "rosbag1", "rosbag2")


def written(folder: Path, name: str) -> tuple[Path, Declared]:
    suffix, write, declared = FILES[name]
    path = folder / f"recording{suffix}"
    write(path)
    return path, declared


def same(capture: Capture, tolerance: float = 1e-12) -> None:
    """The recording is the one written: places to ``tolerance`` [m], times to a nanosecond."""
    assert capture.times - capture.times[0] == pytest.approx(TIMES - TIMES[0], abs=1e-9)
    for (name, found), (expected_name, expected) in zip(
        capture.tracks.items(), recordings.tracks().items(), strict=True
    ):
        assert name.removeprefix("/") == expected_name
        wanted = np.nan_to_num(expected) if capture.format == "bvh" else expected
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("name", FILES)
def test_the_recording_reads_back(name: str, tmp_path: Path) -> None:
    path, declared = written(tmp_path, name)
    assert format_of(path).name == name
    capture = read(path, declared)
    assert capture.format == name
    same(capture, 1e-7 if name == "c3d" else 1e-12)
    assert len(capture) == N_FRAMES
    assert capture.rate == (None if name in (*BAGS, "npz", "csv") else pytest.approx(RATE))


@pytest.mark.parametrize("name", FILES)
def test_a_format_is_known_by_its_mark_as_by_its_name(name: str, tmp_path: Path) -> None:
    path, declared = written(tmp_path, name)
    if name in ("csv", "rosbag2"):  # has no mark; is opened by its name
        return
    renamed = path.rename(tmp_path / "RECORDING")
    same(read(renamed, declared), 1e-7)


@pytest.mark.parametrize("name", [name for name in FILES if name not in (*BAGS, "motive-csv")])
def test_what_the_file_does_not_say_is_to_be_declared(name: str, tmp_path: Path) -> None:
    path, declared = written(tmp_path, name)
    with pytest.raises(UndeclaredGeometry) as refused:
        read(path)
    field = "up_axis" if declared == Z_UP else "length_unit"
    assert refused.value.field == field
    assert f"declare {field}" in str(refused.value)


@pytest.mark.parametrize("name", FILES)
def test_y_up_is_turned(name: str, tmp_path: Path) -> None:
    path, declared = written(tmp_path, name)
    if name in BAGS:
        with pytest.raises(UndeclaredGeometry, match=r"up_axis is declared as 'y', but this .* says 'z'"):
            read(path, Declared(up_axis="y"))
        return
    one, other = (read(path, Declared(declared.length_unit, up)) for up in ("z", "y"))
    for z_up, y_up in zip(one.tracks.values(), other.tracks.values(), strict=True):
        np.testing.assert_array_equal(y_up[:, [0, 2]], z_up[:, [0, 1]])
        np.testing.assert_array_equal(y_up[:, 1], -z_up[:, 2])


@pytest.mark.parametrize(
    ("name", "declared"),
    [("c3d", Declared("m", "z")), ("qtm-tsv", Declared("cm", "z")), ("mcap", Declared("mm"))],
)
def test_a_file_is_not_contradicted(name: str, declared: Declared, tmp_path: Path) -> None:
    with pytest.raises(UndeclaredGeometry, match=r"length_unit is declared as .*declare none"):
        read(written(tmp_path, name)[0], declared)


@pytest.mark.parametrize("name", ["c3d", "qtm-tsv", "nexus-csv", "motive-csv", "trc", "csv"])
def test_frames_keep_their_numbers_and_times(name: str, tmp_path: Path) -> None:
    path, declared = written(tmp_path, name)
    capture = read(path, declared)
    first = FIRST - 1 if name == "motive-csv" else FIRST
    assert capture.frames.tolist() == list(range(first, first + N_FRAMES))
    assert capture.times == pytest.approx(TIMES, abs=1e-12)


VARIANTS: dict[str, tuple[str, Callable[[Path], None], Declared]] = {
    "qtm with kinds of trajectories": ("a.tsv", content(recordings.qtm, kinds=True), Z_UP),
    "motive in millimetres": ("a.csv", content(recordings.motive, unit="Millimeters", scale=1e3), Declared()),
    "trc of commas": ("a.trc", content(recordings.trc, separator=","), Z_UP),
    "trc in metres": ("a.trc", content(recordings.trc, unit="m", scale=1.0), Z_UP),
    "csv of semicolons": ("a.csv", content(recordings.csv, separator=";"), METRES),
    "csv of tabs": ("a.tsv", content(recordings.csv, separator="\t"), METRES),
    "csv of underscores": ("a.csv", content(recordings.csv, between="_"), METRES),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_variants_read_the_same(name: str, tmp_path: Path) -> None:
    file, write, declared = VARIANTS[name]
    write(tmp_path / file)
    same(read(tmp_path / file, declared))


def test_qtm_without_names_of_columns_counts_from_the_first_frame(tmp_path: Path) -> None:
    (tmp_path / "a.tsv").write_bytes(recordings.qtm(columns=False))
    capture = read(tmp_path / "a.tsv", Z_UP)
    assert capture.times == pytest.approx(TIMES - TIMES[0])
    np.testing.assert_allclose(capture.tracks["Hand"], recordings.tracks()["Hand"], atol=1e-12)


def test_qtm_with_names_of_columns_but_no_times(tmp_path: Path) -> None:
    lines = [line.split("\t") for line in recordings.qtm().decode().splitlines()]
    (tmp_path / "a.tsv").write_text(
        "".join("\t".join(cells[2:] if at > 3 else cells) + "\n" for at, cells in enumerate(lines))
    )
    same(read(tmp_path / "a.tsv", Z_UP))


def test_qtm_without_a_header_has_its_times(tmp_path: Path) -> None:
    (tmp_path / "a.tsv").write_bytes(b"".join(recordings.qtm().splitlines(keepends=True)[4:]))
    same(read(tmp_path / "a.tsv", Z_UP))


@pytest.mark.parametrize(("screen", "up"), [("+Z", "z"), ("+Y", "y"), ("-Z", None), ("+X", None)])
def test_c3d_says_what_is_up_on_a_screen(screen: str, up: str | None, tmp_path: Path) -> None:
    path = tmp_path / "a.c3d"
    recordings.c3d(path, screen)
    if up is None:
        with pytest.raises(UndeclaredGeometry, match="up_axis"):
            read(path)
        return
    found, expected = read(path), read(path, Declared(up_axis=up))  # type: ignore[arg-type]
    assert found.notes == (f"up axis {up}, as POINT:Y_SCREEN has it",)
    np.testing.assert_array_equal(found.tracks["Hand"], expected.tracks["Hand"])
    same(read(path, Z_UP), 1e-7)


def test_c3d_leaves_out_what_is_no_place(tmp_path: Path) -> None:
    recordings.c3d(tmp_path / "a.c3d", angles=["Box"])
    capture = read(tmp_path / "a.c3d", Z_UP)
    assert list(capture.tracks) == ["Hand"]
    assert capture.notes == ("no positions, not read: Box",)


def test_motive_tells_bodies_and_markers_of_one_name_apart(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(recordings.motive().replace(b'"Box"', b"Hand"))
    assert list(read(tmp_path / "a.csv").tracks) == ["Hand", "Hand (Marker)"]


def test_nexus_has_other_sections_too(tmp_path: Path) -> None:
    others = b"Devices\n1000\n,,Force\nFrame,Sub Frame,Fx\n,,N\n1,0,3\n\n"
    (tmp_path / "a.csv").write_bytes(
        others + recordings.nexus() + b"\n" + others.replace(b"Devices", b"Joints")
    )
    capture = read(tmp_path / "a.csv", Z_UP)
    same(capture)
    assert capture.notes == ("sections not read: Devices, Joints",)


def test_a_bag_in_its_folder(tmp_path: Path) -> None:
    recordings.bag2(tmp_path / "bag")
    same(read(tmp_path / "bag"))


def test_line_ends_and_marks_of_other_systems(tmp_path: Path) -> None:
    text = recordings.csv().decode().replace("\n", "\r\n")
    for encoded in (
        text.encode("utf-8-sig"),
        text.encode("utf-16"),
        text.replace("Hand", "Händ").encode("latin-1"),
    ):
        (tmp_path / "a.csv").write_bytes(encoded)
        assert len(read(tmp_path / "a.csv", METRES)) == N_FRAMES


def test_zeros_of_qtm_are_gaps(tmp_path: Path) -> None:
    *others, last = recordings.qtm().decode().splitlines()
    last = "\t".join([*last.split("\t")[:5], "0.000", "0.000", "0.000"])
    (tmp_path / "a.tsv").write_text("\n".join([*others, last]))
    capture = read(tmp_path / "a.tsv", Z_UP)
    assert np.isnan(capture.tracks["Box"][-1]).all()
    assert capture.notes == ("1 positions of exactly (0, 0, 0) are read as gaps",)


def test_half_a_position_is_none(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,a.x,a.y,a.z\n0,1,2,3\n1,1,,3\n2,,,\n")
    found = read(tmp_path / "a.csv", METRES).tracks["a"]
    assert np.isnan(found).tolist() == [[False] * 3, [True] * 3, [True] * 3]


def test_a_column_of_actions_is_labels(tmp_path: Path) -> None:
    rows = ["", "reach", "reach", "", "place", "place"]
    (tmp_path / "a.csv").write_text(
        "t,a.x,a.y,a.z,action,mood\n"
        + "".join(f"{at / 10},0,0,0,{row},fine\n" for at, row in enumerate(rows))
    )
    capture = read(tmp_path / "a.csv", METRES)
    told = [(label.action, label.start_s, round(label.end_s, 9)) for label in capture.labels]
    assert told == [("reach", 0.1, 0.3), ("place", 0.4, 0.6)]
    assert capture.notes == ("columns not read: mood",)


REFUSED: dict[str, tuple[str, str | bytes, type[FormatError], str]] = {
    "unknown": ("a.xyz", "hello", UnknownFormat, "C3D.*QTM TSV.*Vicon Nexus CSV.*Motive CSV.*NPZ"),
    "empty": ("a.csv", "", Unreadable, "needs a column t or time_s"),
    "n3d": ("a.n3d", "", NotRead, "NDI.*export C3D"),
    "no tracks": ("a.csv", "t,b\n0,1\n", Unreadable, "line 1: needs columns NAME.x"),
    "no frames": ("a.csv", "t,a.x,a.y,a.z\n", Unreadable, "a.csv: has no frames"),
    "a word": (
        "a.csv",
        "t,a.x,a.y,a.z\n0,1,2,3\n1,one,2,3\n",
        Unreadable,
        "line 3, column 2: 'one' is no number",
    ),
    "short": ("a.csv", "t,a.x,a.y,a.z\n0,1,2,3\n1,1\n", Unreadable, "line 3: has 2 cells, needs 4"),
    "back": ("a.csv", "t,a.x,a.y,a.z\n1,1,2,3\n0,1,2,3\n", Unreadable, "frame 1: is not later"),
    "no time": ("a.csv", "t,a.x,a.y,a.z\n,1,2,3\n", Unreadable, "frame 0: has no time"),
    "infinite": ("a.csv", "t,a.x,a.y,a.z\n0,inf,2,3\n", Unreadable, "a, frame 0: is infinite"),
    "qtm 6D": ("a.tsv", recordings.qtm().replace(b"\t3D", b"\t6D"), NotRead, "6D data; export 3D"),
    "qtm header": ("a.tsv", "NO_OF_FRAMES\t1\n", Unreadable, "a header but no frames"),
    "qtm rate": ("a.tsv", recordings.qtm().replace(b"Y\t50", b"Y\tfast"), Unreadable, "FREQUENCY: 'fast'"),
    "nexus": ("a.csv", "Devices\n100\n", Unreadable, "no section Trajectories, only Devices"),
    "nexus unit": (
        "a.csv",
        recordings.nexus().replace(b"mm", b"in"),
        Unreadable,
        "line 5: the length unit 'in'",
    ),
    "motive version": ("a.csv", "Format Version,1.1\n", NotRead, "version '1.1'; versions 1.2x"),
    "motive local": ("a.csv", recordings.motive().replace(b"Global", b"Local"), NotRead, "'Local'"),
    "trc order": ("a.trc", recordings.trc().replace(b"(X/Y/Z)", b"(Y/Z/X)"), Unreadable, "line 1: needs"),
    "bvh word": ("a.bvh", "HIERARCHY\nROUTE a\n", Unreadable, "line 2: 'ROUTE a' is unknown"),
    "bvh short": (
        "a.bvh",
        recordings.bvh().rsplit(b" ", 1)[0],
        Unreadable,
        "line 48: has 5 numbers, needs 6",
    ),
    "bvh end": ("a.bvh", "HIERARCHY\nROOT a\n{\nEnd Site\n{\nJOINT b\n", Unreadable, "line 6: an end site"),
    "bvh channel": ("a.bvh", recordings.bvh().replace(b"Xpos", b"Wpos"), Unreadable, "line 5: channel 'Wpos"),
    "bvh hierarchy": ("a.bvh", "HIERARCHY\nROOT a\n", Unreadable, "a.bvh: ends before MOTION"),
    "bvh number": (
        "a.bvh",
        recordings.bvh().replace(b"Time: 0", b"Time: x"),
        Unreadable,
        "line 18: .*'x.02'",
    ),
    "bvh period": (
        "a.bvh",
        recordings.bvh().replace(b": 0.02", b": 0"),
        Unreadable,
        "0 is no positive number",
    ),
    "bvh frames": (
        "a.bvh",
        recordings.bvh().replace(b"Frames", b"Count"),
        Unreadable,
        "line 17: needs 'Frames:'",
    ),
    "qtm names": (
        "a.tsv",
        recordings.qtm().replace(b"Box Y", b"Cup Y"),
        Unreadable,
        "line 5: column 6: needs",
    ),
    "trc columns": (
        "a.trc",
        recordings.trc().replace(b"Time", b"When"),
        Unreadable,
        "line 4: needs the columns",
    ),
    "nexus columns": ("a.csv", recordings.nexus().replace(b"Sub ", b"Sup "), Unreadable, "line 4: needs the"),
    "motive top": (
        "a.csv",
        recordings.motive().replace(b"Frame,", b"Name,"),
        Unreadable,
        "no row that begins",
    ),
    "bag": ("a.bag", "#ROSBAG V2.0\n", Unreadable, "a.bag: rosbags cannot read it"),
    "mcap": ("a.mcap", b"\x89MCAP0\r\n", Unreadable, "a.mcap: mcap cannot read it"),
    "npz": ("a.npz", b"PK\x03\x04", Unreadable, "a.npz: numpy cannot read it"),
    "c3d": ("a.c3d", b"\x02\x50" + bytes(600), Unreadable, "a.c3d: ezc3d cannot read it"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_told_with_its_place(name: str, tmp_path: Path) -> None:
    file, inside, kind, message = REFUSED[name]
    path = tmp_path / file
    path.write_bytes(inside.encode() if isinstance(inside, str) else inside)
    declared = METRES if path.suffix in (".csv", ".bvh", ".npz") and b"mm" not in path.read_bytes() else Z_UP
    with pytest.raises(kind, match=f"(?s){message}"):
        read(path, Declared() if name.startswith("motive") else declared)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(Unreadable, match=r"^gone.csv: No such file"):
        read(tmp_path / "gone.csv")
    with pytest.raises(UnknownFormat):
        read(tmp_path)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"hand": np.zeros((3, 3))}, "needs an array times"),
        ({"times": np.arange(3.0), "hand": np.zeros((2, 3))}, r"hand: has shape \(2, 3\), needs \(3, 3\)"),
        ({"times": np.arange(3.0), "hand": np.array(["a"] * 3)}, "hand: holds <U1, needs numbers"),
        ({"times": np.arange(3.0), "hand": np.array([None] * 3)}, "numpy cannot read it: Object arrays"),
        ({"times": np.arange(3.0)}, "has no positions"),
    ],
)
def test_archives_of_something_else(arrays: dict[str, Any], message: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(Unreadable, match=message):
        read(tmp_path / "a.npz", METRES)


def test_names_of_formats_are_distinct() -> None:
    assert len({known.name for known in FORMATS}) == len(FORMATS)
    assert {known.name for known in FORMATS} == FILES.keys()
