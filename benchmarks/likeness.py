"""How like a generated movement is to the one that was made: in place, path, smoothness and spread.

Both are told by their positions at N_PHASES instants at regular intervals, the first their start, the last
their goal.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.signal import savgol_filter

from app.motion.trajectory import Floats, Trajectory

N_PHASES = 101

BANDS = {68: 1.0, 95: 1.96}
"""Per cent of a normal distribution within so many standard deviations."""

SMOOTHED, DEGREE = 21, 5
"""Samples over which, and degree of the polynomials by which, derivatives are taken (Savitzky and Golay)."""


def at_phases(motion: Trajectory, n_phases: int = N_PHASES) -> Floats:
    """Return (n_phases, 3) positions of the hand at regular intervals [m], dropouts bridged by lines."""
    there = ~np.isnan(motion.hand).any(axis=1)
    times = np.linspace(motion.times[0], motion.times[-1], n_phases)
    return np.column_stack([np.interp(times, motion.times[there], of[there]) for of in motion.hand.T])


def apart(made: Floats, generated: Floats) -> float:
    """Return the root mean square distance [m] of two movements, (n, 3) each, at the same instants."""
    return float(np.sqrt(np.mean(np.sum((made - generated) ** 2, axis=1))))


@njit(cache=True, nogil=True)
def warped(one: Floats, other: Floats) -> float:
    """Return the mean distance [m] of the points that dynamic time warping pairs; shapes (n, 3), (m, 3).

    Of all ways to pair the points in order, both ends with each other, it takes that of the least sum of
    distances, of several such that with the fewest pairs.
    """
    sums = np.full((len(one) + 1, len(other) + 1), np.inf)
    pairs = np.zeros(sums.shape, dtype=np.int64)
    sums[0, 0] = 0.0
    for i in range(1, len(one) + 1):
        for j in range(1, len(other) + 1):
            x, y = i - 1, j - 1
            for from_x, from_y in ((i - 1, j), (i, j - 1)):
                if sums[from_x, from_y] < sums[x, y] or (
                    sums[from_x, from_y] == sums[x, y] and pairs[from_x, from_y] < pairs[x, y]
                ):
                    x, y = from_x, from_y
            sums[i, j] = sums[x, y] + np.sqrt(np.sum((one[i - 1] - other[j - 1]) ** 2))
            pairs[i, j] = pairs[x, y] + 1
    return float(sums[-1, -1] / pairs[-1, -1])


def smoothness(positions: Floats) -> float:
    """Return the log dimensionless jerk of a movement, (n, 3), after Balasubramanian et al. (2015).

    The higher, the smoother, whatever its size and duration; a minimum-jerk movement has -ln(204.8) = -5.32.
    """
    step = 1.0 / (len(positions) - 1)
    velocity, jerk = (
        savgol_filter(positions, SMOOTHED, DEGREE, deriv=order, delta=step, axis=0) for order in (1, 3)
    )
    squared = np.trapezoid(np.sum(jerk**2, axis=1), dx=step)
    return float(-np.log(squared / np.max(np.sum(velocity**2, axis=1))))


def within(made: Floats, generated: Floats, std: Floats, width: float) -> Floats:
    """Return (3,) shares of the instants between the ends at which a band holds what was made, by axis.

    std: (n, 3) [m]; width: half of the band, in standard deviations.
    """
    held = np.abs(made - generated) <= width * std
    shares: Floats = held[1:-1].mean(axis=0)
    return shares


def off_the_ends(made: Floats, generated: Floats) -> float:
    """Return by how much the start or the goal is missed, whichever is worse [m]."""
    return float(np.linalg.norm((made - generated)[[0, -1]], axis=1).max())


class Likeness(NamedTuple):
    """What is measured of one movement, or the mean over several.

    apart, warped: distances [m]; smoothness: log dimensionless jerk; ends: missed by [m]; inside: (2, 3)
    shares in the bands by axis, NaN where a method tells no spread.
    """

    apart: float
    warped: float
    smoothness: float
    ends: float
    inside: Floats


def compare(made: Floats, generated: Floats, std: Floats | None = None) -> Likeness:
    """Return how like a generated movement is to the one that was made, (N_PHASES, 3) each [m]."""
    return Likeness(
        apart(made, generated),
        warped(made, generated),
        smoothness(generated),
        off_the_ends(made, generated),
        np.full((len(BANDS), 3), np.nan)
        if std is None
        else np.array([within(made, generated, std, width) for width in BANDS.values()]),
    )


def mean(of: Sequence[Likeness]) -> Likeness:
    """Return the means, measure by measure."""
    return Likeness(
        apart=fmean(each.apart for each in of),
        warped=fmean(each.warped for each in of),
        smoothness=fmean(each.smoothness for each in of),
        ends=fmean(each.ends for each in of),
        inside=np.mean([each.inside for each in of], axis=0),
    )
