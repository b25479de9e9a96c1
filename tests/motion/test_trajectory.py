"""The value types refuse what they are not, by field and frame, and cannot be changed afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import ArrayLike

from app.motion.errors import InvalidSegment, InvalidTrajectory, MotionError
from app.motion.trajectory import (
    FARTHEST_M,
    Demonstration,
    Floats,
    Recording,
    Scene,
    Segment,
    Trajectory,
    is_sound,
)

LAW = settings(derandomize=True, deadline=None)

N_FRAMES = 5
TIMES = np.arange(N_FRAMES) / 100.0
STILL = np.zeros((N_FRAMES, 3))
PLAIN = Trajectory(TIMES, STILL)

positions = arrays(np.float64, (N_FRAMES, 3), elements=st.floats(-FARTHEST_M, FARTHEST_M))
frames = st.integers(0, N_FRAMES - 1)
axes = st.integers(0, 2)
fields = st.sampled_from(["hand", "objects.cup"])


def refusal(times: object, hand: object, objects: Mapping[str, object] | None = None) -> InvalidTrajectory:
    """Return how a trajectory of these is refused."""
    arguments: Any = (times, hand, objects or {})
    with pytest.raises(InvalidTrajectory) as refused:
        Trajectory(*arguments)
    return refused.value


def refusal_of(field: str, track: object) -> InvalidTrajectory:
    """Return how a hand, or an object, of these positions is refused."""
    if field == "hand":
        return refusal(TIMES, track, {"cup": STILL})
    return refusal(TIMES, STILL, {"box": STILL, "cup": track})


def altered(at: tuple[int, ...] | int, value: float, of: Floats = STILL) -> Floats:
    """Return the array with another value there."""
    array = of.copy()
    array[at] = value
    return array


@LAW
@given(positions, positions, arrays(np.bool_, N_FRAMES))
def test_positions_and_dropouts_are_kept_as_they_are(hand: Floats, cup: Floats, lost: Floats) -> None:
    hand[lost] = np.nan
    trajectory = Trajectory(TIMES, hand, {"cup": cup})
    np.testing.assert_array_equal(trajectory.times, TIMES)
    np.testing.assert_array_equal(trajectory.hand, hand)
    np.testing.assert_array_equal(trajectory.objects["cup"], cup)
    assert len(trajectory) == N_FRAMES


def test_arrays_are_copies_that_nobody_can_write_to() -> None:
    times, hand, cup = TIMES.copy(), np.asfortranarray(STILL), STILL.copy()
    trajectory = Trajectory(times, hand, {"cup": cup})
    times[0], hand[0], cup[0] = -1.0, 1.0, 1.0
    for array, before in (
        (trajectory.times, TIMES),
        (trajectory.hand, STILL),
        (trajectory.objects["cup"], STILL),
    ):
        np.testing.assert_array_equal(array, before)
        assert array.dtype == np.float64
        assert array.flags.c_contiguous
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_plain_lists_of_numbers_will_do() -> None:
    lists: Any = ([0, 1], [[0, 0, 0], [1, 2, 3]], {"cup": [[0, 0, 0], [1, 2, 3]]})
    trajectory = Trajectory(*lists)
    np.testing.assert_array_equal(trajectory.hand, [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(trajectory.objects["cup"], trajectory.hand)


@pytest.mark.parametrize("times", [[], 0.0, TIMES[:, None], np.empty((0, 3))])
def test_times_of_another_shape_are_refused(times: object) -> None:
    refused = refusal(times, STILL)
    assert (refused.field, refused.frame) == ("times", None)
    assert "shape" in str(refused)


@LAW
@given(st.integers(1, N_FRAMES - 1), st.sampled_from([0.0, -1e-9, -5.0]))
def test_times_that_do_not_advance_are_refused(frame: int, step: float) -> None:
    refused = refusal(altered(frame, TIMES[frame - 1] + step, TIMES), STILL)
    assert (refused.field, refused.frame) == ("times", frame)
    assert f"times, frame {frame}: must be later" in str(refused)


@LAW
@given(frames, st.sampled_from([np.nan, np.inf, -np.inf]))
def test_times_that_are_not_finite_are_refused(frame: int, time: float) -> None:
    refused = refusal(altered(frame, time, TIMES), STILL)
    assert (refused.field, refused.frame) == ("times", frame)
    assert "finite" in str(refused)


def test_times_far_apart_overflow_nothing() -> None:
    assert refusal([1.7e308, -1.7e308], STILL[:2]).frame == 1
    assert len(Trajectory(np.array([-1.7e308, 1.7e308]), STILL[:2])) == 2


@pytest.mark.parametrize("field", ["hand", "objects.cup"])
@pytest.mark.parametrize(
    "track", [STILL[:4], STILL[:, :2], STILL.T, STILL[0], np.zeros((N_FRAMES, 3, 1)), 0.0]
)
def test_positions_of_another_shape_are_refused(field: str, track: ArrayLike) -> None:
    refused = refusal_of(field, track)
    assert (refused.field, refused.frame) == (field, None)
    assert f"needs shape ({N_FRAMES}, 3), has {np.shape(track)}" in str(refused)


@pytest.mark.parametrize("field", ["hand", "objects.cup"])
@pytest.mark.parametrize(
    "track",
    [
        "here",
        [["0", "0", "0"]] * N_FRAMES,
        [[0.0, 0.0], [0.0]],
        {},
        STILL + 1j,
        np.zeros((N_FRAMES, 3), "M8[s]"),
    ],
)
def test_what_is_no_array_of_numbers_is_refused(field: str, track: object) -> None:
    refused = refusal_of(field, track)
    assert (refused.field, refused.frame) == (field, None)
    assert "numbers" in str(refused)


@LAW
@given(fields, frames, axes, st.sampled_from([np.nan, np.inf, -np.inf]))
def test_positions_in_part_missing_or_infinite_are_refused(
    field: str, frame: int, axis: int, value: float
) -> None:
    refused = refusal_of(field, altered((frame, axis), value))
    assert (refused.field, refused.frame) == (field, frame)
    assert f"{field}, frame {frame}: needs three finite coordinates" in str(refused)


@LAW
@given(fields, frames, axes, st.sampled_from([100.001, -100.001, 1e300]))
def test_positions_in_a_wrong_unit_are_refused(field: str, frame: int, axis: int, value: float) -> None:
    refused = refusal_of(field, altered((frame, axis), value))
    assert (refused.field, refused.frame) == (field, frame)
    assert "unit" in str(refused)


def test_the_first_wrong_frame_is_named() -> None:
    track = altered((3, 0), np.inf, altered((1, 2), np.nan))
    assert refusal(TIMES, track).frame == 1
    assert refusal(TIMES, STILL, {"cup": STILL, "box": track}).field == "objects.box"


@LAW
@given(positions, frames, st.data())
def test_part_is_a_trajectory_of_its_own(hand: Floats, start: int, data: st.DataObject) -> None:
    stop = data.draw(st.integers(start + 1, N_FRAMES))
    whole = Trajectory(TIMES, hand, {"cup": hand[::-1]})
    part = whole.part(start, stop)
    np.testing.assert_array_equal(part.times, TIMES[start:stop])
    np.testing.assert_array_equal(part.hand, hand[start:stop])
    np.testing.assert_array_equal(part.objects["cup"], hand[::-1][start:stop])
    assert not np.shares_memory(part.hand, whole.hand)


def test_a_part_without_frames_is_refused() -> None:
    with pytest.raises(InvalidTrajectory, match="times"):
        PLAIN.part(2, 2)


@pytest.mark.parametrize("height", [np.nan, np.inf, -np.inf, 100.1, -720.0])
def test_a_table_that_stands_nowhere_is_refused(height: float) -> None:
    with pytest.raises(InvalidTrajectory, match="table_height: ") as refused:
        Scene(height)
    assert (refused.value.field, refused.value.frame) == ("table_height", None)


@pytest.mark.parametrize(
    ("segments", "index"),
    [
        ([(-1, 2)], 0),
        ([(2, 2)], 0),
        ([(3, 2)], 0),
        ([(0, 6)], 0),
        ([(5, 6)], 0),
        ([(0, 2), (1, 3)], 1),
        ([(2, 4), (0, 2)], 1),
        ([(0, 2), (2, 3), (2, 4)], 2),
    ],
)
def test_segments_outside_or_over_each_other_are_refused(
    segments: Sequence[tuple[int, int]], index: int
) -> None:
    with pytest.raises(InvalidSegment, match=f"segment {index}: ") as refused:
        Recording(PLAIN, tuple(Segment(start, end, "push") for start, end in segments))
    assert refused.value.index == index


@LAW
@given(st.sets(st.integers(0, N_FRAMES), min_size=2))
def test_segments_may_touch_and_leave_rest(bounds: set[int]) -> None:
    ordered = sorted(bounds)
    segments = tuple(Segment(a, b, "push") for a, b in pairwise(ordered))
    for chosen in (segments, segments[::2], ()):
        assert Recording(PLAIN, chosen).segments == chosen


def test_demonstrations_reach_their_goal() -> None:
    """Frame ``end`` is the goal of a segment, and the start of its successor; the last may end without."""
    hand = np.arange(3.0 * N_FRAMES).reshape(N_FRAMES, 3)
    segments = (Segment(0, 2, "grasp"), Segment(2, 3), Segment(3, 5, "push"))
    scene = Scene(0.7)
    shown = Recording(Trajectory(TIMES, hand, {"cup": hand}), segments, scene).demonstrations()
    assert [demonstration.action for demonstration in shown] == ["grasp", "push"]
    for demonstration, rows in zip(shown, ([0, 1, 2], [3, 4]), strict=True):
        np.testing.assert_array_equal(demonstration.trajectory.hand, hand[rows])
        np.testing.assert_array_equal(demonstration.trajectory.objects["cup"], hand[rows])
        np.testing.assert_array_equal(demonstration.trajectory.times, TIMES[rows])
        assert demonstration.scene is scene


def test_value_types_are_frozen() -> None:
    values = (PLAIN, Scene(), Segment(0, 1), Demonstration("push", PLAIN), Recording(PLAIN))
    for value in values:
        with pytest.raises(AttributeError):
            setattr(value, next(iter(vars(value))), None)


def test_every_refusal_is_a_motion_error() -> None:
    for refusal_type in (InvalidTrajectory, InvalidSegment):
        assert issubclass(refusal_type, MotionError)
    assert issubclass(MotionError, ValueError)


anything = st.one_of(
    st.floats(-1.1 * FARTHEST_M, 1.1 * FARTHEST_M), st.sampled_from([np.nan, np.inf, -np.inf, FARTHEST_M])
)


@LAW
@given(
    arrays(np.float64, (3, 2, 3), elements=anything), arrays(np.float64, 3, elements=anything), st.booleans()
)
def test_what_is_sound_is_what_a_trajectory_takes(track: Floats, times: Floats, in_order: bool) -> None:
    track[0, 0] = track[1, 1] = np.nan
    times = np.sort(times) if in_order else times
    rows = np.column_stack([times, track.reshape(3, 6)])
    try:
        Trajectory(times, track[:, 0], {"cup": track[:, 1]})
    except InvalidTrajectory:
        assert not is_sound(rows, -np.inf)
    else:
        assert is_sound(rows, -np.inf)
        assert not is_sound(rows, times[0])
