"""Laws of shapes: what is fitted comes back, whatever the place, the heading and the tempo."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.motion.features import alignment
from app.motion.model import N_COEFFICIENTS, N_SHAPE
from app.motion.shape import AT_REST, MINIMUM_JERK, ROUGHNESS, basis, bring_to_rest, fit_shape
from app.motion.simulation import demonstrations
from app.motion.trajectory import Floats

ENDS = np.array([0.0, 1.0])
FINE = np.linspace(0.0, 1.0, 2001)

seeds = st.integers(0, 2**32 - 1)


def movement(rng: np.random.Generator, n_frames: int) -> tuple[Floats, Floats]:
    """Return times (n,) [s] and a smooth movement (n, 3) [m] with all of minimum jerk, arch and swing."""
    phase = np.linspace(0.0, 1.0, n_frames)
    start, way = rng.uniform(-1.0, 1.0, (2, 3))
    bend = sum(
        np.outer(np.sin(np.pi * mode * phase), rng.normal(0.0, 0.05 / mode**2, 3)) for mode in (1, 2, 3)
    )
    return rng.uniform(0.3, 3.0) * phase + rng.uniform(0.0, 9.0), start + np.outer(
        MINIMUM_JERK(phase), way
    ) + bend


def rebuilt(shape: Floats, phase: Floats, start: Floats, goal: Floats) -> Floats:
    """Return the movement (n, 3) of a shape [m]."""
    bend = basis(phase) @ shape.reshape(3, N_COEFFICIENTS).T
    moved: Floats = start + np.outer(MINIMUM_JERK(phase), goal - start) + bend @ alignment(start, goal)
    return moved


@given(seeds, st.integers(40, 300))
def test_smooth_movement_comes_back(seed: int, n_frames: int) -> None:
    times, hand = movement(np.random.default_rng(seed), n_frames)
    shape = fit_shape(times, hand)
    assert shape.shape == (N_SHAPE,)
    phase = np.linspace(0.0, 1.0, n_frames)
    np.testing.assert_allclose(rebuilt(shape, phase, hand[0], hand[-1]), hand, atol=5e-4)


@pytest.mark.parametrize("action", ["grasp", "displace", "push", "retract"])
def test_demonstration_comes_back_but_for_the_noise_of_the_sensor(action: str) -> None:
    for demonstration in demonstrations(1):
        if demonstration.action == action:
            times, hand = demonstration.trajectory.times, demonstration.trajectory.hand
            missed = rebuilt(fit_shape(times, hand), times / times[-1], hand[0], hand[-1]) - hand
            assert np.sqrt(np.mean(missed**2)) < 0.0008


@given(seeds)
def test_fit_is_that_of_least_squares(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times, hand = movement(rng, 80)
    times[1:-1] += rng.uniform(-0.3, 0.3, 78) * (times[1] - times[0])
    hand[1:-1] += rng.normal(0.0, 0.003, (78, 3))
    phase = (times - times[0]) / (times[-1] - times[0])
    weights = np.sqrt(np.gradient(phase))[:, None]
    deviation = (hand - rebuilt(np.zeros(N_SHAPE), phase, hand[0], hand[-1])) @ alignment(hand[0], hand[-1]).T
    rough = np.sqrt(ROUGHNESS / len(FINE)) * basis(FINE, 3)
    rows = np.concatenate([weights * basis(phase), rough])
    wanted = np.concatenate([weights * deviation, np.zeros((len(FINE), 3))])
    least = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    np.testing.assert_allclose(fit_shape(times, hand).reshape(3, -1), least.T, atol=2e-4)


@given(seeds, st.floats(-np.pi, np.pi), st.floats(0.1, 10.0))
def test_shape_is_the_same_wherever_it_heads_and_however_long_it_takes(
    seed: int, angle: float, slower: float
) -> None:
    rng = np.random.default_rng(seed)
    times, hand = movement(rng, 60)
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    elsewhere = hand @ turn.T + rng.uniform(-2.0, 2.0, 3)
    np.testing.assert_allclose(
        fit_shape(slower * times - 3.0, elsewhere), fit_shape(times, hand), rtol=0, atol=1e-8
    )


@given(seeds)
def test_dropouts_tell_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times, hand = movement(rng, 120)
    lost = rng.random(120) < 0.3
    lost[[0, -1]] = False
    seen = hand.copy()
    seen[lost, rng.integers(0, 3, lost.sum())] = np.nan
    shape = fit_shape(times, seen)
    np.testing.assert_array_equal(shape, fit_shape(times[~lost], hand[~lost]))
    np.testing.assert_allclose(shape, fit_shape(times, hand), atol=1e-3)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_derivatives_are_those_of_the_basis(order: int) -> None:
    step = FINE[1] - FINE[0]
    slopes = (basis(FINE, order - 1)[2:] - basis(FINE, order - 1)[:-2]) / (2 * step)
    scale = np.abs(basis(FINE, order)).max()
    np.testing.assert_allclose(slopes, basis(FINE, order)[1:-1], atol=1e-3 * scale)


def test_every_shape_meets_its_end_points() -> None:
    np.testing.assert_array_equal(basis(ENDS), np.zeros((2, N_COEFFICIENTS)))


@given(seeds)
def test_what_is_brought_to_rest_rests_at_both_ends(seed: int) -> None:
    resting = bring_to_rest(np.random.default_rng(seed).normal(0.0, 0.1, (3, N_COEFFICIENTS)))
    for order in (0, 1, 2):
        np.testing.assert_array_equal(basis(ENDS, order) @ resting.T, np.zeros((2, 3)))


@given(seeds)
def test_what_rests_is_left_as_it_is(seed: int) -> None:
    resting = np.zeros((3, N_COEFFICIENTS))
    resting[:, AT_REST] = np.random.default_rng(seed).normal(0.0, 0.05, (3, 10))
    np.testing.assert_allclose(bring_to_rest(resting), resting, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_nothing_as_smooth_at_rest_is_nearer(seed: int) -> None:
    shape = fit_shape(*movement(np.random.default_rng(seed), 200)).reshape(3, N_COEFFICIENTS)
    phase = np.linspace(0.0, 1.0, 20 * N_COEFFICIENTS)
    rows = np.concatenate([basis(phase), np.sqrt(ROUGHNESS) * basis(phase, 3)])
    nearest = np.linalg.lstsq(rows[:, AT_REST], rows @ shape.T, rcond=None)[0].T
    moved = basis(FINE) @ bring_to_rest(shape).T
    np.testing.assert_allclose(moved, basis(FINE)[:, AT_REST] @ nearest.T, atol=1e-9)
    assert np.abs(moved - basis(FINE) @ shape.T).max() > 1e-3


def test_bringing_to_rest_is_linear_over_any_axes() -> None:
    shapes = np.random.default_rng(0).normal(size=(2, 5, 3, N_COEFFICIENTS))
    np.testing.assert_allclose(bring_to_rest(shapes)[1, 4, 2], bring_to_rest(shapes[1, 4, 2]), atol=1e-12)
    summed = bring_to_rest(2.0 * shapes[0] - shapes[1])
    np.testing.assert_allclose(summed, 2.0 * bring_to_rest(shapes[0]) - bring_to_rest(shapes[1]), atol=1e-12)
