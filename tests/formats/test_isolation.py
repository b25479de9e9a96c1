"""A reader apart says what one here says; what it does to itself becomes an error that tells the limit."""

from __future__ import annotations

import os
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from app.formats import isolation
from app.formats.capture import Capture, Declared
from app.formats.errors import FormatError, ReaderStopped, Unreadable
from app.formats.isolation import MIB, Limits, read_apart, read_content_apart
from app.formats.reading import read
from tests.formats import recordings
from tests.formats.recordings import FILES, METRES
from tests.formats.test_reading import written

TIGHT = Limits(processor_s=1, wall_s=30.0, memory=512 * MIB, output=1 * MIB)


def same(one: Capture, other: Capture) -> None:
    np.testing.assert_array_equal(one.times, other.times)
    np.testing.assert_array_equal(one.frames, other.frames)
    assert list(one.tracks) == list(other.tracks)
    for track, expected in zip(one.tracks.values(), other.tracks.values(), strict=True):
        np.testing.assert_array_equal(track, expected)
    for field in ("format", "rate", "labels", "notes", "systems"):
        assert getattr(one, field) == getattr(other, field)


@pytest.mark.parametrize("name", FILES)
def test_apart_it_reads_the_same(name: str, tmp_path: Path) -> None:
    path, declared = written(tmp_path, name)
    same(read_apart(path, declared), read(path, declared))


def test_labels_and_notes_come_along(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,a.x,a.y,a.z,action,b\n0,0,0,0,réach,1\n1,0,0,0,réach,1\n", "utf-8")
    capture = read_apart(tmp_path / "a.csv", METRES)
    assert [label.action for label in capture.labels] == ["réach"]
    same(capture, read(tmp_path / "a.csv", METRES))


def test_a_folder_and_a_relative_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recordings.bag2(tmp_path / "bag")
    monkeypatch.chdir(tmp_path)
    same(read_apart(Path("bag")), read(tmp_path / "bag"))


@pytest.mark.parametrize("name", ["my take.CSV", "../../etc/take.csv", "a\x00b.csv", "漢" * 200 + ".csv"])
def test_content_is_read_under_the_name_its_sender_gives(name: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(recordings.csv())
    same(read_content_apart(recordings.csv(), name, METRES), read(tmp_path / "a.csv", METRES))


@pytest.mark.parametrize(
    ("content", "name", "declared"),
    [
        (b"", "a.csv", METRES),
        (b"t,a.x,a.y,a.z\n0,one,2,3\n", "a.csv", METRES),
        (recordings.csv(), "a.csv", Declared()),
        (b"hello", "a.xyz", METRES),
        (b"hello", "a.n3d", METRES),
    ],
)
def test_errors_come_back_as_they_are(content: bytes, name: str, declared: Declared, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError) as here:
        read(tmp_path / name, declared)
    with pytest.raises(type(here.value)) as apart:
        read_content_apart(content, name, declared)
    assert (str(apart.value), apart.value.args) == (str(here.value), here.value.args)


def test_it_costs_less_than_a_second(tmp_path: Path) -> None:
    path, declared = written(tmp_path, "csv")
    read_apart(path, declared)
    costs = []
    for _ in range(3):
        begin = time.perf_counter()
        read_apart(path, declared)
        costs.append(time.perf_counter() - begin)
    assert min(costs) < 1.0


@pytest.fixture
def hostile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(isolation, "PROGRAM", "tests.formats.hostile")


@pytest.mark.usefixtures("hostile")
@pytest.mark.parametrize(
    ("behaviour", "message"),
    [
        ("loop", "^loop: took more than 1 s of processor time to read$"),
        ("allocate", "^allocate: takes more than 512 MiB of memory to read$"),
        ("die", "^die: the reader was ended by SIGSEGV: the file is damaged"),
        ("leave", "^leave: the reader ended with status 3: the file is damaged"),
        ("large", "^large: is more than 1 MiB when read$"),
        ("fill", "^fill: is more than 1 MiB when read$"),
        ("forge", "^the reader's answer cannot be read"),
    ],
)
def test_limits_hold(behaviour: str, message: str, tmp_path: Path) -> None:
    begin = time.monotonic()
    with pytest.raises(ReaderStopped, match=message):
        read_apart(tmp_path / behaviour, Declared(), TIGHT)
    assert time.monotonic() - begin < TIGHT.wall_s


@pytest.mark.usefixtures("hostile")
def test_time_by_the_clock_is_limited(tmp_path: Path) -> None:
    begin = time.monotonic()
    with pytest.raises(ReaderStopped, match=r"^sleep: took longer than 1 s to read$"):
        read_apart(tmp_path / "sleep", Declared(), Limits(wall_s=1.0))
    assert time.monotonic() - begin < 10.0


@pytest.mark.usefixtures("hostile")
def test_what_a_library_prints_is_no_result(tmp_path: Path) -> None:
    assert len(read_apart(tmp_path / "chatter")) == 2


@pytest.mark.usefixtures("hostile")
def test_the_environment_stays_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GESTA_SECRET", "of this process")
    names = read_apart(tmp_path / "environment").notes
    assert {"GESTA_SECRET", "HOME", "PATH"}.isdisjoint(names)
    assert isolation.ENVIRONMENT.keys() <= set(names)


def test_an_archive_that_promises_too_much(tmp_path: Path) -> None:
    """A few bytes that say they are an array of 24 TB."""
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3)}\n"
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("hand.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    with pytest.raises(Unreadable, match=r"^a\.npz: does not fit into memory$"):
        read_apart(tmp_path / "a.npz", METRES)


def test_a_pipe_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.csv")
    with pytest.raises(Unreadable, match=r"^a\.csv: is no regular file$"):
        read_apart(tmp_path / "a.csv", METRES)
