"""Laws of movement primitives, against regressions that are written out one number at a time."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from app.motion.course import Course
from app.motion.features import alignment
from app.motion.generation import generate
from app.motion.model import N_COEFFICIENTS, ActionModel, Model
from app.motion.primitive import (
    CHANCE,
    CHOICES,
    CONSTANT,
    GROWTHS,
    LEAST_STD,
    MOST,
    REACH,
    SMOOTH,
    STRENGTHS,
    primitive_of,
)
from app.motion.trajectory import Floats

BUMP = np.concatenate([0.1 * np.sin(np.linspace(0.0, np.pi, N_COEFFICIENTS)) * k for k in (0.2, -0.4, 1.0)])
SEEDS = range(4)


@pytest.fixture(scope="module")
def chain(trained: Model) -> ActionModel:
    return trained.action("grasp")


def shown(chain: ActionModel, ways: Floats, durations: Floats, shapes: Floats) -> ActionModel:
    """Return the class with demonstrations like these instead of its own."""
    return replace(chain, starts=np.zeros_like(ways), ways=ways, durations=durations, shapes=shapes)


def anyhow(chain: ActionModel, seed: int, n_shown: int) -> ActionModel:
    """Return a class whose demonstrations have nothing to do with each other."""
    rng = np.random.default_rng(seed)
    shapes = rng.normal(0.0, 0.02, (n_shown, 3 * N_COEFFICIENTS))
    return shown(chain, *tasks(rng, n_shown), shapes)


def tasks(rng: np.random.Generator, n: int) -> tuple[Floats, Floats]:
    """Return ways (n, 3) in all directions and durations (n,) that have nothing to do with each other."""
    directions = rng.normal(size=(n, 3)) * [1.0, 1.0, 0.3]
    lengths = np.exp(rng.uniform(np.log(0.1), np.log(1.0), n))
    ways = directions / np.linalg.norm(directions, axis=1, keepdims=True) * lengths[:, None]
    return ways, np.exp(rng.uniform(np.log(0.4), np.log(2.0), n))


def by_length(way: Floats, duration: float) -> Floats:
    shape: Floats = np.sin(3.0 * np.log(np.linalg.norm(way))) * BUMP
    return shape


def by_tempo(way: Floats, duration: float) -> Floats:
    shape: Floats = np.sin(3.0 * np.log(duration)) * BUMP
    return shape


def by_direction(way: Floats, duration: float) -> Floats:
    shape: Floats = way[0] / np.linalg.norm(way) * BUMP
    return shape


def growing(way: Floats, duration: float) -> Floats:
    shape: Floats = np.linalg.norm(way) * BUMP
    return shape


def following(chain: ActionModel, rule: Any, rng: np.random.Generator, n: int = 80) -> ActionModel:
    """Return a class whose shapes follow a rule but for a little chance."""
    ways, durations = tasks(rng, n)
    shapes = np.array([rule(*task) for task in zip(ways, durations, strict=True)])
    return shown(chain, ways, durations, shapes + rng.normal(0.0, 0.002, shapes.shape))


def features(hangs_on: tuple[str, ...], way: Floats, duration: float) -> list[float]:
    length = float(np.sqrt(way @ way))
    each = {
        "length": np.log(length),
        "rise": np.arcsin(way[2] / length),
        "tempo": np.log(duration),
        "ahead": way[0] / length,
        "aside": way[1] / length,
    }
    return [each[name] / REACH[name] for name in hangs_on]


def kernel(axis: int, strength: float, one: list[float], other: list[float]) -> float:
    squares = sum((a - b) ** 2 for a, b in zip(one, other, strict=True))
    return float(CONSTANT[axis] + strength * np.exp(-squares / 2))


def regressed(
    axis: int, strength: float, known: list[list[float]], values: Floats, new: list[float]
) -> tuple[Floats, float]:
    """Return the mean (N_COEFFICIENTS,) and the variance in CHANCE for a new task, by the book."""
    gram = np.array([[kernel(axis, strength, a, b) for b in known] for a in known])
    inverse = np.linalg.inv(gram + CHANCE * np.eye(len(known)))
    row = np.array([kernel(axis, strength, new, a) for a in known])
    doubt = kernel(axis, strength, new, new) - np.einsum("i,ij,j->", row, inverse, row)
    return np.einsum("i,ij,jk->k", row, inverse, values), float(1.0 + doubt / CHANCE)


def left_out(
    chain: ActionModel, hangs_on: tuple[str, ...], growth: float, strength: float
) -> tuple[Floats, Floats]:
    """Return (3, n, N_COEFFICIENTS): what each demonstration adds to what all others say; its variances."""
    known = [features(hangs_on, *task) for task in zip(chain.ways, chain.durations, strict=True)]
    shapes = chain.shapes.reshape(-1, 3, N_COEFFICIENTS) / (chain.lengths**growth)[:, None, None]
    missed, variances = np.empty((3, *shapes[:, 0].shape)), np.empty((3, len(known), 1))
    for axis, out in product(range(3), range(len(known))):
        others = np.delete(shapes[:, axis], out, axis=0)
        mean, variances[axis, out] = regressed(
            axis, strength, known[:out] + known[out + 1 :], others, known[out]
        )
        missed[axis, out] = shapes[out, axis] - mean
    return missed, variances


def chosen(chain: ActionModel) -> tuple[tuple[str, ...], float, float]:
    """Return what the shape hangs on, how it grows, and how strongly it hangs, by refitting all there is."""
    best, least = (CHOICES[0], GROWTHS[0], 1.0), np.inf
    for strength, hangs_on, growth in product(STRENGTHS, CHOICES, GROWTHS):
        missed, _ = left_out(chain, hangs_on, growth, strength)
        error = np.sum((missed * (chain.lengths**growth)[:, None]) ** 2)
        if error < STRENGTHS[strength] * least:
            best, least = (hangs_on, growth, strength), error
    return best


def error_on_new(chain: ActionModel, rule: Any, rng: np.random.Generator) -> tuple[float, float]:
    """Return the root mean square error [m] of the primitive, and of the mean shape, for new tasks."""
    primitive, mean = primitive_of(chain), chain.shapes.mean(axis=0).reshape(3, N_COEFFICIENTS)
    wanted = [(way, duration, rule(way, duration)) for way, duration in zip(*tasks(rng, 50), strict=True)]
    of_primitive = [primitive.shape(way, duration)[0] - w.reshape(3, -1) for way, duration, w in wanted]
    of_mean = [mean - w.reshape(3, -1) for _, _, w in wanted]
    return float(np.sqrt(np.mean(np.square(of_primitive)))), float(np.sqrt(np.mean(np.square(of_mean))))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("rule", [None, by_length, by_tempo, by_direction, growing])
def test_choice_is_the_simplest_that_refits_without_each_demonstration_leave(
    chain: ActionModel, seed: int, rule: Any
) -> None:
    rng = np.random.default_rng(seed)
    some = following(chain, rule, rng, 7) if rule else anyhow(chain, seed, 6)
    primitive = primitive_of(some)
    strength = primitive.regression.strength
    assert (primitive.hangs_on, primitive.growth, strength) == chosen(some)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("rule", [by_length, by_tempo, by_direction, growing])
def test_what_is_missed_is_what_refits_without_each_demonstration_miss(
    chain: ActionModel, seed: int, rule: Any
) -> None:
    some = following(chain, rule, np.random.default_rng(seed), 15)
    primitive = primitive_of(some)
    missed, variances = left_out(some, primitive.hangs_on, primitive.growth, primitive.regression.strength)
    np.testing.assert_allclose(primitive.regression.missed, missed, atol=1e-9)
    np.testing.assert_allclose(primitive.regression.surprises, missed / np.sqrt(variances), atol=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("rule", [by_length, by_tempo, by_direction, growing])
def test_prediction_is_that_of_the_formulas(chain: ActionModel, seed: int, rule: Any) -> None:
    rng = np.random.default_rng(seed)
    some = following(chain, rule, rng, 20)
    primitive = primitive_of(some)
    known = [features(primitive.hangs_on, *task) for task in zip(some.ways, some.durations, strict=True)]
    for way, duration in zip(*tasks(rng, 5), strict=True):
        mean, covariances = primitive.shape(way, duration)
        size = np.linalg.norm(way) ** primitive.growth
        within = float(np.clip(duration, some.durations.min(), some.durations.max()))
        new = features(primitive.hangs_on, way, within)
        for axis in range(3):
            values = some.shapes.reshape(-1, 3, N_COEFFICIENTS)[:, axis]
            values = values / (some.lengths**primitive.growth)[:, None]
            expected, doubt = regressed(axis, primitive.regression.strength, known, values, new)
            np.testing.assert_allclose(mean[axis], size * expected, atol=1e-9)
            np.testing.assert_allclose(
                covariances[axis], size**2 * doubt * primitive.covariances[axis], rtol=1e-9
            )


@pytest.mark.parametrize(
    ("rule", "names"),
    [(by_length, {"length"}), (by_tempo, {"tempo"}), (by_direction, {"ahead", "aside"})],
)
def test_what_the_shape_hangs_on_is_found_and_predicts(
    chain: ActionModel, rule: Any, names: set[str]
) -> None:
    rng = np.random.default_rng(0)
    some = following(chain, rule, rng)
    assert names <= set(primitive_of(some).hangs_on)
    of_primitive, of_mean = error_on_new(some, rule, rng)
    assert of_primitive < 0.5 * of_mean


def test_shape_that_grows_with_the_length_is_found_to(chain: ActionModel) -> None:
    rng = np.random.default_rng(0)
    some = following(chain, growing, rng)
    assert (primitive_of(some).hangs_on, primitive_of(some).growth) == ((), 1.0)
    of_primitive, of_mean = error_on_new(some, growing, rng)
    assert of_primitive < 0.1 * of_mean


@pytest.mark.parametrize("seed", range(10))
def test_shape_that_hangs_on_nothing_is_the_mean_a_little_less(chain: ActionModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    some = following(chain, lambda way, duration: BUMP, rng)
    primitive = primitive_of(some)
    assert (primitive.hangs_on, primitive.growth) == ((), 0.0)
    constant = np.array([kernel(axis, primitive.regression.strength, [], []) for axis in range(3)])
    share = 80 * constant / (80 * constant + CHANCE)
    mean = some.shapes.mean(axis=0).reshape(3, N_COEFFICIENTS)
    np.testing.assert_allclose(primitive.shape(some.ways[0], 1.0)[0], share[:, None] * mean, atol=1e-12)


def test_far_from_everything_the_constant_part_is_left(chain: ActionModel) -> None:
    some = following(chain, by_length, np.random.default_rng(0))
    primitive = primitive_of(some)
    strength = primitive.regression.strength
    assert primitive.growth == 0.0
    known = [features(primitive.hangs_on, *task) for task in zip(some.ways, some.durations, strict=True)]
    for far in (1e-6, 1e6):
        mean, covariances = primitive.shape(np.array([far, 0.0, 0.0]), 1.0)
        for axis in range(3):
            gram = np.array([[kernel(axis, strength, a, b) for b in known] for a in known])
            inverse = np.linalg.inv(gram + CHANCE * np.eye(80))
            row = np.full(80, CONSTANT[axis])
            values = some.shapes.reshape(-1, 3, N_COEFFICIENTS)[:, axis]
            np.testing.assert_allclose(mean[axis], row @ inverse @ values, atol=1e-9)
            doubt = 1.0 + (CONSTANT[axis] + strength - row @ inverse @ row) / CHANCE
            np.testing.assert_allclose(covariances[axis], doubt * primitive.covariances[axis], rtol=1e-9)


def test_durations_beyond_those_demonstrated_say_no_more_than_the_last(chain: ActionModel) -> None:
    some = following(chain, by_tempo, np.random.default_rng(0))
    primitive = primitive_of(some)
    for beyond, last in ((some.durations.min() / 9, some.durations.min()), (600.0, some.durations.max())):
        for one, other in zip(
            primitive.shape(some.ways[0], beyond), primitive.shape(some.ways[0], last), strict=True
        ):
            np.testing.assert_array_equal(one, other)


def doubts(chain: ActionModel, way: Floats) -> Floats:
    """Return (3,) the variance for a task in that which is left to chance."""
    primitive = primitive_of(chain)
    size = np.linalg.norm(way) ** (2 * primitive.growth)
    ratio: Floats = np.median(primitive.shape(way, 1.0)[1] / primitive.covariances, axis=(1, 2)) / size
    return ratio


@pytest.mark.parametrize("rule", [by_length, by_tempo, by_direction, growing])
def test_doubt_is_never_less_than_chance_and_never_more_than_all_there_is(
    chain: ActionModel, rule: Any
) -> None:
    rng = np.random.default_rng(0)
    some = following(chain, rule, rng)
    for way in tasks(rng, 100)[0]:
        doubt = doubts(some, way)
        assert (doubt >= 1.0 - 1e-9).all()
        assert (doubt <= 1.0 + (CONSTANT + max(STRENGTHS)) / CHANCE).all()


def test_doubt_grows_with_the_distance_from_the_demonstrated(chain: ActionModel) -> None:
    some = following(chain, by_length, np.random.default_rng(0))
    away = np.geomspace(1.0, 20.0, 30)
    for longest in (np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])):
        grown = np.diff([doubts(some, factor * longest) for factor in away], axis=0)
        assert (grown >= -1e-9).all()
        assert grown.sum(axis=0).min() > 0.2


@pytest.mark.parametrize("n_shown", [1, 2, 3, 14, 60])
@pytest.mark.parametrize("seed", SEEDS)
def test_covariances_are_symmetric_and_positive_definite(chain: ActionModel, seed: int, n_shown: int) -> None:
    some = anyhow(chain, seed, n_shown)
    for covariances in (primitive_of(some).covariances, primitive_of(some).shape(some.ways[0], 1.0)[1]):
        np.testing.assert_allclose(covariances, covariances.swapaxes(1, 2), rtol=1e-12)
        assert np.linalg.eigvalsh(covariances).min() > 0.0


@pytest.mark.parametrize("n_shown", [1, 5, 40])
def test_covariances_are_the_surprises_shrunk_towards_alike_neighbours(
    chain: ActionModel, n_shown: int
) -> None:
    primitive = primitive_of(anyhow(chain, 0, n_shown))
    for surprises, covariance in zip(primitive.regression.surprises, primitive.covariances, strict=True):
        sampled = np.mean([np.outer(each, each) for each in surprises], axis=0)
        for k, m in product(range(N_COEFFICIENTS), repeat=2):
            stds = np.sqrt((sampled[k, k] + LEAST_STD**2) * (sampled[m, m] + LEAST_STD**2))
            expected = np.exp(-((k - m) ** 2) / (2 * SMOOTH**2)) * stds
            whole = n_shown * sampled[k, m] + N_COEFFICIENTS * expected
            assert covariance[k, m] == pytest.approx(whole / (n_shown + N_COEFFICIENTS), abs=1e-15)


def test_of_more_demonstrations_some_at_regular_intervals_are_compared(
    chain: ActionModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.motion.primitive.MOST", 20)
    many = following(chain, by_length, np.random.default_rng(0), 39)
    some = shown(chain, many.ways[::2], many.durations[::2], many.shapes[::2])
    assert some.n_demonstrations == 20
    for one, other in zip(
        primitive_of(many).shape(many.ways[1], 1.0), primitive_of(some).shape(many.ways[1], 1.0), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_more_demonstrations_than_are_compared_are_a_class(chain: ActionModel) -> None:
    many = following(chain, by_length, np.random.default_rng(0), MOST + 1)
    assert primitive_of(many).regression.tasks.shape[0] == MOST
    assert np.isfinite(primitive_of(many).shape(many.ways[0], 1.0)[0]).all()


@pytest.mark.parametrize("n_shown", [2, 5, 20])
def test_class_shown_for_one_task_only_keeps_its_shape_for_any_other(
    chain: ActionModel, n_shown: int
) -> None:
    varied = following(chain, lambda way, duration: BUMP, np.random.default_rng(0), n_shown)
    alike = shown(chain, np.tile([0.3, 0.0, 0.0], (n_shown, 1)), np.ones(n_shown), varied.shapes)
    assert primitive_of(alike).hangs_on == ()
    there, elsewhere = (primitive_of(alike).shape(np.array([x, 0.0, 0.0]), 1.0)[0] for x in (0.3, 1.0))
    np.testing.assert_allclose(elsewhere, there, atol=1e-12)


def test_two_demonstrations_that_are_alike_are_a_class(chain: ActionModel) -> None:
    one = anyhow(chain, 0, 1)
    two = shown(chain, one.ways.repeat(2, 0), one.durations.repeat(2), one.shapes.repeat(2, 0))
    mean, covariances = primitive_of(two).shape(two.ways[0], 1.0)
    share = mean / two.shapes[0].reshape(3, -1)
    np.testing.assert_allclose(share, np.broadcast_to(share[:, :1], share.shape), rtol=1e-9)
    assert ((share > 0.3) & (share < 1.0)).all()
    assert np.linalg.eigvalsh(covariances).min() > 0.0


@pytest.mark.parametrize("rule", [by_length, by_tempo, by_direction, growing])
def test_generated_movement_has_the_shape_that_is_predicted_for_its_task(
    trained: Model, chain: ActionModel, rule: Any
) -> None:
    rng = np.random.default_rng(0)
    some = following(chain, rule, rng)
    for way, duration in zip(tasks(rng, 3)[0], (0.5, 1.0, 1.5), strict=True):
        motion = generate(replace(trained, actions=(some,)), "grasp", -way, np.zeros(3), duration=duration)
        mean, covariances = primitive_of(some).shape(way, duration)
        course, phase = Course.of(float(np.linalg.norm(way)), mean, covariances), motion.times / duration
        aligned = (motion.positions + way) @ alignment(-way, np.zeros(3)).T
        np.testing.assert_allclose(aligned, course.derivative(phase, 0), atol=1e-9)
        np.testing.assert_allclose(
            np.sum(motion.std**2, axis=1), np.sum(course.std(phase) ** 2, axis=1), atol=1e-9
        )
        told = "mean_shape" in {notice.code for notice in motion.notices}
        assert told == (primitive_of(some).hangs_on == ())


def test_primitive_of_a_class_is_made_once(chain: ActionModel) -> None:
    assert primitive_of(chain) is primitive_of(chain)
    assert primitive_of(replace(chain)) is not primitive_of(chain)
