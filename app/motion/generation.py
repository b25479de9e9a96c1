"""Generation of movements between end points that nobody demonstrated (Sec. III-D of the paper).

A movement's *phase* runs from 0 to 1 in time. Its keypoints are the means of the states, each at the phase
in the middle of the state's expected stay. Gaussian process regression through them gives the deviation
from the straight line at every phase, and the inverse of the alignment lays it between start and goal.

Two things make the movement start and end at rest, exactly at the asked points. The regression is of
``deviation / WINDOW``, where the window and its slope are zero at both ends. And the share of the deviation
along the line that is the profile of a minimum-jerk movement grows with the length of the movement, while
all else keeps its size, as it does in people.

The paper's plain method is there for comparison: the regression is of the deviation itself, through the
keypoints and the two end points, and what its derivatives are there is left to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from app.motion.errors import InvalidRequest
from app.motion.features import BLEND, N_DEVIATIONS, alignment, decode
from app.motion.model import ActionModel, Model
from app.motion.trajectory import FARTHEST_M, Floats

if TYPE_CHECKING:
    from sklearn.gaussian_process import GaussianProcessRegressor

Method = Literal["default", "paper"]

RATES = (1.0, 1000.0)
DURATIONS = (0.05, 600.0)
MAX_FRAMES = 100_000
"""What may be asked for [Hz], [s], frames."""

LENGTH_SCALE = 0.3
"""Over which the regression is smooth, as a share of the movement's duration."""

WINDOW = Polynomial([0, 0, 16, -32, 16])
"""Of the phase: 1 in the middle of the movement, zero with zero slope at both ends."""

MINIMUM_JERK = Polynomial([0, 0, 0, 10, -15, 6])
"""The share of the way covered at a phase by a minimum-jerk movement."""

STEADY = Polynomial([0, 1])
"""The same for the straight line sampled at regular intervals."""

EXACT = 1e-12
"""Variance of what is known exactly [m^2]."""


@dataclass(frozen=True, eq=False)
class GeneratedMotion:
    """A movement at a constant rate: its first frame is the start, its last the goal, at rest in both.

    times (n,) from 0 [s]; positions [m], velocities [m/s], accelerations [m/s^2] (n, 3); std (n, 3):
    standard deviation of the demonstrated movements along the world's axes [m], zero at both ends.
    """

    times: Floats
    positions: Floats
    velocities: Floats
    accelerations: Floats
    std: Floats


def generate(
    model: Model,
    action: str,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    rate: float = 100.0,
    duration: float | None = None,
    method: Method = "default",
) -> GeneratedMotion:
    """Return a movement of a class from start to goal, (3,) each [m], at a rate [Hz].

    duration [s], by default the mean of the demonstrations, is rounded up to whole periods; method:
    ``paper`` for the plain one, which does not rest at its ends. Raises UnknownAction, and InvalidRequest,
    which names the argument.
    """
    chain = model.action(action)
    here, there = _point("start", start), _point("goal", goal)
    length = float(np.linalg.norm(there - here))
    if length < BLEND:
        raise InvalidRequest("goal", f"lies {length:.3g} m from the start, needs to lie {BLEND:g} m away")
    n_periods = _periods(rate, float(np.mean(chain.durations)) if duration is None else duration)
    phase = np.linspace(0.0, 1.0, n_periods + 1)
    moves, std = _regress(chain, phase) if method == "default" else _regress_plainly(chain, phase)
    profile = MINIMUM_JERK if method == "default" else STEADY
    moves[:, :, 0] += length * np.stack([profile.deriv(order)(phase) for order in range(3)])
    deviation = moves[0] - np.outer(length * phase, [1.0, 0.0, 0.0])
    rotation = alignment(here, there)
    seconds = n_periods / rate
    return GeneratedMotion(
        times=np.arange(n_periods + 1) / rate,
        positions=decode(deviation, here, there),
        velocities=moves[1] @ rotation / seconds,
        accelerations=moves[2] @ rotation / seconds**2,
        std=np.sqrt(std**2 @ rotation**2),
    )


def _regress(chain: ActionModel, phase: Floats) -> tuple[Floats, Floats]:
    """Return the deviation without its minimum-jerk share and its standard deviation, aligned [m].

    phase: (n,). Shapes (3, n, 3), the derivatives by phase of order 0, 1 and 2, and (n, 3).
    """
    at = keypoint_phases(chain)
    means, variances = chain.means[:, :N_DEVIATIONS].copy(), chain.variances[:, :N_DEVIATIONS]
    profile = MINIMUM_JERK(at) - at
    means[:, 0] -= profile * np.linalg.lstsq(profile[:, None], means[:, 0])[0]
    window = WINDOW(at)
    fits = [
        _fit(at, mean / window, variance / window**2, np.sum(mean**2) / np.sum(window**2))
        for mean, variance in zip(means.T, variances.T, strict=True)
    ]
    moves = np.stack([_windowed(_derivatives(fit, phase), phase) for fit in fits], axis=2)
    return moves, np.sqrt(
        _between(at, variances, phase) + (WINDOW(phase)[:, None] * _doubt(fits, phase)) ** 2
    )


