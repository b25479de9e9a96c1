"""From the client's frames to the internal rate: causal, deterministic, the same in any chunking.

The grid starts at the first frame. A grid point between two frames is interpolated between them; where
either is a dropout, or where they lie more than three periods apart, it is a dropout too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from app.motion.errors import InvalidTrajectory
from app.motion.trajectory import Floats, Trajectory

MAX_PERIODS = 3.0
"""Frames farther apart than this many periods have a gap between them."""

SMOOTHING = 0.02
"""Standard deviation of the smoothing of what is shown [s]."""

_LEARNING = 16  # intervals from which the period of a stream without a declared rate is known
_SAME = 1e-3  # a grid point this close to a frame, in intervals, is seen if the frame is: clocks are rounded
_EXACT = 1e-6  # one this close is that frame


class Grid(NamedTuple):
    """Consecutive grid points.

    times: (n,) [s]; positions: (n, n_tracks, 3) [m], the hand's first; frames: (n,) the nearest of the
    client's frames and released: (n,) the one with which the point was known, counted over the whole stream.
    """

    times: Floats
    positions: Floats
    frames: NDArray[np.int64]
    released: NDArray[np.int64]


class Period:
    """The period of a stream: declared, or the median of its first intervals [s]."""

    def __init__(self, rate: float | None) -> None:
        self._declared = None if rate is None else 1.0 / rate
        self._intervals: list[float] = []

    def gaps(self, intervals: Floats) -> NDArray[np.bool_]:
        """Return which of the next intervals [s] are gaps."""
        gaps = np.zeros(len(intervals), dtype=bool)
        done = 0
        while self._declared is None and done < len(intervals):
            interval = float(intervals[done])
            seen = self._intervals
            gaps[done] = len(seen) > 0 and interval > MAX_PERIODS * float(np.median(seen)) * (1.0 + _SAME)
            seen.append(interval)
            if len(seen) == _LEARNING:
                self._declared = float(np.median(seen))
            done += 1
        if self._declared is not None:
            gaps[done:] = intervals[done:] > MAX_PERIODS * self._declared * (1.0 + _SAME)
        return gaps


class Resampler:
    """Resamples a stream to ``rate`` [Hz], chunk by chunk."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self._begin = 0.0
        self._emitted = 0
        self._time = 0.0
        self._frame = -1
        self._position: Floats = np.empty((0, 3))

    def push(self, times: Floats, positions: Floats, gaps: NDArray[np.bool_], first_frame: int) -> Grid:
        """Return the grid points up to the last of these frames.

        times: (n,) [s]; positions: (n, n_tracks, 3) [m]; gaps: (n,) whether a gap lies before a frame;
        first_frame: number of the first of them.
        """
        if self._emitted == 0:
            self._begin, self._time, self._frame = float(times[0]), float(times[0]), first_frame
            self._position = positions[0]
        times = np.concatenate([[self._time], times])
        positions = np.concatenate([self._position[None], positions])
        numbers = np.concatenate([[self._frame], np.arange(first_frame, first_frame + len(times) - 1)])
        self._time, self._position, self._frame = float(times[-1]), positions[-1], int(numbers[-1])
        reached = np.floor((times - self._begin) * self.rate + _SAME).astype(np.int64)
        ticks = np.arange(self._emitted, reached[-1] + 1)
        self._emitted += len(ticks)
        grid = self._begin + ticks / self.rate
        after = np.searchsorted(reached, ticks).clip(1, len(times) - 1)
        return _interpolate(grid, times, positions, numbers, gaps, after)


def _interpolate(
    grid: Floats,
    times: Floats,
    positions: Floats,
    numbers: NDArray[np.int64],
    gaps: NDArray[np.bool_],
    after: NDArray[np.int64],
) -> Grid:
    interval = times[after] - times[after - 1]
    weight = np.divide(grid - times[after - 1], interval, out=np.ones(len(grid)), where=interval > 0)
    before, behind = positions[after - 1], positions[after]
    w = weight[:, None, None]
    mixed = before * (1.0 - w) + behind * w
    mixed[gaps[after - 1]] = np.nan
    near = np.where(np.isnan(mixed), _SAME, _EXACT)
    mixed = np.where(w <= near, before, np.where(w >= 1.0 - near, behind, mixed))
    nearest = np.where(weight < 0.5, numbers[after - 1], numbers[after])
    return Grid(grid, mixed, nearest, numbers[after])


def stack(trajectory: Trajectory, objects: tuple[str, ...]) -> Floats:
    """Return (n_frames, 1 + n_objects, 3) positions [m] of the hand and the named objects."""
    return np.stack([trajectory.hand, *(trajectory.objects[name] for name in objects)], axis=1)


def resample(trajectory: Trajectory, rate: float) -> Trajectory:
    """Return the trajectory at ``rate`` [Hz], from its first frame on; dropouts and gaps become NaN.

    Raises InvalidTrajectory where ``rate`` is not positive.
    """
    if not rate > 0:
        raise InvalidTrajectory("times", None, f"cannot be resampled to {rate} Hz: the rate must be positive")
    names = tuple(trajectory.objects)
    times = trajectory.times
    gaps = np.concatenate([[False], Period(None).gaps(np.diff(times))])
    grid = Resampler(rate).push(times, stack(trajectory, names), gaps, 0)
    tracks = {name: grid.positions[:, 1 + index] for index, name in enumerate(names)}
    return Trajectory(grid.times, grid.positions[:, 0], tracks)


def smooth(trajectory: Trajectory, sigma: float = SMOOTHING) -> Trajectory:
    """Return the trajectory smoothed by a Gaussian of ``sigma`` [s]; its frames are evenly spaced.

    Dropouts stay dropouts and do not spread. What is learned and recognised goes through ``conditioning``.
    """
    if len(trajectory) < 2:
        return trajectory
    frames = sigma * (len(trajectory) - 1) / float(trajectory.times[-1] - trajectory.times[0])
    objects = {name: _blur(track, frames) for name, track in trajectory.objects.items()}
    return Trajectory(trajectory.times, _blur(trajectory.hand, frames), objects)


def _blur(positions: Floats, sigma: float) -> Floats:
    present = ~np.isnan(positions)
    weight = gaussian_filter1d(present.astype(np.float64), sigma, axis=0, mode="nearest")
    total = gaussian_filter1d(np.where(present, positions, 0.0), sigma, axis=0, mode="nearest")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(present, total / weight, np.nan)
