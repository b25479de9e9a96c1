"""The shape of a movement: how it deviates from a minimum-jerk movement along the straight line.

A movement's *phase* runs from 0 to 1 in time. Its shape is a quintic spline over the phase for each aligned
axis. The first and the last coefficient are zero and left out: a shape meets the end points. Where two more
on each side are zero, too, it is *at rest* in both, with neither velocity nor acceleration. People are not
always, where a demonstration was cut; so shapes are remembered as they are and brought to rest when they
are generated.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial
from scipy.interpolate import BSpline

from app.motion.features import alignment
from app.motion.model import N_COEFFICIENTS
from app.motion.trajectory import Floats

AT_REST = slice(2, -2)
"""Those that may be other than zero where a shape is at rest at both ends."""

MINIMUM_JERK = Polynomial([0, 0, 0, 10, -15, 6])
"""The share of the way covered at a phase by a minimum-jerk movement (Flash and Hogan, 1985)."""

ROUGHNESS = 1e-9
"""Weight of the mean square of a shape's third derivative by phase against that of what it misses."""

_DEGREE = 5
_KNOTS = np.pad(np.linspace(0.0, 1.0, N_COEFFICIENTS - 2), _DEGREE, mode="edge")
_EACH = BSpline(_KNOTS, np.eye(N_COEFFICIENTS + 2)[:, 1:-1], _DEGREE)
_PROGRESS = tuple(MINIMUM_JERK.deriv(order) for order in range(3))
_DERIVATIVES = tuple(_EACH.derivative(order) for order in range(4))


def basis(phase: Floats, order: int = 0) -> Floats:
    """Return (n, N_COEFFICIENTS): the derivative of an order, by phase (n,), of each basis function."""
    values: Floats = _DERIVATIVES[order](phase)
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
    coefficients = np.linalg.solve(values.T @ (share * values) + _SMOOTHLY, values.T @ (share * deviation))
    flat: Floats = coefficients.T.ravel()
    return flat


def bring_to_rest(coefficients: Floats) -> Floats:
    """Return the coefficients (…, N_COEFFICIENTS) of the nearest shapes that are at rest at both ends."""
    return coefficients @ _TO_REST.T


_FINE = np.linspace(0.0, 1.0, 20 * N_COEFFICIENTS)
_SMOOTHLY = ROUGHNESS * basis(_FINE, 3).T @ basis(_FINE, 3) / len(_FINE)


def _to_rest() -> Floats:
    """Return the (N_COEFFICIENTS, N_COEFFICIENTS) map of coefficients to those at rest, by least squares."""
    alike = basis(_FINE).T @ basis(_FINE) / len(_FINE)
    resting = (alike + _SMOOTHLY)[AT_REST, AT_REST]
    to_rest = np.zeros_like(alike)
    to_rest[AT_REST] = np.linalg.solve(resting, alike[AT_REST])
    return to_rest


_TO_REST = _to_rest()
