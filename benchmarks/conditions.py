"""The conditions under which simulated motion is recognised; all are trained on the same clean motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from app.motion.simulation import RATE, Conditions, recording
from app.motion.trajectory import Floats, Recording, Segment, Trajectory

N_ACTIONS = 3
"""Of a sequence (Sec. IV-A of the paper)."""

LONG_ACTIONS, N_LONG = 15, 10
"""Of a long one, and how many of these there are at most."""

SEEDS_APART = 1000
"""Between the first seeds of the sequences that belong to two seeds of training."""

JITTER = 1.0 / 3.0
"""A frame's time is moved by at most this share of the period."""


@dataclass(frozen=True)
class Column:
    """A condition; streamed: what the stream makes of a simulated recording and its seed."""

    name: str
    conditions: Conditions = Conditions()
    n_actions: int = N_ACTIONS
    streamed: Callable[[Recording, int], Recording] = lambda simulated, _: simulated

    def recordings(self, training_seed: int, n: int) -> list[Recording]:
        """Return recordings of other seeds than that of training."""
        first = SEEDS_APART * (training_seed + 1)
        seeds = range(first, first + (n if self.n_actions == N_ACTIONS else min(n, N_LONG)))
        return [self.streamed(recording(seed, self.n_actions, self.conditions), seed) for seed in seeds]


def at_rate(simulated: Recording, rate: float) -> Recording:
    """Return a recording without dropouts as it would have been sampled at another rate [Hz].

    Frames lie on straight lines between those there are, on cubic splines where they are denser.
    """
    return _sampled(simulated, np.arange(0.0, simulated.trajectory.times[-1], 1.0 / rate), cubic=rate > RATE)


def jittered(simulated: Recording, seed: int) -> Recording:
    """Return a recording without dropouts whose frames were taken a little earlier or later."""
    times = simulated.trajectory.times
    moved = np.random.default_rng(seed).uniform(-JITTER, JITTER, len(times)) / RATE
    return _sampled(simulated, np.clip(times + moved, times[0], times[-1]), cubic=True)


def _sampled(simulated: Recording, times: Floats, cubic: bool) -> Recording:
    old = simulated.trajectory

    def track(positions: Floats) -> Floats:
        if cubic:
            return np.asarray(CubicSpline(old.times, positions)(times))
        return np.stack([np.interp(times, old.times, axis) for axis in positions.T], axis=1)

    def frame(index: int) -> int:
        return int(np.abs(times - old.times[min(index, len(old) - 1)]).argmin())

    objects = {name: track(positions) for name, positions in old.objects.items()}
    segments = [Segment(frame(each.start), frame(each.end), each.action) for each in simulated.segments]
    return Recording(Trajectory(times, track(old.hand), objects), tuple(segments), simulated.scene)


COLUMNS = {
    each.name: each
    for each in (
        Column("clean"),
        Column("noise 4 mm", Conditions(noise=0.004)),
        Column("outliers 1 %", Conditions(outlier_share=0.01, outlier_size=0.1)),
        Column("gaps 0.3 s", Conditions(gap_share=0.3, gap_length=0.3)),
        Column("no rest", Conditions(rest=(0.0, 0.0))),
        Column("rest to 1 s", Conditions(rest=(0.0, 1.0))),
        Column("sweeping x3", Conditions(sweep=3.0)),
        Column("15 actions", n_actions=LONG_ACTIONS),
        Column("60 Hz", streamed=lambda simulated, _: at_rate(simulated, 60.0)),
        Column("120 Hz", streamed=lambda simulated, _: at_rate(simulated, 120.0)),
        Column("240 Hz", streamed=lambda simulated, _: at_rate(simulated, 240.0)),
        Column("jittered", streamed=jittered),
    )
}
