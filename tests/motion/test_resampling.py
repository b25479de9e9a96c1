"""Laws of resampling: identity, linear motion, any chunking, causality, and gaps that nobody guesses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from app.motion.errors import InvalidTrajectory
from app.motion.resampling import MAX_PERIODS, Grid, Period, Resampler, resample, smooth, stack
from app.motion.trajectory import Flags, Floats, Trajectory

LAW = settings(derandomize=True, deadline=None)

coordinates = st.floats(-3.0, 3.0)
points = arrays(np.float64, 3, elements=coordinates)
rates = st.sampled_from([24.0, 30.0, 50.0, 59.94, 60.0, 100.0, 120.0, 240.0]) | st.floats(10.0, 500.0)
begins = st.sampled_from([0.0, -2.5, 17.123, 3600.0])


@st.composite
def jittered(draw: st.DrawFn, n_frames: int = 40) -> Floats:
    """Draw times (n_frames,) at about some rate."""
    jitter = draw(arrays(np.float64, n_frames, elements=st.floats(-0.2, 0.2)))
    times: Floats = draw(begins) + (np.arange(n_frames) + jitter) / draw(rates)
    return times


@st.composite
def streams(draw: st.DrawFn) -> tuple[Floats, Floats, Flags]:
    """Draw times (n,), positions (n, 2, 3) with dropouts, and the gaps (n,) before frames."""
    intervals = draw(arrays(np.float64, st.integers(1, 20), elements=st.floats(0.001, 0.08)))
    times = draw(begins) + np.cumsum(intervals)
    positions = draw(arrays(np.float64, (len(times), 2, 3), elements=coordinates))
    positions[draw(arrays(np.bool_, (len(times), 2)))] = np.nan
    gaps = draw(arrays(np.bool_, len(times)))
    gaps[0] = False
    return times, positions, gaps


def joined(grids: Sequence[Grid]) -> Grid:
    return Grid(*map(np.concatenate, zip(*grids, strict=True)))


def until(grid: Grid, known: Flags) -> Grid:
    return Grid(grid.times[known], grid.positions[known], grid.frames[known], grid.released[known])


def assert_same(grid: Grid, other: Grid) -> None:
    for values, others in zip(grid, other, strict=True):
        np.testing.assert_array_equal(values, others, strict=True)


def seen(times: Floats, lost: Sequence[int] = ()) -> Trajectory:
    """Return a hand that moves one metre a second along x, but for the lost frames, beside a cup at rest."""
    hand = times[:, None] * [1.0, 0.0, 0.0]
    hand[list(lost)] = np.nan
    return Trajectory(times, hand, {"cup": np.ones((len(times), 3))})


def missing(trajectory: Trajectory) -> list[int]:
    """Return the frames in which the hand is not there."""
    return np.flatnonzero(np.isnan(trajectory.hand).any(axis=1)).tolist()


@LAW
@given(arrays(np.float64, st.tuples(st.integers(1, 60), st.just(3)), elements=coordinates), rates, begins)
def test_identity_where_rates_agree(hand: Floats, rate: float, begin: float) -> None:
    steps = np.full(len(hand), 1.0 / rate)
    steps[0] = begin
    for times in (begin + np.arange(len(hand)) / rate, np.cumsum(steps)):
        result = resample(Trajectory(times, hand, {"cup": hand[::-1]}), rate)
        np.testing.assert_allclose(result.times, times, atol=1e-9)
        np.testing.assert_array_equal(result.hand, hand)
        np.testing.assert_array_equal(result.objects["cup"], hand[::-1])


@LAW
@given(jittered(), rates, points, points)
def test_linear_motion_is_reproduced_at_any_rate(
    times: Floats, rate: float, origin: Floats, velocity: Floats
) -> None:
    def at(moments: Floats) -> Floats:
        positions: Floats = origin + (moments - times[0])[:, None] * velocity
        return positions

    result = resample(Trajectory(times, at(times), {"cup": at(times)}), rate)
    rounded = 1e-3 / rate * np.abs(velocity).max()  # a frame this little before a grid point is taken for it
    np.testing.assert_allclose(result.hand, at(result.times), atol=1e-6 + rounded)
    np.testing.assert_array_equal(result.objects["cup"], result.hand)


def test_a_frame_just_before_a_grid_point_is_the_same_in_any_chunking() -> None:
    times = np.array([0.88, 0.896, 0.921, 0.924, 0.936, 0.93999998, 0.951, 0.961])
    positions = np.random.default_rng(0).normal(size=(len(times), 1, 3))
    gaps = np.zeros(len(times), dtype=bool)
    whole, resampler = Resampler(50.0).push(times, positions, gaps, 0), Resampler(50.0)
    parts = [
        resampler.push(times[i : i + 1], positions[i : i + 1], gaps[i : i + 1], i) for i in range(len(times))
    ]
    for values, of_parts in zip(whole, zip(*parts, strict=True), strict=True):
        np.testing.assert_array_equal(np.concatenate(of_parts), values)


@pytest.mark.parametrize(
    ("times", "rate"),
    [(1.7e9 + np.arange(200) / 100.0, 100.0), (np.round(np.arange(200) / 60.0, 6), 60.0)],
)
def test_a_rounded_clock_does_not_spread_dropouts(times: Floats, rate: float) -> None:
    hand = np.zeros((200, 3))
    hand[50::10] = np.nan
    lost = np.isnan(resample(Trajectory(times, hand), rate).hand[:, 0])
    np.testing.assert_array_equal(np.flatnonzero(lost), np.arange(50, 200, 10))


def test_three_periods_are_no_gap_early_or_late_or_in_seconds_since_1970() -> None:
    for begin in (0.0, 1.7e9):
        for missing in ([5, 6], [45, 46]):
            times = begin + np.delete(np.arange(60) / 100.0, missing)
            assert not Period(None).gaps(np.diff(times)).any()


@LAW
@given(jittered(), rates)
def test_grid_is_regular_from_the_first_frame_to_the_last(times: Floats, rate: float) -> None:
    grid = resample(Trajectory(times, np.zeros((len(times), 3))), rate).times
    np.testing.assert_allclose(grid, times[0] + np.arange(len(grid)) / rate, atol=1e-12)
    assert grid[-1] <= times[-1] + 1e-5 / rate
    assert grid[-1] + 1.0 / rate > times[-1]


@LAW
@given(streams(), rates, st.data())
def test_any_chunking_gives_the_same_grid(
    stream: tuple[Floats, Floats, Flags], rate: float, data: st.DataObject
) -> None:
    times, positions, gaps = stream
    whole = Resampler(rate).push(times, positions, gaps, 0)
    cuts = sorted(data.draw(st.sets(st.integers(1, len(times)), max_size=len(times))) | {len(times)})
    resampler, grids = Resampler(rate), []
    for start, stop in zip([0, *cuts], cuts, strict=False):
        part = slice(start, stop)
        grids.append(resampler.push(times[part], positions[part], gaps[part], start))
    assert_same(joined(grids), whole)


@LAW
@given(streams(), rates, st.data())
def test_a_grid_point_depends_on_nothing_after_the_frame_that_released_it(
    stream: tuple[Floats, Floats, Flags], rate: float, data: st.DataObject
) -> None:
    times, positions, gaps = stream
    whole = Resampler(rate).push(times, positions, gaps, 0)
    n_frames = data.draw(st.integers(1, len(times)))
    first = Resampler(rate).push(times[:n_frames], positions[:n_frames], gaps[:n_frames], 0)
    known = whole.released < n_frames
    assert_same(first, until(whole, known))
    assert (np.diff(whole.released) >= 0).all()
    assert (whole.frames <= whole.released).all()


@LAW
@given(streams(), rates)
def test_grid_points_name_the_nearest_frame(stream: tuple[Floats, Floats, Flags], rate: float) -> None:
    times, positions, gaps = stream
    grid = Resampler(rate).push(times, positions, gaps, 0)
    distances = np.abs(grid.times[:, None] - times)
    np.testing.assert_allclose(np.abs(times[grid.frames] - grid.times), distances.min(axis=1), atol=1e-9)


@LAW
@given(streams(), rates)
def test_between_frames_is_what_was_seen_on_both_sides(
    stream: tuple[Floats, Floats, Flags], rate: float
) -> None:
    times, positions, gaps = stream
    grid = Resampler(rate).push(times, positions, gaps, 0)
    after, before = grid.released, np.maximum(grid.released - 1, 0)
    near = 2e-3 * np.maximum(times[after] - times[before], 1.0 / rate)
    between = np.abs(times[grid.frames] - grid.times) > near
    lost = np.isnan(positions[..., 0])
    unseen = lost[after] | lost[before] | gaps[after][:, None]
    np.testing.assert_array_equal(np.isnan(grid.positions[between, :, 0]), unseen[between])
    low, high = (
        np.minimum(positions[before], positions[after]),
        np.maximum(positions[before], positions[after]),
    )
    there = between[:, None] & ~unseen
    assert (grid.positions[there] >= low[there] - 1e-12).all()
    assert (grid.positions[there] <= high[there] + 1e-12).all()


@pytest.mark.parametrize(
    ("rate", "lost", "expected"),
    [
        (100.0, [5, 6], [5, 6]),
        (50.0, [5], []),
        (50.0, [6], [3]),
        (200.0, [5], [9, 10, 11]),
        (100.0, [0, 19], [0, 19]),
    ],
)
def test_dropouts_are_carried(rate: float, lost: list[int], expected: list[int]) -> None:
    result = resample(seen(np.arange(20) / 100.0, lost), rate)
    assert missing(result) == expected
    assert np.isfinite(result.objects["cup"]).all()


@pytest.mark.parametrize("rate", [50.0, 100.0, 200.0])
@pytest.mark.parametrize("n_lost", [3, 4, 30])
@pytest.mark.parametrize("at", [2, 40])
def test_gaps_become_dropouts_of_everything(rate: float, n_lost: int, at: int) -> None:
    """Both sides of a gap were seen; what lies between was not."""
    times = np.delete(np.arange(80) / 100.0, range(at, at + n_lost))
    result = resample(seen(times), rate)
    inside = (result.times > times[at - 1] + 1e-6) & (result.times < times[at] - 1e-6)
    assert missing(result) == np.flatnonzero(inside).tolist()
    assert np.isnan(result.objects["cup"][inside]).all()


def test_a_few_lost_frames_are_no_gap() -> None:
    assert missing(resample(seen(np.delete(np.arange(80) / 100.0, [10, 30, 31])), 50.0)) == []
    assert missing(resample(seen(np.delete(np.arange(80) / 100.0, [30, 31, 32])), 50.0)) == [15, 16]


@pytest.mark.parametrize("rate", [0.0, -50.0, np.nan])
def test_a_rate_that_is_none_is_refused(rate: float) -> None:
    with pytest.raises(InvalidTrajectory, match="rate"):
        resample(seen(np.arange(3.0)), rate)


@LAW
@given(st.floats(1.0, 1000.0), arrays(np.float64, 30, elements=st.floats(0.1, 6.0)))
def test_a_declared_rate_tells_gaps_from_the_first_interval_on(rate: float, periods: Floats) -> None:
    expected = periods > MAX_PERIODS * (1.0 + 1e-3)
    np.testing.assert_array_equal(Period(rate).gaps(periods / rate), expected)


@LAW
@given(rates, arrays(np.float64, 40, elements=st.floats(0.7, 1.4)), st.integers(1, 39), st.floats(4.5, 1e6))
def test_a_learned_period_tells_jitter_from_gaps(rate: float, periods: Floats, at: int, gap: float) -> None:
    assert not Period(None).gaps(periods / rate).any()
    periods[at] = gap
    assert np.flatnonzero(Period(None).gaps(periods / rate)).tolist() == [at]


def test_a_period_is_learned_once() -> None:
    """A stream that slows down for good has gaps from then on, as any chunking of it has."""
    intervals = np.concatenate([np.full(30, 0.01), np.full(30, 0.04)])
    np.testing.assert_array_equal(Period(None).gaps(intervals), intervals > 0.03)


@LAW
@given(arrays(np.float64, 40, elements=st.floats(1e-3, 1.0)), st.sets(st.integers(0, 40)), st.booleans())
def test_any_chunking_has_the_same_gaps(intervals: Floats, cuts: set[int], declared: bool) -> None:
    rate = 20.0 if declared else None
    whole, period = Period(rate).gaps(intervals), Period(rate)
    parts = [period.gaps(part) for part in np.split(intervals, sorted(cuts))]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_stack_puts_the_hand_before_the_objects_asked_for() -> None:
    times = np.arange(4.0)
    tracks = {name: np.full((4, 3), value) for value, name in enumerate(("cup", "box", "lid"), 1)}
    stacked = stack(Trajectory(times, np.zeros((4, 3)), tracks), ("lid", "cup"))
    np.testing.assert_array_equal(stacked, np.broadcast_to([[[0.0], [3.0], [1.0]]], (4, 3, 3)))
    assert stack(Trajectory(times, np.zeros((4, 3)), tracks), ()).shape == (4, 1, 3)


flags = arrays(np.bool_, 30)


@LAW
@given(points, flags, st.floats(1e-3, 1.0))
def test_smoothing_keeps_constants_and_dropouts(position: Floats, lost: Flags, sigma: float) -> None:
    hand = np.tile(position, (30, 1))
    hand[lost] = np.nan
    result = smooth(Trajectory(np.arange(30) / 100.0, hand), sigma)
    np.testing.assert_allclose(result.hand, hand, atol=1e-12)


@LAW
@given(arrays(np.float64, (30, 3), elements=coordinates), flags)
def test_smoothing_stays_within_what_was_seen(hand: Floats, lost: Flags) -> None:
    hand[lost] = np.nan
    result = smooth(Trajectory(np.arange(30) / 100.0, hand, {"cup": hand}))
    np.testing.assert_array_equal(np.isnan(result.hand).any(axis=1), lost)
    np.testing.assert_array_equal(result.objects["cup"], result.hand)
    if not lost.all():
        assert (result.hand[~lost] >= hand[~lost].min(axis=0) - 1e-12).all()
        assert (result.hand[~lost] <= hand[~lost].max(axis=0) + 1e-12).all()


@pytest.mark.parametrize("rate", [50.0, 100.0, 400.0])
def test_smoothing_reduces_noise_as_a_gaussian_does(rate: float) -> None:
    """White noise falls by the root of 2 sqrt(pi) standard deviations of the Gaussian, in frames."""
    rng = np.random.default_rng(3)
    n_frames, frames = 20_000, 0.04 * rate
    noise = Trajectory(np.arange(n_frames) / rate, rng.normal(0.0, 1e-3, (n_frames, 3)))
    left = smooth(noise, 0.04).hand.std() / noise.hand.std()
    assert left == pytest.approx(1.0 / np.sqrt(2.0 * np.sqrt(np.pi) * frames), rel=0.05)


def test_smoothing_keeps_even_motion_but_near_its_ends() -> None:
    even = seen(np.arange(60) / 100.0)
    np.testing.assert_allclose(smooth(even).hand[10:-10], even.hand[10:-10], atol=1e-12)


def test_a_single_frame_is_as_smooth_as_it_gets() -> None:
    single = seen(np.array([2.0]))
    assert smooth(single) is single
    np.testing.assert_array_equal(resample(single, 50.0).hand, single.hand)