def _regress_plainly(chain: ActionModel, phase: Floats) -> tuple[Floats, Floats]:
    """Return the same by the paper's plain method: the deviation from the line is zero at both ends."""
    at = np.concatenate([[0.0], keypoint_phases(chain), [1.0]])
    ends = ((1, 1), (0, 0))
    means = np.pad(chain.means[:, :N_DEVIATIONS], ends)
    variances = np.pad(chain.variances[:, :N_DEVIATIONS], ends, constant_values=EXACT)
    fits = [
        _fit(at, mean, variance, np.mean(mean**2))
        for mean, variance in zip(means.T, variances.T, strict=True)
    ]
    moves = np.stack([_derivatives(fit, phase) for fit in fits], axis=2)
    std = np.sqrt(_between(at[1:-1], variances[1:-1], phase) + _doubt(fits, phase) ** 2)
    moves[0, [0, -1]] = std[[0, -1]] = 0.0
    return moves, std


def keypoint_phases(chain: ActionModel) -> Floats:
    """Return (n_states,) phases: the middle of the stay that each state's self-transition implies."""
    stays = 1.0 / (1.0 - chain.stay)
    phases: Floats = (np.cumsum(stays) - stays / 2) / np.sum(stays)
    return phases


def _fit(at: Floats, values: Floats, variances: Floats, size: float) -> GaussianProcessRegressor:
    """Return the regression of (n,) values known with these variances; size: their mean square.

    scikit-learn is loaded by the first movement that is generated: a server that only recognises has no use
    for it.
    """
    from sklearn.gaussian_process import GaussianProcessRegressor  # noqa: PLC0415 (see above)
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel  # noqa: PLC0415

    kernel = ConstantKernel(size + EXACT, "fixed") * RBF(LENGTH_SCALE, "fixed")
    regression = GaussianProcessRegressor(kernel, alpha=variances, optimizer=None)
    return regression.fit(at[:, None], values)


def _derivatives(regression: GaussianProcessRegressor, phase: Floats) -> Floats:
    """Return (3, n) what was regressed and its first and second derivative by phase."""
    kernel = regression.kernel_(phase[:, None], regression.X_train_)
    away = (phase[:, None] - regression.X_train_.T) / LENGTH_SCALE**2
    g0 = kernel @ regression.alpha_
    g1 = -(away * kernel) @ regression.alpha_
    g2 = ((away**2 - LENGTH_SCALE**-2) * kernel) @ regression.alpha_
    return np.stack([g0, g1, g2])


def _doubt(fits: Sequence[GaussianProcessRegressor], phase: Floats) -> Floats:
    """Return (n, n_components) standard deviations of what was regressed."""
    return np.column_stack([fit.predict(phase[:, None], return_std=True)[1] for fit in fits])


def _windowed(regressed: Floats, phase: Floats) -> Floats:
    """Return (3, n) the product of WINDOW and what was regressed, and its derivatives by phase."""
    w0, w1, w2 = (WINDOW.deriv(order)(phase) for order in range(3))
    g0, g1, g2 = regressed
    return np.stack([w0 * g0, w1 * g0 + w0 * g1, w2 * g0 + 2 * w1 * g1 + w0 * g2])


def _between(at: Floats, variances: Floats, phase: Floats) -> Floats:
    """Return (n, 3) variances of the states, their square roots interpolated and zero at both ends."""
    known = np.concatenate([[0.0], at, [1.0]])
    std = np.pad(np.sqrt(variances), ((1, 1), (0, 0)))
    return np.column_stack([np.interp(phase, known, of_component) for of_component in std.T]) ** 2


def _periods(rate: float, duration: float) -> int:
    """Return how many periods of the rate the duration takes, rounded up."""
    for name, value, (least, most), unit in (
        ("rate", rate, RATES, "Hz"),
        ("duration", duration, DURATIONS, "s"),
    ):
        if not least <= value <= most:
            raise InvalidRequest(name, f"must lie between {least:g} and {most:g} {unit}, is {value:g}")
    n_periods = math.ceil(rate * duration - 1e-6)
    if n_periods >= MAX_FRAMES:
        raise InvalidRequest("rate", f"{duration:g} s at {rate:g} Hz are over {MAX_FRAMES} frames")
    return max(n_periods, 1)


def _point(name: str, value: ArrayLike) -> Floats:
    try:
        point = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidRequest(name, "must be three numbers") from error
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InvalidRequest(name, "must be three finite numbers")
    if np.abs(point).max() > FARTHEST_M:
        raise InvalidRequest(name, f"lies over {FARTHEST_M:g} m away: a wrong length unit?")
    return point
