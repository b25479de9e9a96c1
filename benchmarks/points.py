"""What the other methods see of motion: points at regular intervals, gaps bridged, noise smoothed away."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.motion.resampling import resample, smooth, stack
from app.motion.trajectory import Demonstration, Floats, Segment, Trajectory

RATE = 50.0
"""Points per second."""

N_STREAMS, N_JOINED = 30, 3
"""So many streams, each of so many demonstrations, are joined of what is learned from."""

Span = tuple[int, int, str | None]
"""First point, the one behind the last, and the class, None for none."""


@dataclass(frozen=True)
class Points:
    """Motion at RATE.

    positions: (n_points, 1 + n_objects, 3) of the hand and the objects [m]; velocities: likewise [m/s];
    frames: (n_points,) the recording's frame nearest to each point.
    """

    positions: Floats
    velocities: Floats
    frames: NDArray[np.int64]

    def segments(self, found: Sequence[Span]) -> list[Segment]:
        """Return as segments of the recording what was found in points."""
        ends = np.append(self.frames, self.frames[-1] + 1)
        spans = [(int(ends[start]), int(ends[end]), action) for start, end, action in found]
        return [Segment(start, end, action) for start, end, action in spans if start < end]


@dataclass(frozen=True)
class Stream:
    """Demonstrations one after the other, each at its own place: of use where only velocities matter.

    velocities: (n_points, 1 + n_objects, 3) [m/s]; truth: where each of them lies.
    """

    velocities: Floats
    truth: tuple[Segment, ...]


def points(trajectory: Trajectory, roles: Sequence[str]) -> Points:
    """Return hand and objects of these roles at RATE; what is missing lies on a straight line between."""
    even = resample(trajectory, RATE)
    bridged = {name: _bridged(even.times, even.objects[name]) for name in roles}
    even = smooth(Trajectory(even.times, _bridged(even.times, even.hand), bridged))
    positions = stack(even, tuple(roles))
    middles = (trajectory.times[1:] + trajectory.times[:-1]) / 2.0
    velocities = np.asarray(np.gradient(positions, 1.0 / RATE, axis=0))
    return Points(positions, velocities, np.searchsorted(middles, even.times))


def streams(demonstrations: Sequence[Demonstration], roles: Sequence[str], seed: int = 0) -> list[Stream]:
    """Return what to set thresholds by: demonstrations joined to streams in random order."""
    order = np.random.default_rng(seed).permutation(len(demonstrations)).tolist()
    joined = []
    for first in range(0, min(len(order), N_STREAMS * N_JOINED), N_JOINED):
        group = order[first : first + N_JOINED]
        velocities = [points(demonstrations[index].trajectory, roles).velocities for index in group]
        borders = np.cumsum([0, *map(len, velocities)]).tolist()
        spans = zip(borders[:-1], borders[1:], group, strict=True)
        truth = tuple(Segment(start, end, demonstrations[index].action) for start, end, index in spans)
        joined.append(Stream(np.concatenate(velocities), truth))
    return joined


def _bridged(times: Floats, track: Floats) -> Floats:
    there = ~np.isnan(track[:, 0])
    return np.stack([np.interp(times, times[there], axis[there]) for axis in track.T], axis=1)
