"""Log-likelihood ratios against hmmlearn, against every path, against plain numpy, and by their laws."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hmmlearn.hmm import GaussianHMM
from hypothesis import given, settings
from hypothesis import strategies as st

from app.motion.conditioning import Tracks
from app.motion.features import BLEND, encode
from app.motion.model import (
    N_OF_MOVEMENT,
    N_OF_ROLE,
    PACE,
    PHASE,
    ActionModel,
    Background,
    Model,
)
from app.motion.scoring import MOST_FRAMES, score_segments, states_of
from app.motion.trajectory import Floats, Indices
from tests.motion.drawn import TABLE, model_of, motion_of, named, segments_of
from tests.motion.plain import background, log_densities, viterbi

LAW = settings(derandomize=True, deadline=None, max_examples=50)

seeds = st.integers(0, 2**32 - 1)


def features_of(tracks: Tracks, segment: Sequence[int], filling: Sequence[int]) -> Floats:
    """Return the (n_frames, n_features) features of a segment with these objects in the roles."""
    part = tracks.part(segment[0], segment[1] + 1)
    positions = encode(part.hand, part.objects, TABLE)
    phase = np.linspace(0.0, 1.0, len(positions))
    phase[np.isnan(positions[:, 0])] = np.nan
    of_roles = [column for at in filling for column in (positions[:, 4 + at], part.paces[at])]
    return np.column_stack([positions[:, :4], part.pace, phase, *of_roles])


def ratios(model: Model, motion: Tracks, segments: Indices | Sequence[Sequence[int]]) -> Floats:
    result: Floats = score_segments(
        motion, TABLE, np.array(segments), states_of(model.actions, model.background), named(model)
    )[0]
    return result


def whole(model: Model, motion: Tracks, segment: Sequence[int]) -> Floats:
    return features_of(motion, segment, named(model)[0].tolist())


class Chain(GaussianHMM):  # type: ignore[misc]
    """hmmlearn's HMM with these densities, and a last state that it ends in."""

    def __init__(self, action: ActionModel) -> None:
        n_states = action.n_states
        super().__init__(n_states + 1)
        self.startprob_ = np.eye(n_states + 1)[0]
        self.transmat_ = np.diag(np.append(action.stay, 1.0)) + np.diag(1.0 - action.stay, 1)
        self.means_, self.covars_ = np.zeros((n_states + 1, 1)), np.ones((n_states + 1, 1))
        self.action = action

    def _compute_log_likelihood(self, features: Floats) -> Floats:
        densities = np.full((len(features), self.action.n_states + 1), -np.inf)
        densities[:-1, :-1] = log_densities(self.action, features[:-1])
        densities[-1, -1] = 0.0
        return densities


def by_hmmlearn(action: ActionModel, features: Floats) -> float:
    """Return the same as hmmlearn finds it."""
    log_likelihood, _ = Chain(action).decode(np.vstack([features, features[-1]]))
    return float(log_likelihood)


def by_enumeration(action: ActionModel, features: Floats) -> float:
    """Return the same as the best of all paths."""
    n_frames, density = len(features), log_densities(action, features)
    found: list[float] = []
    for entered in combinations(range(1, n_frames), action.n_states - 1):
        states = np.searchsorted(entered, np.arange(n_frames), side="right")
        left = np.append(np.diff(states) == 1, True)
        steps = np.where(left, 1.0 - action.stay[states], action.stay[states])
        found.append(float(np.log(steps).sum() + density[np.arange(n_frames), states].sum()))
    return max(found)


@LAW
@given(seeds, st.integers(0, 3))
def test_agrees_with_hmmlearn(seed: int, n_objects: int) -> None:
    rng = np.random.default_rng(seed)
    model, motion = model_of(rng, (1, 3, 8), n_objects), motion_of(rng, 40, n_objects)
    segments = np.column_stack([rng.integers(0, 16, 4), rng.integers(24, 40, 4)])
    for segment, of_segment in zip(segments.tolist(), ratios(model, motion, segments), strict=True):
        features = whole(model, motion, segment)
        for action, ratio in zip(model.actions, of_segment, strict=True):
            expected = by_hmmlearn(action, features) - background(model, features)
            assert ratio == pytest.approx(expected, rel=1e-9, abs=1e-8)


