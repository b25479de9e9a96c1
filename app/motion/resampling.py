"""From the client's frames to the internal rate: causal, deterministic, the same in any chunking.

The grid starts at the first frame. A grid point between two frames is interpolated between them; where
either is a dropout, or where they lie more than three periods apart, it is a dropout too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from app.motion.errors import InvalidTrajectory
from app.motion.state import State
from app.motion.trajectory import Flags, Floats, Trajectory

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

    def gaps(self, intervals: Floats) -> Flags:
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

    def state(self) -> State:
        """Return what the intervals before have left behind."""
        known = [] if self._declared is None else [self._declared]
        return {"known": np.array(known), "intervals": np.array(self._intervals)}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self._declared = next(iter(state["known"].tolist()), None)
        self._intervals = state["intervals"].tolist()


class Resampler:
    """Resamples a stream to ``rate`` [Hz], chunk by chunk."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self._begin = 0.0
        self._emitted = 0
        self._time = 0.0
        self._frame = -1
        self._position: Floats = np.empty((0, 3))

    def push(self, times: Floats, positions: Floats, gaps: Flags, first_frame: int) -> Grid:
        """Return the grid points up to the last of these frames.

        times: (n,) [s]; positions: (n, n_tracks, 3) [m]; gaps: (n,) whether a gap lies before a frame;
        first_frame: number of the first of them.
        """
        if self._emitted == 0:
            self._begin, self._time, self._frame = float(times[0]), float(times[0]), first_frame
            self._position = positions[0]
        grid = _interpolated(
            times,
            positions,
            gaps,
            first_frame,
            (self._begin, self.rate, self._emitted),
            (self._time, self._position, self._frame),
        )
        self._time, self._position = float(times[-1]), positions[-1]
        self._frame = first_frame + len(times) - 1
        self._emitted += len(grid[0])
        return Grid(*grid)

    def state(self) -> State:
        """Return what the frames before have left behind."""
        counts = np.array([self._emitted, self._frame])
        return {"clock": np.array([self._begin, self._time]), "counts": counts, "position": self._position}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self._begin, self._time = state["clock"].tolist()
        self._emitted, self._frame = state["counts"].tolist()
        self._position = state["position"]


Before = tuple[float, Floats, int]
"""Time [s], positions (n_tracks, 3) [m] and number of the frame before."""


@njit(cache=True, nogil=True)
def _interpolated(
    times: Floats,
    positions: Floats,
    gaps: Flags,
    first_frame: int,
    grid: tuple[float, float, int],
    before: Before,
) -> tuple[Floats, Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Return the fields of a Grid; grid: where it begins [s], its rate [Hz], and points that were before."""
    begin, rate, emitted = grid
    time, position, number = before
    n = int(np.floor((times[-1] - begin) * rate + _SAME)) + 1 - emitted
    at, mixed = np.empty(n), np.empty((n, *positions.shape[1:]))
    nearest, released = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    done = 0
    for index in range(len(times)):
        reached = int(np.floor((times[index] - begin) * rate + _SAME)) + 1 - emitted
        while done < reached:
            at[done] = begin + (emitted + done) / rate
            interval = times[index] - time
            weight = (at[done] - time) / interval if interval > 0.0 else 1.0
            _mix(position, positions[index], weight, gaps[index], mixed[done])
            nearest[done] = number if weight < 0.5 else first_frame + index
            released[done] = first_frame + index
            done += 1
        time, position, number = times[index], positions[index], first_frame + index
    return at, mixed, nearest, released


@njit(cache=True, nogil=True)
def _mix(before: Floats, behind: Floats, weight: float, is_gap: bool, mixed: Floats) -> None:
    """Write what lies between two frames (n_tracks, 3), or the one that it all but is."""
    for track in range(len(mixed)):
        for axis in range(3):
            value = before[track, axis] * (1.0 - weight) + behind[track, axis] * weight
            value = np.nan if is_gap else value
            near = _SAME if np.isnan(value) else _EXACT
            if weight <= near:
                value = before[track, axis]
            elif weight >= 1.0 - near:
                value = behind[track, axis]
            mixed[track, axis] = value


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
