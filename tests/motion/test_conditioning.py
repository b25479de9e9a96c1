"""Conditioning: the same in any chunks, from what lies around alone, true to what moves steadily."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.motion.conditioning import (
    HALF_MEAN,
    HALF_MEDIAN,
    HALF_NOISE,
    HALF_SLOPE,
    MEAN_SPREAD,
    NOISE_LEFT,
    REACH,
    SLOPE_SPREAD,
    Conditioned,
    Conditioner,
    Tracks,
    condition,
)
from app.motion.model import FeatureSpecification
from app.motion.resampling import Grid
from app.motion.trajectory import Floats

OBSERVED = FeatureSpecification()
RATE, STILL = OBSERVED.rate, OBSERVED.still

seeds = st.integers(0, 2**32 - 1)


def walk(rng: np.random.Generator, n: int, n_tracks: int = 2, lost: float = 0.0) -> Floats:
    """Return (n, n_tracks, 3) positions of walks that lose so large a share of their points [m]."""
    positions = rng.normal(0.0, 0.02, (n, n_tracks, 3)).cumsum(axis=0)
    positions[rng.random((n, n_tracks)) < lost] = np.nan
    return positions


def grid_of(positions: Floats) -> Grid:
    """Return a grid whose points are known two frames after the frame that they are nearest to."""
    frames = 2 * np.arange(len(positions))
    return Grid(frames / (2.0 * RATE), positions, frames, frames + 2)


def part_of(grid: Grid, start: int, stop: int) -> Grid:
    times, positions, frames, released = grid
    return Grid(times[start:stop], positions[start:stop], frames[start:stop], released[start:stop])


def joined(parts: Sequence[Tracks]) -> Tracks:
    hands, paces, objects, of_objects = zip(*parts, strict=True)
    return Tracks(
        np.concatenate(hands),
        np.concatenate(paces),
        np.concatenate(objects, axis=1),
        np.concatenate(of_objects, axis=1),
    )


def streamed(grid: Grid, cuts: Sequence[int]) -> list[Conditioned]:
    """Return what becomes of a grid that comes in parts."""
    conditioner = Conditioner(OBSERVED, grid.positions.shape[1])
    edges = [0, *sorted(cuts), len(grid.times)]
    ready = [conditioner.push(part_of(grid, start, stop)) for start, stop in pairwise(edges)]
    return [*ready, conditioner.finish()]


def same(one: Tracks, other: Tracks) -> None:
    for mine, theirs in zip(one, other, strict=True):
        np.testing.assert_array_equal(mine, theirs)


def around(track: Floats, at: int, half: int) -> list[int]:
    """Return a point and those around it that are there in pairs, one before and one after."""
    pairs = [(at - off, at + off) for off in range(1, half + 1) if at - off >= 0 and at + off < len(track)]
    there = [pair for pair in pairs if not np.isnan(track[list(pair)]).any()]
    return [at, *(point for pair in there for point in pair)]


def noise(track: Floats, at: int) -> float:
    """Return the mean square of the noise around a point, by the median of the third differences [m^2]."""
    within = track[max(at - HALF_NOISE, 0) : at + HALF_NOISE + 1]
    squares = np.square(np.diff(within, 3, axis=0)).sum(axis=1)
    seen = squares[~np.isnan(squares)]
    return float(np.median(seen)) / 20.0 if len(seen) else 0.0


def plainly(track: Floats) -> tuple[Floats, Floats]:
    """Return the (n, 3) places and the (n,) speeds of a track, as their description says."""
    at, seen = np.arange(len(track)), ~np.isnan(track[:, 0])
    medians, places, speeds = track.copy(), np.full(track.shape, np.nan), np.full(len(track), np.nan)
    for i in np.flatnonzero(seen).tolist():
        near = track[around(track, i, HALF_MEDIAN)]
        medians[i] = near[np.linalg.norm(near[:, None] - near, axis=2).sum(axis=1).argmin()]
    for i in np.flatnonzero(seen).tolist():
        mean = np.array(around(track, i, HALF_MEAN), dtype=np.int64)
        places[i] = np.average(medians[mean], axis=0, weights=np.exp(-0.5 * ((mean - i) / MEAN_SPREAD) ** 2))
        line = np.flatnonzero(seen & (np.abs(at - i) <= HALF_SLOPE))
        weights = np.exp(-0.25 * ((line - i) / SLOPE_SPREAD) ** 2)  # polyfit squares them
        slope = np.polyfit(line - i, medians[line], 1, w=weights)[0] if len(line) > 1 else np.zeros(3)
        speeds[i] = RATE * np.sqrt(max(np.square(slope).sum() - NOISE_LEFT * noise(track, i), 0.0))
    return places, speeds


@given(seeds, st.integers(0, 40), st.sampled_from([0.0, 0.3, 0.8]))
def test_is_what_its_description_says(seed: int, n: int, lost: float) -> None:
    positions = walk(np.random.default_rng(seed), n, lost=lost)
    found = condition(positions, OBSERVED)
    for track, place, pace in ((0, found.hand, found.pace), (1, found.objects[0], found.paces[0])):
        places, speeds = plainly(positions[:, track])
        np.testing.assert_allclose(place, places, atol=1e-12)
        np.testing.assert_allclose(pace, np.log1p(speeds / STILL), atol=1e-9)


@given(seeds, st.integers(1, 60), st.lists(st.integers(0, 60), max_size=12))
def test_chunks_do_not_matter_to_the_last_bit(seed: int, n: int, cuts: list[int]) -> None:
    grid = grid_of(walk(np.random.default_rng(seed), n, lost=0.2))
    parts = streamed(grid, [min(cut, n) for cut in cuts])
    same(joined([each.tracks for each in parts]), condition(grid.positions, OBSERVED))
    np.testing.assert_array_equal(np.concatenate([each.times for each in parts]), grid.times)
    np.testing.assert_array_equal(np.concatenate([each.frames for each in parts]), grid.frames)
    released = np.concatenate([each.released for each in parts])
    np.testing.assert_array_equal(released, grid.released[np.minimum(np.arange(n) + REACH, n - 1)])


@given(seeds, st.integers(2, 60))
def test_a_point_is_ready_when_it_says_so_and_not_before(seed: int, n: int) -> None:
    grid, conditioner = grid_of(walk(np.random.default_rng(seed), n)), Conditioner(OBSERVED, 2)
    for at in range(n):
        ready = conditioner.push(part_of(grid, at, at + 1))
        np.testing.assert_array_equal(ready.frames, grid.frames[max(at - REACH, 0) : max(at - REACH + 1, 0)])
        np.testing.assert_array_equal(ready.released, grid.released[at : at + len(ready.frames)])
    assert len(conditioner.finish().frames) == min(REACH, n)
    assert len(conditioner.finish().frames) == 0


@given(seeds, st.integers(1, 40))
def test_what_lies_ahead_is_what_an_end_here_would_give(seed: int, n: int) -> None:
    grid, conditioner = grid_of(walk(np.random.default_rng(seed), n, lost=0.2)), Conditioner(OBSERVED, 2)
    ready = [conditioner.push(part_of(grid, at, at + 1)).tracks for at in range(n)]
    ahead = conditioner.ahead()
    same(joined([*ready, ahead.tracks]), condition(grid.positions, OBSERVED))
    for other in (conditioner.ahead(), conditioner.finish()):
        same(other.tracks, ahead.tracks)
        np.testing.assert_array_equal(other.frames, ahead.frames)
        np.testing.assert_array_equal(other.times, ahead.times)


@given(seeds, st.integers(0, 39))
def test_a_point_depends_on_those_within_reach_alone(seed: int, at: int) -> None:
    rng = np.random.default_rng(seed)
    here = walk(rng, 40, lost=0.2)
    elsewhere = here + rng.normal(0.0, 5.0, here.shape)
    near = np.abs(np.arange(40) - at) <= REACH
    elsewhere[near] = here[near]
    same(condition(elsewhere, OBSERVED).part(at, at + 1), condition(here, OBSERVED).part(at, at + 1))


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.integers(1, 40), seeds, st.sampled_from([0.0, 0.4]))
def test_steady_movement_is_kept_to_its_ends(along: float, up: float, n: int, seed: int, lost: float) -> None:
    velocity = np.array([along, -0.5 * along, up])
    hand = np.array([0.3, 0.2, 0.1]) + np.arange(n)[:, None] / RATE * velocity
    seen = np.random.default_rng(seed).random(n) >= lost
    hand[~seen] = np.nan
    found, n_near = (
        condition(hand[:, None], OBSERVED),
        np.convolve(seen, np.ones(2 * HALF_SLOPE + 1))[HALF_SLOPE:],
    )
    np.testing.assert_allclose(found.hand, hand, atol=1e-12)
    speed = float(np.linalg.norm(velocity))
    known = seen & (n_near[:n] > 1.5)
    np.testing.assert_allclose(found.pace[known], np.log1p(speed / STILL), atol=1e-9)


@given(seeds, st.integers(REACH, 24), st.integers(1, HALF_MEDIAN))
def test_frames_thrown_off_vanish(seed: int, at: int, n_off: int) -> None:
    still = np.full((40, 1, 3), 0.2)
    thrown = still.copy()
    thrown[at : at + n_off] += np.random.default_rng(seed).normal(0.0, 1.0, (n_off, 1, 3))
    for one, other in zip(condition(thrown, OBSERVED), condition(still, OBSERVED), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


@pytest.mark.parametrize("size", [0.0003, 0.001, 0.003])
def test_noise_does_not_look_like_speed(size: float) -> None:
    """What noise leaves in the squares of speeds is taken off: two fifths of a still hand's are nothing."""
    rng = np.random.default_rng(1)
    still = condition(rng.normal(0.0, size, (5000, 1, 3)), OBSERVED).pace
    assert np.quantile(STILL * np.expm1(still), 0.4) < 1e-9