@LAW
@given(seeds, st.integers(1, 4), st.integers(4, 8))
def test_is_the_best_of_all_paths(seed: int, n_states: int, n_frames: int) -> None:
    rng = np.random.default_rng(seed)
    model, motion = model_of(rng, (n_states,)), motion_of(rng, n_frames)
    features = whole(model, motion, (0, n_frames - 1))
    [[ratio]] = ratios(model, motion, [(0, n_frames - 1)])
    expected = by_enumeration(model.actions[0], features) - background(model, features)
    assert ratio == pytest.approx(expected, abs=1e-9)


@LAW
@given(seeds)
def test_missing_values_are_summed_out(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model, motion = model_of(rng, (3, 6), 2), motion_of(rng, 40, 2)
    unseen, gone = rng.random(40) < 0.3, rng.random((2, 40)) < 0.3
    motion.hand[unseen], motion.pace[unseen] = np.nan, np.nan
    motion.objects[gone], motion.paces[gone] = np.nan, np.nan
    seen = np.flatnonzero(~np.isnan(motion.hand[:, 0]))
    segments = seen[segments_of(rng, len(seen), 6)]
    for segment, of_segment in zip(segments.tolist(), ratios(model, motion, segments), strict=True):
        features = whole(model, motion, segment)
        expected = [viterbi(action, features) - background(model, features) for action in model.actions]
        np.testing.assert_allclose(of_segment, expected, atol=1e-8)


def test_a_frame_of_which_nothing_is_seen_adds_only_its_step() -> None:
    rng = np.random.default_rng(1)
    model, motion = model_of(rng, (1,)), motion_of(rng, 3)
    for track in (motion.hand, motion.pace, motion.objects[0], motion.paces[0]):
        track[1] = np.nan
    ends = whole(model, motion, (0, 2))[[0, 2]]
    [action] = model.actions
    steps = 2.0 * np.log(action.stay[0]) + np.log(1.0 - action.stay[0])
    expected = log_densities(action, ends).sum() + steps - background(model, ends)
    assert ratios(model, motion, [(0, 2)])[0, 0] == pytest.approx(expected, abs=1e-9)


@LAW
@given(seeds, st.sampled_from([1000.0, 100.0, 39.37]))
def test_the_unit_of_length_does_not_matter(seed: int, unit: float) -> None:
    rng = np.random.default_rng(seed)
    model, motion = model_of(rng, (2, 5)), motion_of(rng, 60)
    segments = segments_of(rng, 60, 8)
    across = motion.hand[segments[:, 1], :2] - motion.hand[segments[:, 0], :2]
    segments = segments[np.linalg.norm(across, axis=1) >= BLEND]
    units = np.full(model.features.n_features, unit)
    units[[PACE, PHASE]] = units[N_OF_MOVEMENT + 1 :: N_OF_ROLE] = 1.0  # a pace and a phase are no lengths
    actions = tuple(
        replace(action, means=units * action.means, variances=units**2 * action.variances)
        for action in model.actions
    )
    states = states_of(actions, Background(units * model.background.width))
    scaled = motion._replace(hand=unit * motion.hand, objects=unit * motion.objects)
    found, _ = score_segments(scaled, unit * TABLE, segments, states, named(model))
    np.testing.assert_allclose(found, ratios(model, motion, segments), atol=1e-8)


@LAW
@given(seeds, st.integers(1, 6))
def test_the_best_filling_counts(seed: int, n_fillings: int) -> None:
    rng = np.random.default_rng(seed)
    model, motion = model_of(rng, (2, 5), 2), motion_of(rng, 40, 4)
    segments, states = segments_of(rng, 40, 5), states_of(model.actions, model.background)
    fillings = rng.integers(0, 4, (n_fillings, 2))
    found, filled = score_segments(motion, TABLE, segments, states, fillings)
    singly = np.array([score_segments(motion, TABLE, segments, states, each[None])[0] for each in fillings])
    np.testing.assert_array_equal(found, singly.max(axis=0))
    np.testing.assert_array_equal(filled, singly.argmax(axis=0))
    for segment, of_segment in zip(segments.tolist(), singly.swapaxes(0, 1), strict=True):
        for filling, of_filling in zip(fillings.tolist(), of_segment, strict=True):
            features = features_of(motion, segment, filling)
            expected = [viterbi(action, features) - background(model, features) for action in model.actions]
            np.testing.assert_allclose(of_filling, expected, atol=1e-8)


@LAW
@given(seeds)
def test_segments_and_classes_do_not_depend_on_each_other(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model, motion = model_of(rng, (2, 5, 3)), motion_of(rng, 50)
    segments = segments_of(rng, 50, 10)
    every, order = ratios(model, motion, segments), rng.permutation(10)
    np.testing.assert_array_equal(ratios(model, motion, segments[order]), every[order])
    for index, segment in enumerate(segments):
        np.testing.assert_array_equal(ratios(model, motion, [segment])[0], every[index])
    for index, action in enumerate(model.actions):
        alone = replace(model, actions=(action,))
        np.testing.assert_array_equal(ratios(alone, motion, segments)[:, 0], every[:, index])


@LAW
@given(seeds)
def test_frames_outside_a_segment_do_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model, motion = model_of(rng, (2, 5)), motion_of(rng, 50)
    [[start, goal]] = segments = segments_of(rng, 50, 1)
    outside = np.ones(50, dtype=bool)
    outside[start : goal + 1] = False
    elsewhere = Tracks(*(track.copy() for track in motion))
    elsewhere.hand[outside], elsewhere.pace[outside] = np.nan, 7.0
    elsewhere.objects[:, outside], elsewhere.paces[:, outside] = 7.0, np.nan
    np.testing.assert_array_equal(ratios(model, elsewhere, segments), ratios(model, motion, segments))


@pytest.mark.parametrize("step", [1, 2, 3])
def test_of_a_long_segment_each_frame_looked_at_counts_for_those_left_out(step: int) -> None:
    rng, last = np.random.default_rng(3), step * MOST_FRAMES + step - 1
    model, motion = model_of(rng, (3, 6)), motion_of(rng, last + 1)
    seen = whole(model, motion, (0, last))[last % step :: step]
    expected = [step * (viterbi(action, seen) - background(model, seen)) for action in model.actions]
    np.testing.assert_allclose(ratios(model, motion, [(0, last)])[0], expected, rtol=1e-9)


def test_fewer_frames_than_states_are_impossible() -> None:
    rng = np.random.default_rng(2)
    model, motion = model_of(rng, (1, 3)), motion_of(rng, 10)
    found = ratios(model, motion, [(4, 4), (4, 5), (4, 6)])
    np.testing.assert_array_equal(np.isfinite(found), [[True, False], [True, False], [True, True]])
    assert (found[~np.isfinite(found)] == -np.inf).all()


def test_no_segments_have_no_ratios() -> None:
    rng = np.random.default_rng(2)
    found = ratios(model_of(rng, (1, 3)), motion_of(rng, 10), np.empty((0, 2), dtype=np.int64))
    assert found.shape == (0, 2)


def test_threads_share_the_work_without_the_lock() -> None:
    assert score_segments.targetoptions["nogil"]
    rng = np.random.default_rng(4)
    model, motion = model_of(rng, (4, 8)), motion_of(rng, 200)
    segments = segments_of(rng, 200, 400)
    with ThreadPoolExecutor(2) as threads:
        halves = list(threads.map(lambda half: ratios(model, motion, half), np.split(segments, 2)))
    np.testing.assert_array_equal(np.concatenate(halves), ratios(model, motion, segments))


@LAW
@given(seeds, st.floats(1.0, 100.0))
def test_far_off_a_segment_does_not_depend_on_the_others_either(seed: int, off: float) -> None:
    rng = np.random.default_rng(seed)
    model, motion = model_of(rng, (8, 20)), motion_of(rng, 120)
    model = replace(model, actions=tuple(replace(each, durations=np.ones(2)) for each in model.actions))
    motion = motion._replace(hand=off * motion.hand, objects=off * motion.objects)
    segments = segments_of(rng, 120, 12)
    every = ratios(model, motion, segments)
    for index, segment in enumerate(segments):
        np.testing.assert_array_equal(ratios(model, motion, [segment])[0], every[index])
