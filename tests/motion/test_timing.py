"""Laws of durations: learned as a power of the length, stretched until limits are kept."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.motion.asked import ANY, Limits
from app.motion.course import Course
from app.motion.errors import InvalidRequest
from app.motion.model import N_COEFFICIENTS, PACE_SPREAD, ActionModel, Model
from app.motion.timing import (
    DURATIONS,
    MAX_FRAMES,
    RATES,
    SLOPE_SPREAD,
    check_duration,
    count_periods,
    expected_duration,
    least_duration,
)
from app.motion.trajectory import Floats

LENGTHS = np.geomspace(0.1, 1.0, 60)
FINE = np.linspace(0.0, 1.0, 4001)

powers = st.floats(-1.0, 2.0)
some_lengths = st.floats(0.005, 50.0)
limits = st.floats(0.05, 5.0)


@pytest.fixture(scope="module")
def chain(trained: Model) -> ActionModel:
    return trained.action("grasp")


def taking(chain: ActionModel, lengths: Floats, durations: Floats) -> ActionModel:
    """Return the class with demonstrations of such lengths [m] and durations [s]."""
    return replace(chain, ways=np.outer(lengths, [0.6, -0.64, 0.48]), durations=durations)


def slope(chain: ActionModel) -> float:
    """Return the power of the length that is expected within what was demonstrated."""
    shorter, longer = expected_duration(chain, 0.2), expected_duration(chain, 0.6)
    return float(np.log(longer / shorter) / np.log(3.0))


@pytest.mark.parametrize(("power", "learned"), [(0.0, 0.0), (0.25, 0.25), (0.5, 0.5), (0.8, 0.8)])
def test_power_of_the_length_is_learned(chain: ActionModel, power: float, learned: float) -> None:
    rng = np.random.default_rng(0)
    durations = 1.3 * LENGTHS**power * rng.lognormal(0.0, 0.01, len(LENGTHS))
    some = taking(chain, LENGTHS, durations)
    assert slope(some) == pytest.approx(learned, abs=0.03)
    assert expected_duration(some, 0.3) == pytest.approx(1.3 * 0.3**power, rel=0.03)


@pytest.mark.parametrize(("power", "bound"), [(-0.7, 0.0), (1.6, 1.0)])
def test_power_is_neither_negative_nor_over_one(chain: ActionModel, power: float, bound: float) -> None:
    assert slope(taking(chain, LENGTHS, LENGTHS**power)) == pytest.approx(bound, abs=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(1, 30), some_lengths)
def test_duration_is_that_of_ridge_regression(
    chain: ActionModel, seed: int, n_shown: int, length: float
) -> None:
    rng = np.random.default_rng(seed)
    shown = rng.lognormal(-1.0, 0.6, n_shown)
    durations = shown ** rng.uniform(0.2, 0.8) * rng.lognormal(0.0, 0.2, n_shown)
    away = np.log(shown) - np.log(shown).mean()
    rows = np.append(away, PACE_SPREAD / SLOPE_SPREAD)
    wanted = np.append(np.log(durations) - np.log(durations).mean(), 0.0)
    power = np.clip(np.linalg.lstsq(rows[:, None], wanted, rcond=None)[0][0], 0.0, 1.0)
    typical = np.exp(np.log(durations).mean())
    expected = typical * (length / np.exp(np.log(shown).mean())) ** power
    some = taking(chain, shown, durations)
    assert expected_duration(some, length) == pytest.approx(np.clip(expected, *DURATIONS), rel=1e-9)


@given(powers, some_lengths, st.floats(1.0, 20.0))
def test_longer_movements_take_no_less_time_and_are_no_slower(
    chain: ActionModel, power: float, length: float, longer: float
) -> None:
    some = taking(chain, LENGTHS, LENGTHS**power)
    short, long = expected_duration(some, length), expected_duration(some, longer * length)
    assert long >= short * (1.0 - 1e-12)
    assert longer * length / long >= length / short * (1.0 - 1e-12)


def test_one_demonstration_says_nothing_of_other_lengths(chain: ActionModel) -> None:
    one = taking(chain, np.array([0.3]), np.array([0.8]))
    for length in (0.01, 0.3, 3.0):
        assert expected_duration(one, length) == pytest.approx(0.8, rel=1e-12)


def test_duration_of_the_demonstrated_is_about_theirs(trained: Model) -> None:
    for action in trained.actions:
        expected = [expected_duration(action, length) for length in action.lengths]
        assert np.std(np.log(expected) - np.log(action.durations)) < 0.2
        assert np.mean(np.log(expected) - np.log(action.durations)) == pytest.approx(0.0, abs=1e-9)


def course_of(seed: int) -> Course:
    rng = np.random.default_rng(seed)
    mean = rng.normal(0.0, 0.03, (3, N_COEFFICIENTS))
    return Course.of(rng.uniform(0.05, 2.0), mean, np.zeros((3, N_COEFFICIENTS, N_COEFFICIENTS)))


def keeps(course: Course, duration: float, wanted: Limits) -> bool:
    """Return whether the limits are kept in such a duration [s]."""
    highest = (
        np.linalg.norm(course.derivative(FINE, order), axis=1).max() / duration**order for order in (1, 2)
    )
    allowed = (wanted.velocity, wanted.acceleration)
    return all(limit is None or value <= limit for value, limit in zip(highest, allowed, strict=True))


@given(
    st.integers(0, 2**32 - 1),
    st.one_of(
        st.builds(Limits, velocity=limits),
        st.builds(Limits, acceleration=limits),
        st.builds(Limits, velocity=limits, acceleration=limits),
    ),
)
def test_least_duration_keeps_the_limits_and_hardly_any_less_does(seed: int, wanted: Limits) -> None:
    course = course_of(seed)
    least = least_duration(course, wanted)
    assert keeps(course, least, wanted)
    assert not keeps(course, 0.997 * least, wanted)


@given(st.integers(0, 2**32 - 1), limits, limits, st.floats(0.3, 3.0))
def test_stretching_time_scales_limits(
    seed: int, velocity: float, acceleration: float, slower: float
) -> None:
    course = course_of(seed)
    least = least_duration(course, Limits(velocity, acceleration))
    stretched = least_duration(course, Limits(velocity / slower, acceleration / slower**2))
    assert stretched == pytest.approx(slower * least, rel=1e-12)


def test_without_limits_any_duration_will_do() -> None:
    assert least_duration(course_of(0), ANY) == 0.0
    assert Limits(None, None) == ANY


@dataclass
class Straight:
    """A path whose speed and acceleration by phase are known [m]."""

    highest_of: tuple[float, float]

    def highest(self, order: int) -> float:
        return self.highest_of[order - 1]


def test_limits_that_ask_for_more_than_the_longest_duration_are_refused() -> None:
    path = Straight((1.0, 4.0))
    assert least_duration(path, Limits(velocity=1.002 / DURATIONS[1])) <= DURATIONS[1]
    for wanted in (Limits(velocity=0.99 / DURATIONS[1]), Limits(acceleration=3.9 / DURATIONS[1] ** 2)):
        with pytest.raises(InvalidRequest) as refused:
            least_duration(path, wanted)
        assert refused.value.field == "limits"


@pytest.mark.parametrize("name", ["velocity", "acceleration"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, -np.inf])
def test_limit_that_is_not_positive_and_finite_is_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(InvalidRequest) as refused:
        Limits(**{name: value})
    assert refused.value.field == f"limits.{name}"


@given(st.floats(*RATES), st.integers(1, 2000))
def test_whole_periods_are_counted_as_such(rate: float, n_periods: int) -> None:
    assert count_periods(rate, n_periods / rate) == n_periods


@given(st.floats(*RATES), st.floats(*DURATIONS))
def test_periods_are_the_fewest_that_take_as_long(rate: float, duration: float) -> None:
    if rate * duration > MAX_FRAMES - 2:
        return
    n_periods = count_periods(rate, duration)
    assert n_periods >= 1
    assert n_periods / rate >= duration - 2e-6 / rate
    assert n_periods == 1 or (n_periods - 1) / rate < duration


@pytest.mark.parametrize(
    ("rate", "duration"),
    [(0.99, 1.0), (1000.1, 1.0), (np.nan, 1.0), (np.inf, 1.0), (-100.0, 1.0), (1000.0, 100.0)],
)
def test_rate_out_of_bounds_and_too_many_frames_are_refused(rate: float, duration: float) -> None:
    with pytest.raises(InvalidRequest) as refused:
        count_periods(rate, duration)
    assert refused.value.field == "rate"


def test_as_many_frames_as_may_be_are_given() -> None:
    assert count_periods(1000.0, (MAX_FRAMES - 1) / 1000.0) == MAX_FRAMES - 1


@pytest.mark.parametrize("duration", [0.0499, 600.1, np.nan, np.inf, -1.0])
def test_duration_out_of_bounds_is_refused(duration: float) -> None:
    with pytest.raises(InvalidRequest) as refused:
        check_duration(duration)
    assert refused.value.field == "duration"
    for bound in DURATIONS:
        assert check_duration(bound) == bound
