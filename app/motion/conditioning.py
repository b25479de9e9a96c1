"""What is observed of a track at the internal rate: where it is, and how fast.

Each point of the grid is the Gaussian-weighted mean of the points around it, each of these the median of
five: a thrown-off frame or two are gone, and what moves steadily stays as it is. The median of vectors is
the one nearest to all others, so that it turns with the world. Speed is the slope of the line through the
points around, less what noise alone would make of it. A point needs ``REACH`` points on either side, fewer
where a stream begins or ends, and those that are missing are left out; a dropout stays one.

Speeds are observed as *paces*, ``log(1 + speed / still)``: people differ in pace by factors.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from app.motion.model import FeatureSpecification
from app.motion.resampling import Grid
from app.motion.trajectory import Floats

HALF_MEDIAN, HALF_MEAN, HALF_SLOPE = 2, 2, 4
"""Points on either side that a median, a mean and a slope look at."""

MEAN_SPREAD, SLOPE_SPREAD = 1.0, 2.5
"""Standard deviations of the weights of a mean and of a slope [points]: 20 and 50 ms at 50 Hz."""

HALF_NOISE = 6
"""Points on either side by which noise is judged: its third differences."""

_OFFS = np.arange(-HALF_SLOPE, HALF_SLOPE + 1.0)
_OF_SLOPE = np.exp(-0.5 * (_OFFS / SLOPE_SPREAD) ** 2)
_OF_MEAN = np.exp(-0.5 * (np.arange(HALF_MEAN + 1.0) / MEAN_SPREAD) ** 2)
NOISE_LEFT = float(np.sum((_OF_SLOPE * _OFFS) ** 2) / np.sum(_OF_SLOPE * _OFFS**2) ** 2)
"""Share of the mean square of noise that is left in the square of a slope; it is taken off."""

REACH = max(HALF_MEDIAN + HALF_SLOPE, HALF_NOISE)
"""Points on either side that a point depends on."""


class Tracks(NamedTuple):
    """Conditioned motion.

    hand: (n, 3) [m]; pace: (n,) of the hand; objects: (n_objects, n, 3) [m]; paces: (n_objects,
    n). NaN where something was not seen.
    """

    hand: Floats
    pace: Floats
    objects: Floats
    paces: Floats

    def part(self, start: int, stop: int) -> Tracks:
        """Return points ``start..stop-1``."""
        at = slice(start, stop)
        return Tracks(self.hand[at], self.pace[at], self.objects[:, at], self.paces[:, at])


def condition(
    positions: Floats, features: FeatureSpecification, start: int = 0, stop: int | None = None
) -> Tracks:
    """Return points ``start..stop-1`` of a grid, conditioned with all points that are given.

    positions: (n, n_tracks, 3) [m], the hand's first, at the internal rate.
    """
    stop = len(positions) if stop is None else stop
    in_still = features.rate / features.still
    placed, paces = _condition(np.ascontiguousarray(positions), in_still, start, stop)
    return Tracks(placed[0], paces[0], placed[1:], paces[1:])


@njit(cache=True, nogil=True)
def _condition(positions: Floats, in_still: float, start: int, stop: int) -> tuple[Floats, Floats]:
    """Return positions and paces; in_still: what a metre between two points is in speeds of stillness."""
    n, n_tracks, _ = positions.shape
    placed = np.full((n_tracks, stop - start, 3), np.nan)
    paces = np.full((n_tracks, stop - start), np.nan)
    begin, end = max(start - HALF_SLOPE, 0), min(stop + HALF_SLOPE, n)
    medians = np.empty((end - begin, 3))
    for track in range(n_tracks):
        for at in range(begin, end):
            medians[at - begin] = positions[_median(positions, track, at), track]
        for at in range(start, stop):
            if not np.isnan(medians[at - begin, 0]):
                placed[track, at - start] = _mean(medians, at - begin)
                square = -NOISE_LEFT * _noise(positions[:, track], at)
                for axis in range(3):
                    square += _slope(medians, axis, at - begin) ** 2
                paces[track, at - start] = np.log1p(in_still * np.sqrt(max(square, 0.0)))
    return placed, paces


@njit(cache=True, nogil=True, inline="always")
def _paired(values: Floats, at: int, off: int) -> bool:
    """Return whether the points so far before and after a point are both there."""
    if at - off < 0 or at + off >= len(values):
        return False
    return not (np.isnan(values[at - off, 0]) or np.isnan(values[at + off, 0]))


@njit(cache=True, nogil=True)
def _median(positions: Floats, track: int, at: int) -> int:
    """Return the point around ``at`` that is nearest to all others there: the median of vectors.

    Points count in pairs around the middle, so that a steady movement stays as it is; of equals the
    middle one.
    """
    values = positions[:, track]
    best, least = at, np.inf
    for step in range(2 * HALF_MEDIAN + 1):
        candidate = at + ((step + 1) // 2) * (1 if step % 2 else -1)
        if candidate == at or _paired(values, at, abs(candidate - at)):
            total = 0.0
            for off in range(-HALF_MEDIAN, HALF_MEDIAN + 1):
                if off == 0 or _paired(values, at, abs(off)):
                    total += np.sqrt(np.sum((values[candidate] - values[at + off]) ** 2))
            if total < least:
                best, least = candidate, total
    return best


@njit(cache=True, nogil=True)
def _mean(values: Floats, at: int) -> Floats:
    total, weights = values[at].copy(), 1.0
    for off in range(1, HALF_MEAN + 1):
        if _paired(values, at, off):
            weight = _OF_MEAN[off]
            total += weight * (values[at - off] + values[at + off])
            weights += 2.0 * weight
    mean: Floats = total / weights
    return mean


@njit(cache=True, nogil=True)
def _noise(values: Floats, at: int) -> float:
    """Return the mean square of the noise of positions around a point, by their third differences [m^2].

    A hand's movement hardly has any from point to point; those of noise have 20 times its square. The median
    of them does not see thrown-off frames.
    """
    squares = np.empty(2 * HALF_NOISE)
    count = 0
    for first in range(max(at - HALF_NOISE, 0), min(at + HALF_NOISE - 2, len(values) - 3)):
        off = values[first + 3] - 3.0 * values[first + 2] + 3.0 * values[first + 1] - values[first]
        square = np.sum(off**2)
        if not np.isnan(square):
            squares[count] = square
            count += 1
    return float(np.median(squares[:count])) / 20.0 if count > 0 else 0.0


@njit(cache=True, nogil=True, inline="always")
def _slope(values: Floats, axis: int, at: int) -> float:
    """Return the slope per point of the weighted line through the values around, 0 where there is but one."""
    w = wt = wx = wtt = wtx = 0.0
    for near in range(max(at - HALF_SLOPE, 0), min(at + HALF_SLOPE + 1, len(values))):
        value = values[near, axis]
        if not np.isnan(value):
            time = float(near - at)
            weight = _OF_SLOPE[near - at + HALF_SLOPE]
            w += weight
            wt += weight * time
            wx += weight * value
            wtt += weight * time * time
            wtx += weight * time * value
    spread = w * wtt - wt * wt
    return (w * wtx - wt * wx) / spread if spread > 0.0 else 0.0


class Conditioned(NamedTuple):
    """Conditioned points of a stream.

    tracks; times: (n,) [s]; frames: (n,) the nearest of the client's frames; released: (n,) the frame
    with which the point was known.
    """

    tracks: Tracks
    times: Floats
    frames: NDArray[np.int64]
    released: NDArray[np.int64]


class Conditioner:
    """Conditions the grid of a stream, chunk by chunk: a point is ready ``REACH`` points later."""

    def __init__(self, features: FeatureSpecification, n_tracks: int) -> None:
        self._features = features
        nothing: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._grid = Grid(np.empty(0), np.empty((0, n_tracks, 3)), nothing, nothing)
        self._ready = 0

    def push(self, grid: Grid) -> Conditioned:
        """Take the next points; return those that are ready."""
        self._grid = _joined(self._grid, grid)
        ready = self._take(max(len(self._grid.times) - REACH, self._ready))
        drop = max(self._ready - REACH, 0)
        times, positions, frames, released = self._grid
        self._grid = Grid(times[drop:], positions[drop:], frames[drop:], released[drop:])
        self._ready -= drop
        return ready

    def finish(self) -> Conditioned:
        """Return the points that are left; there are no more."""
        return self._take(len(self._grid.times))

    def ahead(self) -> Conditioned:
        """Return the points that are not ready, conditioned with what is known so far."""
        return self._part(self._ready, len(self._grid.times))

    def _take(self, stop: int) -> Conditioned:
        start, self._ready = self._ready, stop
        return self._part(start, stop)

    def _part(self, start: int, stop: int) -> Conditioned:
        known = np.minimum(np.arange(start, stop) + REACH, len(self._grid.times) - 1)
        return Conditioned(
            condition(self._grid.positions, self._features, start, stop),
            self._grid.times[start:stop],
            self._grid.frames[start:stop],
            self._grid.released[known],
        )


def _joined(before: Grid, after: Grid) -> Grid:
    return Grid(
        np.concatenate([before.times, after.times]),
        np.concatenate([before.positions, after.positions]),
        np.concatenate([before.frames, after.frames]),
        np.concatenate([before.released, after.released]),
    )
