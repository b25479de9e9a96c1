"""Laws of courses: from rest to rest, and through points as Gaussians are conditioned by the book."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson

from app.motion.course import EXACT, MEASURED, Course
from app.motion.generation import generate
from app.motion.model import N_COEFFICIENTS, Model
from app.motion.shape import basis
from app.motion.simulation import demonstrations
from app.motion.trajectory import Floats

FINE = np.linspace(0.0, 1.0, 4001)
ENDS = np.array([0.0, 1.0])

seeds = st.integers(0, 2**32 - 1)


def spread(rng: np.random.Generator) -> Floats:
    """Return covariances (3, N_COEFFICIENTS, N_COEFFICIENTS) of about 3 cm [m^2]."""
    roots = rng.normal(0.0, 0.03, (3, N_COEFFICIENTS, 2 * N_COEFFICIENTS)) / np.sqrt(2 * N_COEFFICIENTS)
    covariances: Floats = roots @ roots.swapaxes(1, 2)
    return covariances


def course_of(seed: int) -> tuple[Course, np.random.Generator]:
    rng = np.random.default_rng(seed)
    length = float(np.exp(rng.uniform(np.log(0.01), np.log(3.0))))
    return Course.of(length, rng.normal(0.0, 0.05, (3, N_COEFFICIENTS)), spread(rng)), rng


def via(rng: np.random.Generator, n: int, length: float) -> tuple[Floats, Floats, Floats]:
    """Return fractions (n,), points (n, 3) near the line [m] and how near to pass them (n,) [m]."""
    fractions = (np.arange(n) + rng.uniform(0.2, 0.8, n)) / n
    points = np.outer(fractions, [length, 0.0, 0.0]) + rng.normal(0.0, 0.05, (n, 3))
    return rng.permutation(fractions), points, np.exp(rng.uniform(np.log(1e-3), np.log(0.1), n))


@given(seeds)
def test_course_goes_from_rest_at_nought_to_rest_at_its_length(seed: int) -> None:
    course, _ = course_of(seed)
    np.testing.assert_array_equal(course.derivative(ENDS, 0), [[0.0] * 3, [course.length, 0.0, 0.0]])
    for order in (1, 2):
        np.testing.assert_array_equal(course.derivative(ENDS, order), np.zeros((2, 3)))
    np.testing.assert_array_equal(course.std(ENDS), np.zeros((2, 3)))


@pytest.mark.parametrize("order", [1, 2])
@given(seeds)
def test_each_derivative_integrates_to_the_one_before(order: int, seed: int) -> None:
    course, _ = course_of(seed)
    gained = cumulative_simpson(course.derivative(FINE, order), x=FINE, axis=0, initial=0.0)
    before = course.derivative(FINE, order - 1)
    np.testing.assert_allclose(before[0] + gained, before, atol=1e-5 * np.abs(before).max())


@pytest.mark.parametrize("order", [1, 2])
@given(seeds)
def test_nothing_is_higher_than_the_highest(order: int, seed: int) -> None:
    course, _ = course_of(seed)
    norms = np.linalg.norm(course.derivative(FINE, order), axis=1)
    assert norms.max() / 1.001 <= course.highest(order) <= norms.max() * 1.001


@given(seeds)
def test_std_is_that_of_shapes_as_demonstrated_and_of_the_measurement(seed: int) -> None:
    rng = np.random.default_rng(seed)
    covariances, phase = spread(rng), rng.uniform(0.0, 1.0, 7)
    course = Course.of(1.0, np.zeros((3, N_COEFFICIENTS)), covariances)
    for at, stds in zip(phase, course.std(phase), strict=True):
        row = basis(np.array([at]))[0]
        expected = [np.sqrt(row @ covariance @ row + MEASURED**2) for covariance in covariances]
        np.testing.assert_allclose(stds, expected, rtol=1e-9)


@given(seeds, st.integers(1, 3))
def test_points_to_pass_exactly_are_met(seed: int, n_via: int) -> None:
    course, rng = course_of(seed)
    fractions, points, _ = via(rng, n_via, course.length)
    passing = course.passing(fractions, points, np.full(n_via, 1e-9))
    np.testing.assert_allclose(passing.derivative(fractions, 0), points, atol=1e-6)


@given(seeds, st.integers(1, 4))
def test_passing_is_conditioning_a_gaussian_on_what_was_seen(seed: int, n_via: int) -> None:
    course, rng = course_of(seed)
    fractions, points, stds = via(rng, n_via, course.length)
    passing = course.passing(fractions, points, stds)
    at, missed = basis(fractions), points - course.derivative(fractions, 0)
    noise = np.diag(stds**2 + EXACT)
    for axis in range(3):
        inside, outside = course.resting[axis], course.shown[axis]
        gain = inside @ at.T @ np.linalg.inv(at @ inside @ at.T + noise)
        np.testing.assert_allclose(passing.mean[axis], course.mean[axis] + gain @ missed[:, axis], atol=1e-8)
        left = outside - outside @ at.T @ np.linalg.inv(at @ outside @ at.T + noise) @ at @ outside
        np.testing.assert_allclose(passing.shown[axis], left, atol=1e-10)


@given(seeds, st.integers(1, 5))
def test_movement_through_points_still_goes_from_rest_to_rest(seed: int, n_via: int) -> None:
    course, rng = course_of(seed)
    passing = course.passing(*via(rng, n_via, course.length))
    np.testing.assert_array_equal(passing.derivative(ENDS, 0), course.derivative(ENDS, 0))
    for order in (1, 2):
        np.testing.assert_array_equal(passing.derivative(ENDS, order), np.zeros((2, 3)))
    np.testing.assert_array_equal(passing.std(ENDS), np.zeros((2, 3)))


@given(seeds)
def test_point_that_need_not_be_near_changes_nothing(seed: int) -> None:
    course, rng = course_of(seed)
    fractions, points, _ = via(rng, 3, course.length)
    passing = course.passing(fractions, points, np.full(3, 1e6))
    np.testing.assert_allclose(passing.derivative(FINE, 0), course.derivative(FINE, 0), atol=1e-9)
    np.testing.assert_allclose(passing.std(FINE), course.std(FINE), rtol=1e-9)


@given(seeds, st.permutations(range(4)))
def test_points_may_come_one_by_one_and_in_any_order(seed: int, order: list[int]) -> None:
    course, rng = course_of(seed)
    fractions, points, stds = via(rng, 4, course.length)
    at_once = course.passing(fractions, points, stds)
    one_by_one = course
    for each in order:
        one_by_one = one_by_one.passing(fractions[[each]], points[[each]], stds[[each]])
    np.testing.assert_allclose(one_by_one.derivative(FINE, 0), at_once.derivative(FINE, 0), atol=1e-7)
    np.testing.assert_allclose(one_by_one.std(FINE), at_once.std(FINE), atol=1e-7)


@given(seeds, st.integers(1, 5))
def test_what_is_known_of_a_movement_makes_it_nowhere_less_certain(seed: int, n_via: int) -> None:
    course, rng = course_of(seed)
    fractions, points, stds = via(rng, n_via, course.length)
    passing = course.passing(fractions, points, stds)
    assert (passing.std(FINE) <= course.std(FINE) + 1e-9).all()
    there = np.sqrt(passing.std(fractions) ** 2 - MEASURED**2)
    assert (there <= np.sqrt(stds**2 + EXACT)[:, None] + 1e-6).all()


def test_movement_bends_where_the_demonstrations_vary() -> None:
    covariances = np.zeros((3, N_COEFFICIENTS, N_COEFFICIENTS))
    covariances[:, 6, 6] = 1e-4
    course = Course.of(1.0, np.zeros((3, N_COEFFICIENTS)), covariances)
    fraction = FINE[[basis(FINE)[:, 6].argmax()]]
    point = course.derivative(fraction, 0) + np.array([0.0, 0.02, 0.0])
    bent = course.passing(fraction, point, np.array([1e-9])).derivative(FINE, 0) - course.derivative(FINE, 0)
    np.testing.assert_allclose(bent[:, [0, 2]], 0.0, atol=1e-12)
    assert bent[:, 1].max() == pytest.approx(0.02, rel=0.2)
    assert np.abs(bent[FINE < 0.05, 1]).max() < 0.002


def test_held_out_demonstrations_lie_within_their_std_as_often_as_gaussians_do(trained: Model) -> None:
    deviations = []
    for held_out in demonstrations(2):
        hand = held_out.trajectory.hand
        seconds = held_out.trajectory.times[-1]
        motion = generate(trained, held_out.action, hand[0], hand[-1], duration=seconds, rate=100.0)
        inside = slice(len(hand) // 10, -(len(hand) // 10))
        deviations.append(((motion.positions - hand) / np.where(motion.std > 0.0, motion.std, 1.0))[inside])
    away = np.abs(np.concatenate(deviations))
    within_one, within_two = np.mean(away < 1.0, axis=0), np.mean(away < 1.96, axis=0)
    assert ((within_one > 0.58) & (within_one < 0.80)).all(), within_one
    assert ((within_two > 0.90) & (within_two < 0.99)).all(), within_two