@pytest.mark.parametrize("size", [0.0003, 0.001, 0.003])
def test_a_moving_hand_keeps_its_speed_whatever_its_noise(size: float) -> None:
    rng, velocity = np.random.default_rng(2), np.array([0.6, -0.3, 0.2])
    hand = np.arange(5000)[:, None] / RATE * velocity + rng.normal(0.0, size, (5000, 3))
    squares = np.square(STILL * np.expm1(condition(hand[:, None], OBSERVED).pace))
    assert squares.mean() == pytest.approx(np.square(velocity).sum(), rel=0.02)


@given(seeds, st.floats(0.0, 1.0))
def test_dropouts_stay_dropouts_and_nothing_else_becomes_one(seed: int, lost: float) -> None:
    positions = walk(np.random.default_rng(seed), 40, lost=lost)
    found, missing = condition(positions, OBSERVED), np.isnan(positions[:, :, 0])
    np.testing.assert_array_equal(np.isnan(found.hand), np.repeat(missing[:, :1], 3, axis=1))
    np.testing.assert_array_equal(np.isnan(found.pace), missing[:, 0])
    np.testing.assert_array_equal(np.isnan(found.objects[0, :, 0]), missing[:, 1])
    np.testing.assert_array_equal(np.isnan(found.paces[0]), missing[:, 1])


@given(seeds, st.floats(0.0, 0.5))
def test_turns_and_shifts_with_the_world(seed: int, lost: float) -> None:
    rng = np.random.default_rng(seed)
    positions, shift = walk(rng, 30, lost=lost), rng.normal(0.0, 1.0, 3)
    rotation, _ = np.linalg.qr(rng.normal(0.0, 1.0, (3, 3)))
    found, turned = condition(positions, OBSERVED), condition(positions @ rotation.T + shift, OBSERVED)
    np.testing.assert_allclose(turned.hand, found.hand @ rotation.T + shift, atol=1e-12)
    np.testing.assert_allclose(turned.objects, found.objects @ rotation.T + shift, atol=1e-12)
    np.testing.assert_allclose(turned.pace, found.pace, atol=1e-9)
    np.testing.assert_allclose(turned.paces, found.paces, atol=1e-9)


@pytest.mark.parametrize(("start", "stop"), [(0, 0), (0, 3), (7, 20), (30, 40), (40, 40)])
def test_a_part_is_that_of_the_whole(start: int, stop: int) -> None:
    positions = walk(np.random.default_rng(1), 40, lost=0.1)
    same(condition(positions, OBSERVED, start, stop), condition(positions, OBSERVED).part(start, stop))
