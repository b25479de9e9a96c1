"""The course of a movement from rest to rest: a minimum-jerk movement along the line, and its shape.

Rest at both ends is in the coefficients of the shape. To pass near a given point at a given phase is one more
observation of the shape, which has a mean and a covariance: conditioned on it, all of the movement bends
as the demonstrations vary (Calinon et al., the paper's reference [11]).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Self

import numpy as np

from app.motion.shape import basis, bring_to_rest, progress
from app.motion.trajectory import Floats

MEASURED = 5e-4
"""Standard deviation of what motion capture measures [m]; nothing is known better than that."""


CLOSELY = np.linspace(0.0, 1.0, 513)
"""Phases so close to each other that speeds between them are higher by a thousandth at most."""

EXACT = 1e-12
"""Variance of what is met exactly [m^2]."""


@dataclass(frozen=True, eq=False)
class Course:
    """How far a movement of a length [m] has come at a phase, along the aligned axes.

    mean: (3, N_COEFFICIENTS) of its shape, at rest at both ends [m]; resting, shown: the covariances,
    (3, N_COEFFICIENTS, N_COEFFICIENTS), of shapes brought to rest and of shapes as demonstrated [m^2].
    """

    length: float
    mean: Floats
    resting: Floats
    shown: Floats

    @classmethod
    def of(cls, length: float, mean: Floats, covariances: Floats) -> Self:
        """Return the course of a movement whose shape, as demonstrated, has this mean and covariances."""
        once = bring_to_rest(covariances).swapaxes(1, 2)
        return cls(length, bring_to_rest(mean), bring_to_rest(once), covariances)

    def derivative(self, phase: Floats, order: int) -> Floats:
        """Return (n, 3): the derivative of an order, 0 to 2, by phase (n,) [m]."""
        moved = basis(phase, order) @ self.mean.T
        moved[:, 0] += self.length * progress(phase, order)
        return moved

    def highest(self, order: int) -> float:
        """Return the highest norm of the derivative of an order, 1 or 2, by phase [m]."""
        each, along = _closely(order)
        moved = each @ self.mean.T
        moved[:, 0] += self.length * along
        return float(np.linalg.norm(moved, axis=1).max())

    def std(self, phase: Floats) -> Floats:
        """Return (n, 3) standard deviations of the demonstrated [m], zero at both ends."""
        at = basis(phase)
        variances = np.sum((at @ self.shown) * at, axis=2).T
        between = (phase > 0.0) & (phase < 1.0)
        std: Floats = np.sqrt(np.maximum(variances, 0.0) + np.where(between, MEASURED**2, 0.0)[:, None])
        return std

    def passing(self, fractions: Floats, points: Floats, stds: Floats) -> Course:
        """Return the course that passes near points (m, 3), in aligned axes from the start [m].

        fractions: (m,) phases at which it does; stds: (m,) how near [m].
        """
        at, noise = basis(fractions), np.diag(stds**2 + EXACT)
        missed = (points - self.derivative(fractions, 0)).T[:, :, None]
        gain, resting = _observed(self.resting, at, noise)
        _, shown = _observed(self.shown, at, noise)
        return replace(self, mean=self.mean + (gain @ missed)[:, :, 0], resting=resting, shown=shown)


@cache
def _closely(order: int) -> tuple[Floats, Floats]:
    """Return the derivatives of the basis and of the minimum-jerk profile at phases close to each other."""
    return basis(CLOSELY, order), progress(CLOSELY, order)


def _observed(covariances: Floats, at: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Return the gains (3, N_COEFFICIENTS, m) of observations and the covariances that they leave."""
    seen = at @ covariances
    gain = np.asarray(np.linalg.solve(seen @ at.T + noise, seen), dtype=np.float64).swapaxes(1, 2)
    return gain, covariances - gain @ seen
