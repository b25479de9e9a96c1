"""Laws of the paper's plain method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson

from app.motion.features import BLEND, alignment
from app.motion.generation import generate
from app.motion.keypoints import keypoint_phases, plain_course_of
from app.motion.model import Model
from app.motion.simulation import STYLES
from app.motion.trajectory import Floats
from tests.motion.drawn import model_of

START, GOAL = np.array([0.1, 0.3, 0.04]), np.array([-0.2, 0.25, 0.04])
FINE = np.linspace(0.0, 1.0, 2001)

coordinates = st.floats(-3.0, 3.0)
points = st.tuples(coordinates, coordinates, coordinates).map(np.array)
actions = st.sampled_from(sorted(STYLES))


@settings(max_examples=25)
@given(actions, points, points)
def test_plain_movement_meets_its_ends_but_need_not_rest_there(
    trained: Model, action: str, start: Floats, goal: Floats
) -> None:
    assume(np.linalg.norm(goal - start) >= BLEND)
    motion = generate(trained, action, start, goal, rate=500.0, method="paper")
    np.testing.assert_array_equal(motion.positions[[0, -1]], [start, goal])
    np.testing.assert_array_equal(motion.std[[0, -1]], np.zeros((2, 3)))
    assert np.isfinite(motion.std).all()
    assert np.linalg.norm(motion.velocities[0]) > 0.0
    travelled = cumulative_simpson(motion.velocities, x=motion.times, axis=0, initial=0.0)
    np.testing.assert_allclose(motion.positions - start, travelled, atol=1e-4)
    gained = cumulative_simpson(motion.accelerations, x=motion.times, axis=0, initial=0.0)
    np.testing.assert_allclose(motion.velocities - motion.velocities[0], gained, atol=1e-3)


@pytest.mark.parametrize("action", sorted(STYLES))
def test_plain_course_passes_near_the_keypoints(trained: Model, action: str) -> None:
    chain = trained.action(action)
    at = keypoint_phases(chain)
    missed = np.abs(plain_course_of(chain).derivative(at, 0) - chain.means[:, :3])
    assert (missed <= 1.5 * np.sqrt(chain.variances[:, :3])).all()


@pytest.mark.parametrize("action", sorted(STYLES))
def test_plain_movement_is_its_course_between_the_ends(trained: Model, action: str) -> None:
    motion = generate(trained, action, START, GOAL, rate=100.0, duration=1.0, method="paper")
    course = plain_course_of(trained.action(action)).of_length(float(np.linalg.norm(GOAL - START)))
    axes = alignment(START, GOAL)
    np.testing.assert_allclose(
        (motion.positions - START) @ axes.T, course.derivative(motion.times, 0), atol=1e-9
    )
    np.testing.assert_allclose(motion.velocities @ axes.T, course.derivative(motion.times, 1), atol=1e-9)
    assert np.linalg.norm(motion.velocities[0]) > 0.01


@pytest.mark.parametrize("action", sorted(STYLES))
def test_keypoints_known_well_are_met(trained: Model, action: str) -> None:
    chain = trained.action(action)
    known = replace(chain, variances=np.full_like(chain.variances, 1e-12))
    course = plain_course_of(known)
    np.testing.assert_allclose(course.derivative(keypoint_phases(known), 0), known.means[:, :3], atol=1e-4)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("action", sorted(STYLES))
def test_each_derivative_of_a_plain_course_integrates_to_the_one_before(
    trained: Model, action: str, order: int
) -> None:
    course = plain_course_of(trained.action(action)).of_length(0.4)
    inside = FINE[1:-1]
    gained = cumulative_simpson(course.derivative(inside, order), x=inside, axis=0, initial=0.0)
    before = course.derivative(inside, order - 1)
    np.testing.assert_allclose(before - before[0], gained, atol=1e-6)


@pytest.mark.parametrize("action", sorted(STYLES))
def test_length_goes_evenly_along_the_line(trained: Model, action: str) -> None:
    course = plain_course_of(trained.action(action))
    for order, line in enumerate((FINE, np.ones_like(FINE), np.zeros_like(FINE))):
        added = course.of_length(0.7).derivative(FINE, order) - course.derivative(FINE, order)
        np.testing.assert_allclose(added, np.outer(line, [0.7, 0.0, 0.0]), atol=1e-9)


@pytest.mark.parametrize("action", sorted(STYLES))
def test_nothing_is_higher_than_the_highest(trained: Model, action: str) -> None:
    course = plain_course_of(trained.action(action)).of_length(0.4)
    for order in (1, 2):
        norms = np.linalg.norm(course.derivative(FINE, order), axis=1)
        assert norms.max() / 1.001 <= course.highest(order) <= norms.max() * 1.001


@pytest.mark.parametrize("action", sorted(STYLES))
def test_doubt_at_a_keypoint_is_that_of_its_state_at_least(trained: Model, action: str) -> None:
    chain = trained.action(action)
    std = plain_course_of(chain).std(keypoint_phases(chain))
    assert (std >= np.sqrt(chain.variances[:, :3]) - 1e-12).all()
    assert (std <= 1.5 * np.sqrt(chain.variances[:, :3])).all()


@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_phase_of_a_keypoint_is_the_middle_of_the_expected_stay(seed: int, n_states: int) -> None:
    chain = model_of(np.random.default_rng(seed), [n_states]).actions[0]
    before, expected, stays = 0.0, [], [1.0 / (1.0 - stay) for stay in chain.stay]
    for stay in stays:
        expected.append((before + stay / 2) / sum(stays))
        before += stay
    np.testing.assert_allclose(keypoint_phases(chain), expected, rtol=1e-12)
    assert (np.diff(keypoint_phases(chain), prepend=0.0, append=1.0) > 0.0).all()


def test_plain_course_of_a_class_is_made_once(trained: Model) -> None:
    chain = trained.action("push")
    assert plain_course_of(chain) is plain_course_of(chain)
    assert plain_course_of(chain).of_length(0.3).fits is plain_course_of(chain).fits
