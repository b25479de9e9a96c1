"""What a movement under way may become: against plain numpy, and movements that go as their class does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.motion.conditioning import Tracks
from app.motion.features import alignment
from app.motion.foresight import AIM, MOST_FRAMES, PHASES, Foresight, course_of
from app.motion.model import PHASE, Model
from app.motion.roles import fillings
from app.motion.simulation import demonstrations
from app.motion.training import conditioned
from app.motion.trajectory import Floats
from tests.motion.plain import background, best_paths

LAW = settings(derandomize=True, deadline=None, max_examples=20)

ONE = fillings(["object"], ["object"])
SHOWN = demonstrations(9)[::40]


def features_of(tracks: Tracks, origin: int, through: int, goal: Floats, duration: float) -> Floats:
    """Return the features of the frames so far of a movement to a goal."""
    part, start = tracks.part(origin, through + 1), tracks.hand[origin]
    phase = np.arange(len(part.pace)) / duration
    off = part.hand - start * (1.0 - phase[:, None]) - goal * phase[:, None]
    deviation = off @ alignment(start, goal).T
    distance = np.linalg.norm(part.objects[0] - part.hand, axis=1)
    return np.column_stack([deviation, part.hand[:, 2], part.pace, phase, distance, part.paces[0]])


@pytest.mark.parametrize(("origin", "through"), [(0, 12), (3, 25), (0, 31)])
def test_is_what_its_formula_says(trained: Model, origin: int, through: int) -> None:
    for shown in SHOWN:
        tracks = conditioned(shown, trained.features)
        found = Foresight(trained, 0.0, ONE)(tracks, origin, through)
        for k, action in enumerate(trained.actions):
            for p, phase in enumerate(PHASES):
                goal, duration = found.goals[k, p], (through - origin) / phase
                features = features_of(tracks, origin, through, goal, duration)
                ratio = best_paths(action, features).max() - background(trained, features)
                far = np.linalg.norm(goal - tracks.hand[origin])
                slow = (np.log(duration / trained.features.rate) - action.tempo[0]) / action.tempo[1]
                long = (np.log(far) - action.extent[0]) / action.extent[1]
                value = trained.evidence * ratio - 0.5 * (slow**2 + long**2) - np.log(len(PHASES))
                assert found.values[k, p] == pytest.approx(value, rel=1e-6)
                assert found.spreads[k, p] == pytest.approx(AIM * far * (1.0 - phase))


def test_the_mean_course_runs_through_the_states(trained: Model) -> None:
    rng = np.random.default_rng(1)
    means = rng.normal(0.0, 0.05, (len(PHASES), trained.features.n_features))
    means[:, PHASE] = PHASES
    action = replace(trained.actions[0], means=means)
    course = course_of(replace(trained, actions=(action,)))
    np.testing.assert_allclose(course.way[0], PHASES + means[:, 0] / np.exp(action.extent[0]))
    np.testing.assert_allclose(course.aside[0], means[:, 1:3])


@LAW
@given(st.floats(-np.pi, np.pi), st.floats(-0.3, 0.3), st.integers(0, 3))
def test_a_movement_that_goes_as_its_class_goes_to_its_goal(
    trained: Model, heading: float, rise: float, k: int
) -> None:
    """From the middle on it is found from where the hand is alone, to a tenth of the way that is left."""
    course = course_of(trained)
    start, length = np.array([0.1, -0.2, 0.3]), float(np.exp(trained.actions[k].extent[0]))
    direction = np.array([np.cos(heading) * np.cos(rise), np.sin(heading) * np.cos(rise), np.sin(rise)])
    goal = start + length * direction
    rotation = alignment(start, goal)
    for p in np.flatnonzero(PHASES >= 0.5):
        offset = np.array([length * course.way[k, p], *course.aside[k, p]])
        here = start + offset @ rotation
        hand = np.linspace(start, here, 20)
        tracks = Tracks(hand, np.zeros(20), goal + np.zeros((1, 20, 3)), np.zeros((1, 20)))
        found = Foresight(trained, 0.0, ONE)(tracks, 0, 19).goals[k, p]
        left = float(np.linalg.norm(goal - here))
        assert np.linalg.norm(found - goal) <= 0.1 * left + 1e-3


@LAW
@given(st.floats(-np.pi, np.pi), st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)))
def test_turns_with_the_world(trained: Model, turn: float, shift: tuple[float, float]) -> None:
    c, s = np.cos(turn), np.sin(turn)
    rotation, offset = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([*shift, 0.0])
    tracks = conditioned(SHOWN[0], trained.features)
    turned = tracks._replace(
        hand=tracks.hand @ rotation.T + offset, objects=tracks.objects @ rotation.T + offset
    )
    one, other = (Foresight(trained, 0.0, ONE)(each, 2, 20) for each in (tracks, turned))
    np.testing.assert_allclose(other.values, one.values, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(other.goals, one.goals @ rotation.T + offset, atol=1e-6)
    np.testing.assert_allclose(other.spreads, one.spreads, atol=1e-6)


def test_frames_outside_do_not_matter(trained: Model) -> None:
    tracks = conditioned(SHOWN[0], trained.features)
    elsewhere = Tracks(*(track.copy() for track in tracks))
    for outside in (slice(0, 2), slice(21, None)):
        elsewhere.hand[outside], elsewhere.pace[outside] = np.nan, 9.0
        elsewhere.objects[:, outside], elsewhere.paces[:, outside] = 9.0, np.nan
    for one, other in zip(
        *(Foresight(trained, 0.0, ONE)(each, 2, 20) for each in (tracks, elsewhere)), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def evidence_of(model: Model, tracks: Tracks, through: int) -> Floats:
    """Return the (n_classes, n_phases) values without what durations and lengths are worth."""
    found = Foresight(model, 0.0, ONE)(tracks, 0, through)
    tempo, extent = (
        np.array(pairs).T for pairs in zip(*((a.tempo, a.extent) for a in model.actions), strict=True)
    )
    slow = (np.log(through / PHASES / model.features.rate) - tempo[0][:, None]) / tempo[1][:, None]
    far = np.linalg.norm(found.goals - tracks.hand[0], axis=2)
    off = (np.log(far) - extent[0][:, None]) / extent[1][:, None]
    result: Floats = found.values + 0.5 * (slow**2 + off**2) + np.log(len(PHASES))
    return result


def test_every_second_frame_of_a_long_movement_counts_for_two(trained: Model) -> None:
    tracks = conditioned(SHOWN[0], trained.features)
    at = np.linspace(0, len(tracks.pace) - 1, 2 * MOST_FRAMES + 1).astype(int)
    slow, fast = (
        Tracks(tracks.hand[of], tracks.pace[of], tracks.objects[:, of], tracks.paces[:, of])
        for of in (at, at[::2])
    )
    every_second = evidence_of(trained, slow, 2 * MOST_FRAMES)
    np.testing.assert_allclose(every_second, 2.0 * evidence_of(trained, fast, MOST_FRAMES), rtol=1e-6)


def test_the_likely_goal_of_a_demonstration_comes_nearer(trained: Model) -> None:
    off = np.zeros((len(SHOWN), 3))
    for row, shown in zip(off, SHOWN, strict=True):
        tracks = conditioned(shown, trained.features)
        last = len(tracks.pace) - 1
        for at, share in enumerate((0.4, 0.7, 1.0)):
            found = Foresight(trained, 0.0, ONE)(tracks, 0, round(share * last))
            goal = found.goals[np.unravel_index(found.values.argmax(), found.values.shape)]
            row[at] = np.linalg.norm(goal - tracks.hand[-1])
    early, later, at_last = off.mean(axis=0)
    assert at_last < later < early
    assert at_last < 0.05
