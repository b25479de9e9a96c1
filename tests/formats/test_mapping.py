"""Tracks become hand and objects; a mapping to begin with is proposed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.formats.capture import Capture
from app.formats.errors import InvalidMapping, UnknownTrack
from app.formats.mapping import TrackMapping, trajectory
from app.formats.proposal import propose
from app.motion.errors import InvalidTrajectory
from app.motion.trajectory import Floats

RATE = 100.0


def capture(**tracks: Floats) -> Capture:
    n_frames = len(next(iter(tracks.values())))
    return Capture("f", np.arange(n_frames) / RATE, np.arange(n_frames), tracks)


def named(*names: str) -> Capture:
    return capture(**{name: np.zeros((5, 3)) for name in names})


def test_several_tracks_are_their_mean_and_missing_where_any_is() -> None:
    rng = np.random.default_rng(0)
    hand, left, right = rng.normal(size=(3, 6, 3))
    left[2] = right[4] = np.nan
    mapping = TrackMapping.of({"hand": "hand", "objects": {"box": ["left", "right"]}})
    found = trajectory(capture(hand=hand, left=left, right=right), mapping)
    np.testing.assert_array_equal(found.hand, hand)
    np.testing.assert_allclose(found.objects["box"], (left + right) / 2)
    assert np.isnan(found.objects["box"][[2, 4]]).all()
    assert found.times.tolist() == (np.arange(6) / RATE).tolist()


def test_a_hand_will_do() -> None:
    assert trajectory(named("a"), TrackMapping.of({"hand": "a"})).objects == {}


NAMES = st.text(min_size=1, max_size=5)
SOME = st.lists(NAMES, min_size=1, max_size=3, unique=True)


@given(hand=SOME, objects=st.dictionaries(NAMES, SOME, max_size=3))
def test_json_reads_back(hand: list[str], objects: dict[str, list[str]]) -> None:
    value = {"hand": hand, "objects": objects}
    assert TrackMapping.of(value).as_json() == value


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([], "^needs the form"),
        ({"objects": {}}, "^needs the form"),
        ({"hand": "a", "object": {}}, "^needs the form"),
        ({"hand": 1}, "^hand: needs the name of a track"),
        ({"hand": []}, "^hand: needs the name of a track"),
        ({"hand": ["a", "a"]}, "^hand: names a track twice"),
        ({"hand": "a", "objects": ["b"]}, "^objects: needs the form"),
        ({"hand": "a", "objects": {"box": [None]}}, r"^objects\.box: needs the name"),
    ],
)
def test_forms_that_are_refused(value: object, message: str) -> None:
    with pytest.raises(InvalidMapping, match=message):
        TrackMapping.of(value)


@pytest.mark.parametrize(
    ("track", "message"),
    [
        ("hand top", r"^hand: there is no track 'hand top'; nearest: 'Hand top'"),
        ("Box bak", "nearest: 'Box back'"),
        ("zzz", "there are: 'Hand top', 'Box back', 'Elbow'$"),
    ],
)
def test_an_unknown_track_is_told_with_the_nearest(track: str, message: str) -> None:
    with pytest.raises(UnknownTrack, match=message):
        trajectory(named("Hand top", "Box back", "Elbow"), TrackMapping.of({"hand": track}))


def test_a_wrong_unit_is_found() -> None:
    with pytest.raises(InvalidTrajectory, match="wrong length unit"):
        trajectory(capture(hand=np.full((3, 3), 500.0)), TrackMapping(("hand",)))


@pytest.mark.parametrize(
    ("names", "hand", "objects"),
    [
        (("Elbow", "Hand top", "Box back"), "Hand top", {"object": ("Box back",)}),
        (("mixamorig:Hips", "mixamorig:RightHand"), "mixamorig:RightHand", {}),
        (("Handle", "Wrist"), "Wrist", {"object": ("Handle",)}),
        (("RFIN", "RELB", "RSHO"), "RFIN", {}),
        (("/hand/pose", "/object/pose"), "/hand/pose", {"object": ("/object/pose",)}),
        (("boite:left", "boite:right", "Eve:WRIST"), "Eve:WRIST", {"object": ("boite:left",)}),
        (("hand", "boite_left_ext", "boite_right_int"), "hand", {"object": ("boite_left_ext",)}),
        (
            ("hand", "/red/box_1/pose", "Tool:1"),
            "hand",
            {"red/box": ("/red/box_1/pose",), "Tool": ("Tool:1",)},
        ),
        (("hand", "red_cube", "blue_cube"), "hand", {"red_cube": ("red_cube",), "blue_cube": ("blue_cube",)}),
        (("gripper_tcp", "cup"), "gripper_tcp", {"object": ("cup",)}),
    ],
)
def test_names_are_understood(names: tuple[str, ...], hand: str, objects: dict[str, tuple[str, ...]]) -> None:
    found = propose(named(*names))
    assert found.mapping == TrackMapping((hand,), objects)
    assert len(found.reasons) == max(2, 1 + len(objects))


def test_fewest_dropouts_win() -> None:
    seen = np.random.default_rng(0).normal(size=(100, 3))
    gappy = seen.copy()
    gappy[:30] = np.nan
    found = propose(capture(**{"Hand left": gappy, "Hand right": seen, "Box 1": gappy, "Box 2": seen}))
    assert found.mapping == TrackMapping(("Hand right",), {"object": ("Box 2",)})
    assert "fewest dropouts" in found.reasons[1]


def test_what_is_carried_is_an_object() -> None:
    """The hand goes there, takes a thing along and comes back alone; an elbow goes with it all the way."""
    phase = np.clip(np.arange(400) / 100.0, 0.0, 4.0)
    way = np.interp(phase, [0, 1, 2, 3, 4], [0.0, 0.5, 0.5, 1.0, 0.0])
    hand = np.column_stack([way, np.zeros((400, 2))])
    thing = np.column_stack([np.clip(np.maximum.accumulate(way), 0.5, None), np.zeros((400, 2))])
    found = propose(capture(hand=hand, elbow=hand * 0.9 - 0.3, M1=thing, M2=np.zeros((400, 3))))
    assert found.mapping == TrackMapping(("hand",), {"object": ("M1",)})
    assert "'M1', since it moves with 'hand' at times" in found.reasons[1]


def test_nothing_like_a_hand() -> None:
    with pytest.raises(InvalidMapping, match="no track is named like a hand; there are LFT1, RFT1"):
        propose(named("LFT1", "RFT1"))


@given(st.integers(1, 12), st.floats(0.001, 10.0))
def test_it_is_proposed_for_short_and_slow_recordings(n_frames: int, period: float) -> None:
    rng = np.random.default_rng(n_frames)
    tracks = {name: rng.normal(size=(n_frames, 3)) for name in ("hand", "x")}
    assert propose(
        Capture("f", np.arange(float(n_frames)) * period, np.arange(n_frames), tracks)
    ).mapping.hand == ("hand",)
