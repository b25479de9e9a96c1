"""The shape of a movement: how it deviates from a minimum-jerk movement along the straight line.

A movement's *phase* runs from 0 to 1 in time. Its shape is a quintic spline over the phase for each aligned
axis. The first and the last coefficient are zero and left out: a shape meets the end points. Where two more
on each side are zero, too, it is *at rest* in both, with neither velocity nor acceleration. People are not
always, where a demonstration was cut; so shapes are remembered as they are and brought to rest when they
are generated.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Polynomial

from app.motion.features import alignment
from app.motion.model import N_COEFFICIENTS
from app.motion.trajectory import Floats

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

AT_REST = slice(2, -2)
"""Those that may be other than zero where a shape is at rest at both ends."""

MINIMUM_JERK = Polynomial([0, 0, 0, 10, -15, 6])
"""The share of the way covered at a phase by a minimum-jerk movement (Flash and Hogan, 1985)."""

ROUGHNESS = 1e-9
"""Weight of the mean square of a shape's third derivative by phase against that of what it misses."""

DEGREE = 5

_PROGRESS = tuple(MINIMUM_JERK.deriv(order) for order in range(3))


def basis(phase: Floats, order: int = 0) -> Floats:
    """Return (n, N_COEFFICIENTS): the derivative of an order, by phase (n,), of each basis function."""
    values: Floats = _splines(order)(phase)
    return values


def progress(phase: Floats, order: int = 0) -> Floats:
    """Return (n,): the share of the way of a minimum-jerk movement at a phase, or a derivative of it."""
    values: Floats = _PROGRESS[order](phase)
    return values


def fit_shape(times: Floats, hand: Floats) -> Floats:
    """Return the (N_SHAPE,) coefficients [m] of a movement; dropouts tell nothing.

    times: (n_frames,) [s]; hand: (n_frames, 3) [m], its first and last frame are there and apart.
    """
    seen = ~np.isnan(hand).any(axis=1)
    phase = ((times - times[0]) / (times[-1] - times[0]))[seen]
    way = hand[-1] - hand[0]
    deviation = (hand[seen] - hand[0] - np.outer(progress(phase), way)) @ alignment(hand[0], hand[-1]).T
    values = basis(phase)
    share = np.gradient(phase)[:, None]
    coefficients = np.linalg.solve(values.T @ (share * values) + _smoothly(), values.T @ (share * deviation))
    flat: Floats = coefficients.T.ravel()
    return flat


def bring_to_rest(coefficients: Floats) -> Floats:
    """Return the coefficients (…, N_COEFFICIENTS) of the nearest shapes that are at rest at both ends."""
    return coefficients @ _to_rest().T


@cache
def _splines(order: int) -> BSpline:
    """Return the basis functions, or a derivative of them.

    Of SciPy this part is loaded by the first shape: a server that only recognises has no use for it.
    """
    from scipy.interpolate import BSpline  # noqa: PLC0415 (see above)

    knots = np.pad(np.linspace(0.0, 1.0, N_COEFFICIENTS - 2), DEGREE, mode="edge")
    return BSpline(knots, np.eye(N_COEFFICIENTS + 2)[:, 1:-1], DEGREE).derivative(order)


def _alike(order: int) -> Floats:
    """Return the mean over all phases of the products of the basis functions' derivatives."""
    fine = basis(np.linspace(0.0, 1.0, 20 * N_COEFFICIENTS), order)
    return fine.T @ fine / len(fine)


@cache
def _smoothly() -> Floats:
    return ROUGHNESS * _alike(3)


@cache
def _to_rest() -> Floats:
    """Return the (N_COEFFICIENTS, N_COEFFICIENTS) map of coefficients to those at rest, by least squares."""
    alike = _alike(0) + _smoothly()
    resting = alike[AT_REST, AT_REST]
    to_rest = np.zeros_like(alike)
    to_rest[AT_REST] = np.linalg.solve(resting, alike[AT_REST])
    return to_rest
