"""Labels by time and by frame; what is wrong with one is told with its row."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.formats.capture import Capture, Label
from app.formats.errors import InvalidLabels
from app.formats.labels import read_labels, renamed, segments
from app.motion.trajectory import Recording, Segment, Trajectory

N_FRAMES, FIRST, RATE = 100, 690, 60.0
FRAMES = np.arange(N_FRAMES) + FIRST
CAPTURE = Capture("f", (FRAMES - 1) / RATE, FRAMES, {"hand": np.zeros((N_FRAMES, 3))})
MOTION = Trajectory(CAPTURE.times, CAPTURE.tracks["hand"])


def by(content: object) -> tuple[Segment, ...]:
    text = content if isinstance(content, str) else json.dumps(content)
    return segments(read_labels(text.encode(), CAPTURE), MOTION)


EXPECTED = (Segment(10, 30, "reach"), Segment(30, 99, "place"))
SAME: dict[str, object] = {
    "frames": [
        {"action": "reach", "start_frame": 700, "end_frame": 720},
        {"action": "place", "start_frame": 720, "end_frame": 789},
    ],
    "vmci": [
        {"start index": 720, "end index": 789, "label": "place"},
        {"start index": 700, "end index": 720, "label": "reach"},
    ],
    "seconds": [
        {"action": "reach", "start_s": 699 / 60, "end_s": 719 / 60},
        {"action": "place", "start_s": 11.985, "end_s": 13.13},
    ],
    "csv of frames": "action,start_frame,end_frame\nreach,700,720\nplace,720,789\n",
    "csv of seconds": "\ufeffstart_s,end_s,action,by\r\n11.65,11.983,reach,me\r\n11.983,13.13,place,me\r\n",
    "csv of both": "label,start_frame,end_frame,start_s,end_s\nreach,700,720,0,0\nplace,720,789,,\n",
}


@pytest.mark.parametrize("name", SAME)
def test_forms_of_the_same_labels(name: str) -> None:
    assert by(SAME[name]) == EXPECTED
    assert len(Recording(MOTION, EXPECTED).demonstrations()) == 2


def test_the_goal_may_be_the_frame_after_the_last() -> None:
    assert by([{"action": "a", "start_frame": 700, "end_frame": 790}]) == (Segment(10, 100, "a"),)
    assert by([{"action": "a", "start_s": 11.65, "end_s": 789 / 60}]) == (Segment(10, 100, "a"),)


REFUSED: dict[str, tuple[object, str]] = {
    "no json": ("[{", "^no JSON"),
    "a huge cell": ("action,start_s,end_s\n" + "a" * 200_000, "^line .*: no table: field larger"),
    "no list": ({"action": "a"}, "^needs a list"),
    "no object": ([1], "^label 0: needs an object"),
    "no action": ([{"start_s": 1, "end_s": 2}], "^label 0: has no action"),
    "no csv action": ("action,start_s,end_s\na,11.6,11.8\n,11.8,12\n", "^line 3: has no action"),
    "no ends": ("action,start,end\na,1,2\n", "^line 2: needs start_s and end_s, or start_frame"),
    "a word": ("action,start_s,end_s\na,one,2\n", "^line 2: start_s: 'one' is no number"),
    "not a number": ([{"action": "a", "start_s": float("nan"), "end_s": 2}], "^label 0: start_s: nan"),
    "true": ([{"action": "a", "start_frame": True, "end_frame": 2}], "^label 0: start_frame: True"),
    "no frame": ([{"action": "a", "start_frame": 7, "end_frame": 700}], "has no frame 7; it has 690 to 789"),
    "half a frame": ([{"action": "a", "start_frame": 700.5, "end_frame": 710}], "has no frame 700.5"),
    "outside": ([{"action": "a", "start_s": 1, "end_s": 12}], "^label 0: 'a' from 1 to 12 s must start"),
    "backwards": ([{"action": "a", "start_frame": 710, "end_frame": 700}], "must start before its end"),
    "overlap": (
        [
            {"action": "a", "start_frame": 700, "end_frame": 720},
            {"action": "a_part", "start_frame": 710, "end_frame": 720},
        ],
        "^'a_part' from 11.8167 to 11.9833 s: overlaps 'a'; leave out or rename",
    ),
    "short": ([{"action": "a", "start_s": 11.651, "end_s": 11.652}], "is shorter than a frame"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_told_with_its_row(name: str) -> None:
    content, message = REFUSED[name]
    with pytest.raises(InvalidLabels, match=message):
        by(content)


def test_bytes_that_are_no_text() -> None:
    with pytest.raises(InvalidLabels, match=r"^needs UTF-8"):
        read_labels(b"\xff", CAPTURE)


def test_labels_of_other_names_are_left_out() -> None:
    labels = [Label("approach", 0.0, 1.0), Label("approach_part", 0.0, 0.5), Label("lift", 1.0, 2.0)]
    found = renamed(labels, {"approach": "grasp", "lift": "lift", "drop": "drop"})
    assert found == (Label("grasp", 0.0, 1.0), Label("lift", 1.0, 2.0))


@given(st.lists(st.integers(0, N_FRAMES - 1), min_size=2, max_size=8, unique=True))
def test_frames_come_back(bounds: list[int]) -> None:
    bounds.sort()
    pairs = list(pairwise(bounds))
    rows = [{"action": "a", "start_frame": start + FIRST, "end_frame": end + FIRST} for start, end in pairs]
    assert by(rows) == tuple(Segment(start, end, "a") for start, end in pairs)


@given(st.one_of(st.binary(max_size=60), st.text(max_size=60).map(lambda text: ("[" + text).encode())))
def test_any_bytes_are_labels_or_refused(content: bytes) -> None:
    try:
        read_labels(content, CAPTURE)
    except InvalidLabels as error:
        assert str(error)  # noqa: PT017 (that it is no other error is what is tested)


CELL = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=4), st.just([]))
KEYS = ("action", "label", "start_s", "end_s", "start_frame", "end_frame", "start index", "end index")


@given(st.lists(st.dictionaries(st.sampled_from(KEYS), CELL), max_size=3))
def test_any_json_is_labels_or_refused(rows: list[dict[str, object]]) -> None:
    try:
        read_labels(json.dumps(rows).encode(), CAPTURE)
    except InvalidLabels as error:
        assert str(error)  # noqa: PT017
