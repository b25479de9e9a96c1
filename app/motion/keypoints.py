"""The paper's plain method: Gaussian process regression through keypoints (Sec. III-D).

The keypoints of a class are the means of its states, each at the phase in the middle of the state's expected
stay. The regression is of the deviation from the straight line, which is zero at both end points; what its
derivatives are there is left to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from app.motion.course import CLOSELY, EXACT
from app.motion.features import N_DEVIATIONS
from app.motion.model import ActionModel
from app.motion.trajectory import Floats

if TYPE_CHECKING:
    from sklearn.gaussian_process import GaussianProcessRegressor

LENGTH_SCALE = 0.3
"""Over which the regression is smooth, as a share of the movement's duration."""

KEPT = 64


@dataclass(frozen=True, eq=False)
class PlainCourse:
    """How far a movement of a length [m] has come at a phase, along the aligned axes.

    fits: the regression of each axis; at: (n_states,) phases of the keypoints; variances: (n_states, 3) of
    the states there [m^2].
    """

    length: float
    fits: tuple[GaussianProcessRegressor, ...]
    at: Floats
    variances: Floats

    def of_length(self, length: float) -> PlainCourse:
        """Return the same for a movement of another length [m]."""
        return replace(self, length=length)

    def derivative(self, phase: Floats, order: int) -> Floats:
        """Return (n, 3): the derivative of an order, 0, 1 or 2, by phase (n,) [m]."""
        deviation = np.column_stack([_derivative(fit, phase, order) for fit in self.fits])
        if order == 0:
            deviation[(phase == 0.0) | (phase == 1.0)] = 0.0
        line = (phase, np.ones_like(phase), np.zeros_like(phase))[order]
        deviation[:, 0] += self.length * line
        return deviation

    def highest(self, order: int) -> float:
        """Return the highest norm of the derivative of an order, 1 or 2, by phase [m]."""
        return float(np.linalg.norm(self.derivative(CLOSELY, order), axis=1).max())

    def std(self, phase: Floats) -> Floats:
        """Return (n, 3) standard deviations of the demonstrated [m], zero at both ends."""
        known = np.concatenate([[0.0], self.at, [1.0]])
        of_states = np.pad(np.sqrt(self.variances), ((1, 1), (0, 0)))
        between = np.column_stack([np.interp(phase, known, column) for column in of_states.T])
        doubt = np.column_stack([fit.predict(phase[:, None], return_std=True)[1] for fit in self.fits])
        std: Floats = np.hypot(between, doubt)
        std[(phase == 0.0) | (phase == 1.0)] = 0.0
        return std


@lru_cache(KEPT)
def plain_course_of(action: ActionModel) -> PlainCourse:
    """Return the course of a movement without length, made once.

    scikit-learn is loaded by the first: a server that is not asked for the plain method has no use for it.
    """
    at, ends = keypoint_phases(action), ((1, 1), (0, 0))
    phases = np.concatenate([[0.0], at, [1.0]])
    means = np.pad(action.means[:, :N_DEVIATIONS], ends)
    variances = action.variances[:, :N_DEVIATIONS]
    doubts = np.pad(variances, ends, constant_values=EXACT)
    fits = tuple(_fit(phases, mean, doubt) for mean, doubt in zip(means.T, doubts.T, strict=True))
    return PlainCourse(0.0, fits, at, variances)


def keypoint_phases(action: ActionModel) -> Floats:
    """Return (n_states,) phases: the middle of the stay that each state's self-transition implies."""
    stays = 1.0 / (1.0 - action.stay)
    phases: Floats = (np.cumsum(stays) - stays / 2) / np.sum(stays)
    return phases


def _fit(at: Floats, values: Floats, variances: Floats) -> GaussianProcessRegressor:
    """Return the regression of (n,) values known with these variances."""
    from sklearn.gaussian_process import GaussianProcessRegressor  # noqa: PLC0415 (see plain_course_of)
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel  # noqa: PLC0415

    kernel = ConstantKernel(np.mean(values**2) + EXACT, "fixed") * RBF(LENGTH_SCALE, "fixed")
    regression = GaussianProcessRegressor(kernel, alpha=variances, optimizer=None)
    return regression.fit(at[:, None], values)


def _derivative(regression: GaussianProcessRegressor, phase: Floats, order: int) -> Floats:
    """Return (n,) what was regressed, or its first or second derivative by phase."""
    kernel = regression.kernel_(phase[:, None], regression.X_train_)
    away = (phase[:, None] - regression.X_train_.T) / LENGTH_SCALE**2
    factor = (1.0, -away, away**2 - LENGTH_SCALE**-2)[order]
    values: Floats = (factor * kernel) @ regression.alpha_
    return values
