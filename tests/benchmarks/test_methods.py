"""The other methods find something sensible where they can, and fail where they must."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from app.motion.evaluation import Evaluation, evaluate
from app.motion.model import Model
from app.motion.simulation import demonstrations, recording
from app.motion.trajectory import Demonstration, Recording, Segment, Trajectory
from benchmarks.change_points import ChangePoints, changes
from benchmarks.garbage_model import CODEBOOK, GarbageModel, symbols
from benchmarks.joined_hmm import left_right, train_positions, train_velocities
from benchmarks.methods import OURS, Find, train
from benchmarks.points import RATE, points, streams

TRAINING_SEED = 1
"""That of the fixture ``trained``."""

TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def every(trained: Model) -> dict[str, Find]:
    return train(demonstrations(TRAINING_SEED), trained)


@cache
def _recordings() -> tuple[Recording, ...]:
    return tuple(recording(100 + seed) for seed in range(8))


def _measured(find: Find, recordings: Sequence[Recording]) -> Evaluation:
    return evaluate([(each.trajectory.times, each.segments, find(each.trajectory)) for each in recordings])


def _turned(trajectory: Trajectory) -> Trajectory:
    objects = {name: track @ TURNED.T for name, track in trajectory.objects.items()}
    return Trajectory(trajectory.times, trajectory.hand @ TURNED.T, objects)


def _still(seconds: float) -> Trajectory:
    n_frames = round(seconds * 100)
    at = np.tile([0.1, 0.2, 0.3], (n_frames, 1))
    return Trajectory(np.arange(n_frames) / 100, at, {"object": at + 0.5})


@pytest.mark.parametrize(
    ("name", "f1_50", "delineated"),
    [
        (OURS, 0.95, 0.95),
        ("Steps 1-3", 0.95, 0.9),
        ("greedy", 0.9, 0.8),
        ("one HMM, positions", 0.6, 0.05),
        ("one HMM, velocities", 0.7, 0.6),
        ("change points", 0.7, 0.4),
        ("garbage model", 0.4, 0.15),
    ],
)
def test_every_method_finds_clean_motion(
    every: dict[str, Find], name: str, f1_50: float, delineated: float
) -> None:
    measured = _measured(every[name], _recordings())
    assert (measured.f1_50 or 0.0) >= f1_50
    assert (measured.delineated or 0.0) >= delineated
    assert (measured.classified_of_delineated or 0.0) >= 0.9


def test_only_the_others_know_where_the_table_stood(every: dict[str, Find]) -> None:
    turned = [Recording(_turned(each.trajectory), each.segments) for each in _recordings()]
    for name in ("one HMM, positions", "one HMM, velocities", "garbage model"):
        before, after = (_measured(every[name], those).f1_50 or 0.0 for those in (_recordings(), turned))
        assert after < 0.85 * before, name
    assert (_measured(every[OURS], turned).f1_50 or 0.0) > 0.95


def test_a_hand_that_stands_still_does_nothing(every: dict[str, Find]) -> None:
    for name in (OURS, "change points", "garbage model"):
        assert every[name](_still(3.0)) == [], name


def test_one_hmm_has_nothing_but_actions(every: dict[str, Find]) -> None:
    for name in ("one HMM, positions", "one HMM, velocities"):
        for each in _recordings():
            found = every[name](each.trajectory)
            assert found[0].start == 0
            assert 0 <= len(each.trajectory) - found[-1].end <= 1
            assert all(a.end == b.start for a, b in pairwise(found))


def test_a_chain_stays_or_goes_on_as_long_as_it_should() -> None:
    transitions = left_right([4.0, 2.0])
    np.testing.assert_allclose(transitions, [[0.75, 0.25, 0.0], [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("train_hmm", [train_positions, train_velocities, GarbageModel])
def test_training_is_the_same_again(train_hmm: type[GarbageModel]) -> None:
    shown = demonstrations(TRAINING_SEED)
    motion = recording(7).trajectory
    assert train_hmm(shown)(motion) == train_hmm(shown)(motion)


def test_a_direction_is_the_nearest_of_the_codebook() -> None:
    assert len(np.unique(CODEBOOK.round(6), axis=0)) == 26
    moving = np.concatenate([CODEBOOK * 0.3, CODEBOOK[:1] * 0.01])[:, None]
    np.testing.assert_array_equal(symbols(moving), np.arange(27).clip(max=26))


def test_changes_lie_where_the_direction_changes() -> None:
    along, across = np.array([0.4, 0.0, 0.0]), np.array([0.0, 0.4, 0.0])
    velocities = np.repeat([along, across, -along], [40, 30, 50], axis=0)[:, None]
    assert changes(velocities, 5.0) == [40, 70, 120]
    assert changes(velocities, 1e6) == [120]


def test_the_penalty_is_set_by_the_demonstrations(trained: Model) -> None:
    shown = demonstrations(TRAINING_SEED)
    penalty = ChangePoints(shown, trained).penalty
    found = [len(changes(each.velocities, penalty)) for each in streams(shown, ("object",))]
    assert abs(np.mean(found) - 3) < 0.75


def test_points_bridge_what_is_missing_and_know_their_frames() -> None:
    times = np.arange(200) / 100
    hand = np.column_stack([times * 0.3, times * 0.0, times * 0.0 + 0.1])
    hand[80:120] = np.nan
    seen = points(Trajectory(times, hand), ())
    inner = slice(10, -10)
    np.testing.assert_allclose(seen.positions[inner, 0, 0], 0.3 * np.arange(100)[inner] / RATE, atol=1e-3)
    np.testing.assert_allclose(seen.velocities[inner, 0], np.tile([0.3, 0, 0], (80, 1)), atol=0.02)
    np.testing.assert_array_equal(times[seen.frames], np.arange(100) / RATE)
    assert seen.segments([(0, 50, "a"), (50, 100, None)]) == [Segment(0, 100, "a"), Segment(100, 199)]


def test_streams_hold_each_demonstration_once() -> None:
    shown = demonstrations(TRAINING_SEED)[::20]
    joined = streams(shown, ("object",))
    actions = [segment.action for each in joined for segment in each.truth]
    assert sorted(str(action) for action in actions) == sorted(each.action for each in shown)
    for each in joined:
        assert each.truth[0].start == 0
        assert each.truth[-1].end == len(each.velocities)
    assert [each.truth for each in streams(shown, ("object",))] == [each.truth for each in joined]


def test_an_action_that_was_not_shown_is_not_found() -> None:
    shown: list[Demonstration] = [each for each in demonstrations(TRAINING_SEED) if each.action != "grasp"]
    for train_method in (train_positions, train_velocities, GarbageModel):
        find = train_method(shown)
        found = {segment.action for each in _recordings() for segment in find(each.trajectory)}
        assert "grasp" not in found
        assert found
