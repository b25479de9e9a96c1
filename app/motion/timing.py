"""How long a movement takes: as the demonstrations did, and as long as the limits of a robot ask for."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from app.motion.asked import Limits
from app.motion.errors import InvalidRequest
from app.motion.model import PACE_SPREAD, ActionModel

RATES = (1.0, 1000.0)
DURATIONS = (0.05, 600.0)
MAX_FRAMES = 100_000
"""What may be asked for [Hz], [s], frames."""

SLOPE_SPREAD = 0.5
"""How the logarithm of durations grows with that of lengths, before there is evidence: hardly known."""

_MARGIN = 1.001
"""Between the phases at which speeds are looked at they may be higher, by less than this factor."""


class Path(Protocol):
    """What has a highest speed and acceleration by phase."""

    def highest(self, order: int) -> float:
        """Return the highest norm of the derivative of an order, 1 or 2, by phase [m]."""


def expected_duration(action: ActionModel, length: float) -> float:
    """Return the duration of a movement of a length [m], as a power of it learned from demonstrations [s].

    The power is between 0, always the same time, and 1, always the same speed.
    """
    lengths, durations = np.log(action.lengths), np.log(action.durations)
    away = lengths - lengths.mean()
    slope = (away @ durations) / (away @ away + (PACE_SPREAD / SLOPE_SPREAD) ** 2)
    expected = durations.mean() + np.clip(slope, 0.0, 1.0) * (np.log(length) - lengths.mean())
    return float(np.clip(np.exp(expected), *DURATIONS))


def least_duration(path: Path, limits: Limits) -> float:
    """Return the shortest duration in which a path keeps the limits, stretched evenly [s]."""
    least = 0.0
    for order, limit in ((1, limits.velocity), (2, limits.acceleration)):
        if limit is not None:
            least = max(least, (_MARGIN * path.highest(order) / limit) ** (1.0 / order))
    if least > DURATIONS[1]:
        detail = f"are so low that the movement would take {least:.4g} s, over {DURATIONS[1]:g} s"
        raise InvalidRequest("limits", detail)
    return least


def check_duration(duration: float) -> float:
    """Return a duration that may be asked for [s]; raises InvalidRequest."""
    return _within("duration", duration, DURATIONS, "s")


def count_periods(rate: float, duration: float) -> int:
    """Return how many periods of a rate [Hz] a duration [s] takes, rounded up; raises InvalidRequest."""
    n_periods = math.ceil(_within("rate", rate, RATES, "Hz") * duration - 1e-6)
    if n_periods >= MAX_FRAMES:
        raise InvalidRequest("rate", f"{duration:g} s at {rate:g} Hz are over {MAX_FRAMES} frames")
    return max(n_periods, 1)


def _within(name: str, value: float, bounds: tuple[float, float], unit: str) -> float:
    least, most = bounds
    if not least <= value <= most:
        raise InvalidRequest(name, f"must lie between {least:g} and {most:g} {unit}, is {value:g}")
    return value
