"""Laws of the features: inverse, invariance, continuity, and what they do where something is missing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from app.motion.errors import InvalidTrajectory
from app.motion.features import BLEND, N_DEVIATIONS, alignment, decode, encode, line
from app.motion.trajectory import Floats

LAW = settings(derandomize=True, deadline=None)

HERE = np.zeros(3)
FLIP = np.array([-BLEND / 2, 0.0, 0.0])
"""The movement whose blended direction is nothing; with any height on it, its heading is."""

coordinates = st.floats(-3.0, 3.0)
points = arrays(np.float64, 3, elements=coordinates)
angles = st.floats(-np.pi, np.pi)
kinds = st.sampled_from(
    [
        (1.0, 1.0, 1.0),
        (1.0, 1.0, 0.0),
        (0.0, 0.0, 1.0),
        (1e-3, 1e-3, 1.0),
        (1e-3, 1e-3, 1e-3),
        (0.0, 0.0, 0.0),
    ]
)
"""Displacements of any kind, level, vertical, almost vertical, very short, and none at all."""
displacements = st.builds(lambda by, kind: by * np.array(kind), points, kinds)


@st.composite
def headed(draw: st.DrawFn) -> Floats:
    """Draw a displacement whose heading means something."""
    azimuth, across = draw(angles), draw(st.floats(1.001 * BLEND, 3.0))
    return np.array([across * np.cos(azimuth), across * np.sin(azimuth), draw(coordinates)])


@st.composite
def upright(draw: st.DrawFn) -> Floats:
    """Draw a displacement whose direction means something, its heading perhaps nothing."""
    x, y = draw(st.floats(-BLEND, BLEND)), draw(st.floats(-BLEND, BLEND))
    return np.array([x, y, draw(st.floats(BLEND, 3.0)) * draw(st.sampled_from([-1, 1]))])


@st.composite
def movements(draw: st.DrawFn, by: st.SearchStrategy[Floats] = displacements) -> tuple[Floats, Floats]:
    """Draw a hand (n_frames, 3) between any two ends, and objects (n_objects, n_frames, 3)."""
    n_frames, n_objects = draw(st.integers(2, 8)), draw(st.integers(0, 3))
    hand = draw(arrays(np.float64, (n_frames, 3), elements=coordinates))
    hand[-1] = hand[0] + draw(by)
    return hand, draw(arrays(np.float64, (n_objects, n_frames, 3), elements=coordinates))


def flips(by: Floats) -> bool:
    """Return whether a displacement lies where the alignment cannot be continuous."""
    return bool(np.hypot(by[0] - FLIP[0], by[1]) < BLEND / 5)


def turn(angle: float) -> Floats:
    """Return the rotation about up."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


@LAW
@given(movements())
def test_decode_inverts_encode(movement: tuple[Floats, Floats]) -> None:
    hand, objects = movement
    deviation = encode(hand, objects, 0.0)[:, :N_DEVIATIONS]
    decoded = decode(deviation, hand[0], hand[-1])
    np.testing.assert_allclose(decoded, hand, atol=1e-12)
    np.testing.assert_array_equal(decoded[[0, -1]], hand[[0, -1]])


@LAW
@given(arrays(np.float64, (6, 3), elements=coordinates), points, displacements)
def test_encode_inverts_decode(deviation: Floats, start: Floats, by: Floats) -> None:
    deviation[[0, -1]] = 0.0
    hand = decode(deviation, start, start + by)
    assume(not flips(hand[-1] - hand[0]))
    np.testing.assert_allclose(encode(hand, np.empty((0, 6, 3)), 0.0)[:, :3], deviation, atol=1e-10)


@LAW
@given(movements(), points)
def test_features_do_not_change_where_everything_is_moved(
    movement: tuple[Floats, Floats], by: Floats
) -> None:
    hand, objects = movement
    assume(not flips(hand[-1] - hand[0]))
    here = encode(hand, objects, 0.7)
    np.testing.assert_allclose(encode(hand + by, objects + by, 0.7 + by[2]), here, atol=1e-10)
    across = by * [1.0, 1.0, 0.0]
    np.testing.assert_allclose(encode(hand + across, objects + across, 0.7), here, atol=1e-10)


@LAW
@given(movements(headed()), angles)
def test_features_do_not_change_where_everything_is_turned_about_up(
    movement: tuple[Floats, Floats], angle: float
) -> None:
    hand, objects = movement
    turned = encode(hand @ turn(angle).T, objects @ turn(angle).T, 0.7)
    np.testing.assert_allclose(turned, encode(hand, objects, 0.7), atol=1e-10)


@LAW
@given(displacements)
@example(FLIP)
@example(np.array([*FLIP[:2], 0.3]))
@example(np.array([*FLIP[:2], -0.3]))
@example(np.array([FLIP[0], 1e-200, 0.0]))
@example(np.array([FLIP[0], 1e-15, 1e-12]))
@example(np.array([0.0, 0.0, 1e-200]))
def test_alignment_is_always_a_rotation(by: Floats) -> None:
    rotation = alignment(HERE, by)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


@LAW
@given(displacements, points)
def test_a_nanometre_hardly_turns_the_alignment(by: Floats, towards: Floats) -> None:
    assume(not flips(by))
    nudged = by + 1e-9 * towards / 3.0
    np.testing.assert_allclose(alignment(HERE, nudged), alignment(HERE, by), atol=1e-5)


