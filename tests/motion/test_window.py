"""What a recogniser remembers of its stream."""

from __future__ import annotations

import numpy as np
import pytest

from app.motion.conditioning import Conditioned, Tracks
from app.motion.model import Model
from app.motion.roles import fillings
from app.motion.trajectory import Floats, Scene
from app.motion.window import Window

ONE = fillings(["object"], ["object"])


def ready_of(hand: Floats, pace: Floats, first: int = 0) -> Conditioned:
    """Return points whose frames have twice their number."""
    n, objects = len(hand), np.zeros((1, len(hand), 3))
    numbers = first + np.arange(n)
    return Conditioned(
        Tracks(hand, pace, objects, np.zeros((1, n))), numbers / 50.0, 2 * numbers, 2 * numbers
    )


def window_of(model: Model, hand: Floats, pace: Floats, capacity: int = 200) -> Window:
    window, ready = Window(model, Scene(), ONE, 1, capacity), ready_of(hand, pace)
    for index in range(len(hand)):
        window.append(ready, index, 0)
    return window


def slowing(n: int, slowest: int) -> tuple[Floats, Floats]:
    """Return a hand, and a pace that is least at a point and the same on either side of it."""
    hand = np.linspace([0.0, 0.0, 0.0], [0.5, 0.0, 0.0], n)
    return hand, -3.0 + 0.3 * np.minimum(np.abs(np.arange(n) - slowest), 6.0)


@pytest.mark.parametrize("boundary", [48, 50, 52])
def test_a_boundary_is_drawn_to_where_the_hand_is_slowest(trained: Model, boundary: int) -> None:
    found = window_of(trained, *slowing(100, 50)).turn(boundary)
    assert abs(found - 50) <= abs(boundary - 50)


@pytest.mark.parametrize("boundary", [0, 1, 98, 99])
def test_a_boundary_stays_within_what_is_there(trained: Model, boundary: int) -> None:
    assert 0 <= window_of(trained, *slowing(100, 50)).turn(boundary) < 100


def test_a_boundary_is_not_drawn_into_a_dropout(trained: Model) -> None:
    hand, pace = slowing(100, 50)
    hand[49:52], pace[49:52] = np.nan, np.nan
    assert window_of(trained, hand, pace).turn(48) not in (49, 50, 51)
    assert window_of(trained, hand, pace).turn(50) == 50


def test_what_is_kept_stays_the_same_when_the_rest_is_forgotten(trained: Model) -> None:
    rng = np.random.default_rng(1)
    hand, pace = rng.normal(0.0, 0.1, (300, 3)), rng.normal(-1.0, 0.5, 300)
    whole, small = window_of(trained, hand, pace, 400), Window(trained, Scene(), ONE, 1, 60)
    ready = ready_of(hand, pace)
    for index in range(300):
        small.append(ready, index, max(index - 40, 0))
        kept = np.arange(max(index - 30, 0), index + 1)
        segments = np.column_stack([kept[:-10], kept[10:]])[:4]
        if len(segments) and index % 7 == 0:
            for one, other in zip(small.scores(segments), whole.scores(segments), strict=True):
                np.testing.assert_array_equal(one, other)
            assert small.rest(int(kept[0]), index) == whole.rest(int(kept[0]), index)
            assert small.frame_of(index) == whole.frame_of(index) == (2 * index, index / 50.0)


def test_points_ahead_are_there_until_the_next_are_taken(trained: Model) -> None:
    rng = np.random.default_rng(2)
    hand, pace = rng.normal(0.0, 0.1, (30, 3)), rng.normal(-1.0, 0.5, 30)
    window = window_of(trained, hand[:20], pace[:20])
    assert window.look_ahead(ready_of(hand[20:26], pace[20:26], first=20)) == 25
    assert window.n_points == 20
    assert window.seen(25)
    assert window.frame_of(25) == (50, 0.5)
    window.append(ready_of(hand[20:] + 1.0, pace[20:], first=20), 0, 0)
    np.testing.assert_array_equal(window.hand(20, 20)[0], hand[20] + 1.0)


def test_segments_that_end_in_dropouts_cannot_be(trained: Model) -> None:
    hand, pace = slowing(100, 50)
    hand[10], hand[60] = np.nan, np.nan
    window = window_of(trained, hand, pace)
    possible = np.isfinite(window.scores(np.array([[10, 40], [20, 60], [20, 61]])).ratio).any(axis=1)
    np.testing.assert_array_equal(possible, [False, False, True])
    assert window.outlook(10, 40) is None
    assert window.outlook(20, 60) is None
    assert window.outlook(20, 61) is not None
