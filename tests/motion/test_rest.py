"""Where in a segment the hand moves, without the rest beside it."""

from __future__ import annotations

import numpy as np
import pytest

from app.motion.rest import LEFT, LEFT_AT, movement
from app.motion.trajectory import Floats


def minimum_jerk(seconds: float, before: float, after: float, noise: float = 0.0) -> Floats:
    """Return a movement of 0.3 m at 100 Hz with rest before and after [s]."""
    time = np.linspace(0.0, 1.0, round(seconds * 100) + 1)
    fraction = np.concatenate(
        [
            np.zeros(round(before * 100)),
            10 * time**3 - 15 * time**4 + 6 * time**5,
            np.ones(round(after * 100)),
        ]
    )
    trembling = np.random.default_rng(7).normal(0.0, noise, (len(fraction), 3))
    hand: Floats = np.array([0.3, 0.0, 0.0]) * fraction[:, None] + trembling
    return hand


def test_the_share_of_the_way_and_that_of_the_time_belong_together() -> None:
    assert pytest.approx(LEFT, abs=1e-4) == 10 * LEFT_AT**3 - 15 * LEFT_AT**4 + 6 * LEFT_AT**5


@pytest.mark.parametrize("noise", [0.0, 0.0005, 0.002])
@pytest.mark.parametrize(("before", "after"), [(0.0, 0.0), (0.5, 0.0), (0.0, 2.0), (1.0, 0.3)])
def test_a_movement_is_found_without_the_rest_beside_it(before: float, after: float, noise: float) -> None:
    first, last = movement(minimum_jerk(0.8, before, after, noise))
    assert first == pytest.approx(100 * before, abs=5)
    assert last == pytest.approx(100 * before + 80, abs=5)


def test_a_movement_does_not_end_in_a_dropout() -> None:
    hand = minimum_jerk(0.8, 1.0, 1.0)
    hand[97:105] = hand[175:183] = np.nan
    first, last = movement(hand)
    assert not np.isnan(hand[[first, last]]).any()
    assert (first, last) == pytest.approx((97, 182), abs=2)


@pytest.mark.parametrize("hand", [np.zeros((5, 3)), np.eye(3)[:2], np.zeros((2, 3))])
def test_what_hardly_moves_is_whole(hand: Floats) -> None:
    assert movement(hand) == (0, len(hand) - 1)