@pytest.mark.parametrize("azimuth", np.radians([0.0, 20.0, 90.0, 160.0, -160.0, -45.0]))
@pytest.mark.parametrize("rise", [0.3, -0.3, 0.0, 0.004])
def test_alignment_is_continuous_through_vertical_and_through_nothing(azimuth: float, rise: float) -> None:
    """A movement that turns upright and over, or shrinks to nothing and goes the other way."""
    across = np.linspace(0.02, -0.02, 40_001)
    if np.cos(azimuth) in (1.0, -1.0):
        across = across[across > 0.0]
    path = across[:, None] * [np.cos(azimuth), np.sin(azimuth), 0.0] + [0.0, 0.0, rise]
    rotations = np.array([alignment(HERE, by) for by in path])
    assert np.abs(np.diff(rotations, axis=0)).max() < 0.01


def test_movements_of_no_length_are_aligned_with_the_world() -> None:
    np.testing.assert_array_equal(alignment(HERE, HERE), np.eye(3))


@LAW
@given(points, headed() | upright())
def test_goal_lies_on_the_first_axis(start: Floats, by: Floats) -> None:
    goal = start + by
    aligned = alignment(start, goal) @ (goal - start)
    length = float(np.linalg.norm(goal - start))
    np.testing.assert_allclose(aligned, [length, 0.0, 0.0], atol=1e-12)


@LAW
@given(headed())
def test_third_axis_stays_up(by: Floats) -> None:
    rotation = alignment(HERE, by)
    assert rotation[2, 2] > 0.0
    assert rotation[1, 2] == pytest.approx(0.0, abs=1e-12)  # so that up has no part to the side


@LAW
@given(movements(), st.data())
def test_dropouts_stay_and_do_not_spread(movement: tuple[Floats, Floats], data: st.DataObject) -> None:
    hand, objects = movement
    whole = encode(hand, objects, 0.0)
    unseen = data.draw(arrays(np.bool_, len(hand)))
    unseen[[0, -1]] = False
    lost = data.draw(arrays(np.bool_, objects.shape[:2]))
    seen, tracked = hand.copy(), objects.copy()
    seen[unseen], tracked[lost] = np.nan, np.nan
    expected = whole.copy()
    expected[unseen] = np.nan
    expected[:, 4:][lost.T] = np.nan
    np.testing.assert_array_equal(encode(seen, tracked, 0.0), expected)


@pytest.mark.parametrize(("missing", "frame"), [((0,), 0), ((4,), 4), ((0, 4), 0)])
def test_an_end_point_that_is_a_dropout_is_refused(missing: tuple[int, ...], frame: int) -> None:
    hand = np.ones((5, 3))
    hand[list(missing)] = np.nan
    with pytest.raises(InvalidTrajectory, match=f"hand, frame {frame}: .*dropout") as refused:
        encode(hand, np.empty((0, 5, 3)), 0.0)
    assert (refused.value.field, refused.value.frame) == ("hand", frame)


def test_a_movement_without_frames_is_refused() -> None:
    with pytest.raises(InvalidTrajectory, match="hand"):
        encode(np.empty((0, 3)), np.empty((0, 0, 3)), 0.0)


@LAW
@given(movements(), coordinates)
def test_context_is_height_and_the_distance_to_each_object(
    movement: tuple[Floats, Floats], table_height: float
) -> None:
    hand, objects = movement
    features = encode(hand, objects, table_height)
    assert features.shape == (len(hand), 4 + len(objects))
    np.testing.assert_array_equal(features[:, 3], hand[:, 2] - table_height)
    for column, track in zip(features[:, 4:].T, objects, strict=True):
        np.testing.assert_allclose(column, np.sqrt(((hand - track) ** 2).sum(axis=1)), atol=1e-12)


@LAW
@given(st.integers(1, 50), points, displacements)
def test_the_straight_movement_at_even_speed_does_not_deviate(
    n_frames: int, start: Floats, by: Floats
) -> None:
    hand = line(start, start + by, n_frames)
    features = encode(hand, np.empty((0, n_frames, 3)), 0.0)
    np.testing.assert_allclose(features[:, :3], 0.0, atol=1e-12)


@LAW
@given(points, displacements, st.integers(2, 50))
def test_the_line_meets_both_ends_at_regular_intervals(start: Floats, by: Floats, n_frames: int) -> None:
    points_on = line(start, start + by, n_frames)
    np.testing.assert_array_equal(points_on[[0, -1]], [start, start + by])
    np.testing.assert_allclose(
        np.diff(points_on, axis=0), np.tile(by / (n_frames - 1), (n_frames - 1, 1)), atol=1e-12
    )


def test_start_is_goal() -> None:
    hand = np.array([[0.1, 0.2, 0.3], [0.2, 0.2, 0.5], [0.1, 0.2, 0.3]])
    features = encode(hand, np.empty((0, 3, 3)), 0.1)
    np.testing.assert_allclose(features, [[0, 0, 0, 0.2], [0.1, 0, 0.2, 0.4], [0, 0, 0, 0.2]], atol=1e-12)
    np.testing.assert_allclose(encode(hand[:1], np.empty((0, 1, 3)), 0.1), [[0, 0, 0, 0.2]], atol=1e-12)
