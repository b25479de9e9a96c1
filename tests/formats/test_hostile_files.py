"""Whatever becomes of a file, it is read or refused: cut, flipped, filled with words, made up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.formats.capture import Capture
from app.formats.errors import FormatError
from app.formats.isolation import MIB, Limits, read_apart
from app.formats.reading import FORMATS, read
from tests.formats.recordings import FILES
from tests.formats.test_reading import written

HERE = [name for name in FILES if name != "c3d"]
TEXT = ("qtm-tsv", "nexus-csv", "motive-csv", "trc", "bvh", "csv")
WORDS = [b"", b"nan", b"inf", b"-1e999", b"1e308", b"0x1p3", b"1_0", b'"', b"\x00", b"\xff\xfe", b"\n", b"\r"]
WORDS += ["½".encode(), b"9" * 30, b"-", b"}", b"X", b"Frame", b"Trajectories\n"]

Contents = dict[str, bytes]

Change = tuple[float, bytes]
"""Where in a file (0 to 1), and what."""

PLACE = st.floats(0.0, 1.0, exclude_max=True)
FLIPS = st.lists(st.tuples(PLACE, st.binary(min_size=1, max_size=4)), min_size=1, max_size=6)
FEW = settings(max_examples=60)
TIGHT = Limits(processor_s=1, wall_s=30.0, memory=512 * MIB, output=16 * MIB)
"""There are damaged files with which ezc3d is busy for minutes."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("hostile")


@pytest.fixture(scope="module")
def contents(folder: Path) -> Contents:
    return {name: written(folder, name)[0].read_bytes() for name in FILES}


def overwritten(content: bytes, changes: list[Change]) -> bytes:
    changed = bytearray(content)
    for place, some in changes:
        at = int(place * len(content))
        changed[at : at + len(some)] = some
    return bytes(changed)


def is_sound(capture: Capture) -> None:
    """What a ``Capture`` promises."""
    assert capture.tracks
    assert len(capture.times) == len(capture.frames) > 0
    assert np.isfinite(capture.times).all()
    assert (np.diff(capture.times) > 0).all()
    for track in capture.tracks.values():
        assert track.shape == (len(capture), 3)
        assert not np.isinf(track).any()
        assert (np.isnan(track).all(axis=1) | ~np.isnan(track).any(axis=1)).all()


def survives(folder: Path, name: str, content: bytes) -> None:
    suffix, _, declared = FILES[name]
    path = folder / f"a{suffix}"
    path.write_bytes(content)
    try:
        capture = read_apart(path, declared, TIGHT) if name == "c3d" else read(path, declared)
    except FormatError as error:
        assert str(error)  # noqa: PT017 (that it is no other error is what is tested)
    else:
        is_sound(capture)


@pytest.mark.parametrize("name", HERE)
@FEW
@given(place=PLACE)
def test_cut(folder: Path, contents: Contents, name: str, place: float) -> None:
    content = contents[name]
    survives(folder, name, content[: int(place * len(content))])


@pytest.mark.parametrize("name", HERE)
@FEW
@given(changes=FLIPS)
def test_flipped(folder: Path, contents: Contents, name: str, changes: list[Change]) -> None:
    survives(folder, name, overwritten(contents[name], changes))


@pytest.mark.parametrize("name", TEXT)
@FEW
@given(words=st.lists(st.tuples(PLACE, st.sampled_from(WORDS)), min_size=1, max_size=4))
def test_words_in_place_of_cells(folder: Path, contents: Contents, name: str, words: list[Change]) -> None:
    content = contents[name]
    separator = max((b"\t", b",", b" "), key=content.count)
    cells = content.split(separator)
    for place, word in words:
        cells[int(place * len(cells))] = word
    survives(folder, name, separator.join(cells))


@pytest.mark.parametrize("name", HERE)
@FEW
@given(content=st.binary(max_size=400), length=st.integers(0, 300))
def test_made_up_after_a_true_beginning(
    folder: Path, contents: Contents, name: str, content: bytes, length: int
) -> None:
    survives(folder, name, contents[name][:length] + content)


@settings(max_examples=8)
@given(place=PLACE, changes=FLIPS, far=st.booleans())
def test_c3d_apart(folder: Path, contents: Contents, place: float, changes: list[Change], far: bool) -> None:
    """Header and parameters are the first two kilobytes or so; that is where to hit."""
    content = contents["c3d"]
    hit = content if far else content[:2048]
    survives(folder, "c3d", overwritten(hit, changes) + content[len(hit) :])
    survives(folder, "c3d", content[: int(place * len(content))])


def test_every_reader_is_tried() -> None:
    assert {known.name for known in FORMATS} == {*HERE, "c3d"}
