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
from app.motion.state import State
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
    medians, squares = np.empty((end - begin, 3)), np.empty(2 * HALF_NOISE)
    for track in range(n_tracks):
        for at in range(begin, end):
            median = _median(positions, track, at)
            for axis in range(3):
                medians[at - begin, axis] = positions[median, track, axis]
        for at in range(start, stop):
            if not np.isnan(medians[at - begin, 0]):
                _mean(medians, at - begin, placed[track, at - start])
                square = -NOISE_LEFT * _noise(positions, track, at, squares)
                for axis in range(3):
                    square += _slope(medians, axis, at - begin) ** 2
                paces[track, at - start] = np.log1p(in_still * np.sqrt(max(square, 0.0)))
    return placed, paces


@njit(cache=True, nogil=True, inline="always")
def _distance(positions: Floats, track: int, one: int, other: int) -> float:
    dx = positions[one, track, 0] - positions[other, track, 0]
    dy = positions[one, track, 1] - positions[other, track, 1]
    dz = positions[one, track, 2] - positions[other, track, 2]
    return np.sqrt(dx * dx + dy * dy + dz * dz)  # type: ignore[no-any-return]


@njit(cache=True, nogil=True)
def _median(positions: Floats, track: int, at: int) -> int:
    """Return the point around ``at`` that is nearest to all others there: the median of vectors.

    Points count in pairs around the middle, so that a steady movement stays as it is; of equals the
    middle one.
    """
    best, least = at, np.inf
    for step in range(2 * HALF_MEDIAN + 1):
        candidate = at + ((step + 1) // 2) * (1 if step % 2 else -1)
        if candidate == at or _paired(positions, track, at, abs(candidate - at)):
            total = 0.0
            for off in range(-HALF_MEDIAN, HALF_MEDIAN + 1):
                if off == 0 or _paired(positions, track, at, abs(off)):
                    total += _distance(positions, track, candidate, at + off)
            if total < least:
                best, least = candidate, total
    return best


@njit(cache=True, nogil=True, inline="always")
def _paired(positions: Floats, track: int, at: int, off: int) -> bool:
    """Return whether the points so far before and after a point are both there."""
    if at - off < 0 or at + off >= len(positions):
        return False
    return not (np.isnan(positions[at - off, track, 0]) or np.isnan(positions[at + off, track, 0]))


@njit(cache=True, nogil=True)
def _mean(values: Floats, at: int, mean: Floats) -> None:
    """Write the weighted mean of the values (n, 3) around one that is there."""
    weights = 1.0
    for axis in range(3):
        mean[axis] = values[at, axis]
    for off in range(1, HALF_MEAN + 1):
        is_within = at - off >= 0 and at + off < len(values)
        if is_within and not (np.isnan(values[at - off, 0]) or np.isnan(values[at + off, 0])):
            weights += 2.0 * _OF_MEAN[off]
            for axis in range(3):
                mean[axis] += _OF_MEAN[off] * (values[at - off, axis] + values[at + off, axis])
    for axis in range(3):
        mean[axis] /= weights


@njit(cache=True, nogil=True)
def _noise(positions: Floats, track: int, at: int, squares: Floats) -> float:
    """Return the mean square of the noise of positions around a point, by their third differences [m^2].

    A hand's movement hardly has any from point to point; those of noise have 20 times its square. The median
    of them does not see thrown-off frames. squares: room to work in.
    """
    count = 0
    for first in range(max(at - HALF_NOISE, 0), min(at + HALF_NOISE - 2, len(positions) - 3)):
        square = 0.0
        for axis in range(3):
            off = positions[first + 3, track, axis] - 3.0 * positions[first + 2, track, axis]
            off += 3.0 * positions[first + 1, track, axis] - positions[first, track, axis]
            square += off * off
        if not np.isnan(square):
            place = count
            while place > 0 and squares[place - 1] > square:
                squares[place] = squares[place - 1]
                place -= 1
            squares[place] = square
            count += 1
    if count == 0:
        return 0.0
    return 0.5 * (squares[(count - 1) // 2] + squares[count // 2]) / 20.0  # type: ignore[no-any-return]


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
        self._nothing = self._part(0, 0)

    def push(self, grid: Grid) -> Conditioned:
        """Take the next points; return those that are ready."""
        if len(grid.times) == 0:
            return self._nothing
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

    def state(self) -> State:
        """Return what the points before have left behind."""
        return {"ready": np.array(self._ready), **self._grid._asdict()}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self._ready = int(state["ready"])
        self._grid = Grid(*(state[name] for name in Grid._fields))

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
