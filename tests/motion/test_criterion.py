"""The criterion by its formula, rest by its laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.motion.criterion import LEAST_REST, NEARER, Criterion
from app.motion.model import PACE_SPREAD, Model
from app.motion.roles import fillings
from app.motion.scoring import score_segments, states_of
from app.motion.simulation import demonstrations
from app.motion.training import conditioned

TABLE = 0.02
ONE = fillings(["object"], ["object"])
SEGMENTS = np.array([[0, 20], [0, 33], [5, 33], [10, 30]])


def test_weighs_ratios_and_durations(trained: Model) -> None:
    tracks = conditioned(demonstrations(3)[0], trained.features)
    found = Criterion(trained, TABLE, ONE)(tracks, SEGMENTS)
    ratios, filled = score_segments(
        tracks, TABLE, SEGMENTS, states_of(trained.actions, trained.background), ONE
    )
    seconds = (SEGMENTS[:, 1] - SEGMENTS[:, 0]) / trained.features.rate
    n_frames = (SEGMENTS[:, 1] - SEGMENTS[:, 0] + 1)[:, None]
    way = np.linalg.norm(tracks.hand[SEGMENTS[:, 1]] - tracks.hand[SEGMENTS[:, 0]], axis=1)
    for action, of_class, ratio in zip(trained.actions, found.criterion.T, ratios.T, strict=True):
        logs = np.log(action.durations)
        off = (np.log(seconds) - logs.mean()) / max(logs.std(ddof=1), PACE_SPREAD)
        near = way < action.lengths.min() / NEARER
        expected = np.where(near, -np.inf, trained.evidence * ratio - 0.5 * off**2)
        np.testing.assert_allclose(of_class, expected, atol=1e-9)
    np.testing.assert_allclose(found.ratio, ratios / n_frames)
    np.testing.assert_array_equal(found.filling, filled)


@pytest.mark.parametrize(("share", "possible"), [(0.9, False), (1.1, True)])
def test_an_action_goes_some_way(trained: Model, share: float, possible: bool) -> None:
    action = trained.action("grasp")
    tracks = conditioned(demonstrations(3)[0], trained.features)
    hand = np.zeros_like(tracks.hand)
    hand[:, 0] = np.linspace(0.0, share * action.lengths.min() / NEARER, len(hand))
    whole = np.array([[0, len(hand) - 1]])
    found = Criterion(trained, 0.0, ONE)(tracks._replace(hand=hand), whole).criterion
    assert np.isfinite(found[0, trained.names.index("grasp")]) == possible


@given(st.lists(st.floats(-6.0, 3.0), min_size=2, max_size=10))
def test_rest_counts_the_same_up_to_its_pace_and_less_beyond(trained: Model, paces: list[float]) -> None:
    criterion, pace = Criterion(trained, 0.0, ONE), np.sort(paces)
    counted = criterion.rest(pace)
    np.testing.assert_allclose(counted[pace <= trained.rest.pace], criterion.typical)
    assert (np.diff(counted) <= 0.0).all()
    assert (counted >= criterion.typical + LEAST_REST).all()


def test_a_spread_faster_than_rest_costs_what_one_of_a_gaussian_does(trained: Model) -> None:
    criterion, rest = Criterion(trained, 0.0, ONE), trained.rest
    slow, fast = criterion.rest(np.array([rest.pace, rest.pace + rest.spread]))
    assert slow - fast == pytest.approx(0.5)


def test_a_dropout_is_no_evidence_of_rest(trained: Model) -> None:
    assert Criterion(trained, 0.0, ONE).rest(np.array([np.nan])) == [0.0]


def test_what_is_typical_is_what_a_frame_of_a_demonstration_counts(trained: Model) -> None:
    """Averaged over classes; durations, which nearly all are typical in, left aside."""
    criterion, ratios = Criterion(trained, 0.0, ONE), []
    for shown in demonstrations(1):
        tracks = conditioned(shown, trained.features)
        scores = criterion(tracks, np.array([[0, len(tracks.pace) - 1]]))
        ratios.append((shown.action, scores.ratio[0, trained.names.index(shown.action)]))
    of_classes = [np.mean([ratio for action, ratio in ratios if action == name]) for name in trained.names]
    assert criterion.typical == pytest.approx(trained.evidence * np.mean(of_classes))
    np.testing.assert_allclose(trained.familiarity.typical, of_classes)
