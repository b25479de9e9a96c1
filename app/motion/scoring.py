"""Log-likelihoods of segments: features and Viterbi in one compiled pass (Eq. (1) of the paper).

The end point of a segment moves every one of its features, so each segment is a pass of its own.
A path starts in the first state and ends by leaving the last. A missing value (NaN) is summed out: it
adds nothing to any state.

All log-likelihoods are *ratios* to the background. They have no unit: the same data in millimetres give the
same numbers. What neither explains better adds nothing, so the ratios of segments may be added up and
compared however much of the motion they cover.

What a state says of a frame is the predictive density of its Gaussian. Its mean and variance are known from
n demonstrations only, whose frames are too much alike to count each, so that is Student's t with n - 1
degrees of freedom: few demonstrations leave heavy tails, many a Gaussian.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import gammaln

from app.motion.features import alignment
from app.motion.model import ActionModel, Model
from app.motion.trajectory import Floats

Indices = NDArray[np.int64]

_LOW, _HIGH = 1e-90, 1e90  # where the densities of paths are brought back to 1


class States(NamedTuple):
    """The states of all classes, one after the other, in units of the background.

    All densities and probabilities are raised to the power ``1 / power`` of their class, in which Student's t
    is one over a quadratic: of feature d in state s it is ``1 / (base + slope * (x - mean)^2)``.
    first: (n_classes + 1,) where each class begins; power: (n_classes,); mean, base, slope: (n_features,
    n_states); stay: (n_states,); enter: (n_states,) from the state before, 0 for the first of a class;
    leave: (n_states,).
    """

    first: Indices
    power: Floats
    mean: Floats
    base: Floats
    slope: Floats
    stay: Floats
    enter: Floats
    leave: Floats


def predictive(action: ActionModel) -> tuple[float, Floats]:
    """Return the degrees of freedom and the (n_states, n_features) scales [m] of the states' densities.

    The scale is the standard deviation without bias, widened by what is not known of the mean.
    """
    n = max(action.n_demonstrations, 2)
    return n - 1.0, np.sqrt(action.variances * (n + 1.0) / (n - 1.0))


def states_of(model: Model) -> States:
    """Return the states of a model, ready for ``score_segments``."""
    power, base, slope, stay, enter, leave = [], [], [], [], [], []
    for action in model.actions:
        freedom, scale = predictive(action)
        power.append((freedom + 1.0) / 2.0)
        log_peak = gammaln(power[-1]) - gammaln(freedom / 2.0) - 0.5 * np.log(np.pi * freedom)
        base.append(np.exp((np.log(scale / model.background.width) - log_peak) / power[-1]))
        slope.append(base[-1] / (freedom * scale**2))
        stay.append(action.stay ** (1.0 / power[-1]))
        leave.append((1.0 - action.stay) ** (1.0 / power[-1]))
        enter.append(np.append(0.0, leave[-1][:-1]))
    return States(
        first=np.cumsum([0, *(action.n_states for action in model.actions)]),
        power=np.array(power),
        mean=np.ascontiguousarray(np.vstack([action.means for action in model.actions]).T),
        base=np.ascontiguousarray(np.vstack(base).T),
        slope=np.ascontiguousarray(np.vstack(slope).T),
        stay=np.concatenate(stay),
        enter=np.concatenate(enter),
        leave=np.concatenate(leave),
    )


@njit(cache=True, nogil=True)
def score_segments(
    hand: Floats, objects: Floats, table_height: float, segments: Indices, states: States
) -> Floats:
    """Return (n_segments, n_classes) log-likelihood ratios of segments to the background [nat].

    hand: (n_frames, 3) [m]; objects: (n_objects, n_frames, 3) [m]; table_height [m]; segments:
    (n_segments, 2) first and goal frame, neither a dropout of the hand. A segment of fewer frames than a
    class has states has -inf.
    """
    first, power, mean, base, slope, stay, enter, leave = states
    n_features, n_states = mean.shape
    result = np.empty((len(segments), len(power)))
    x, misfit, logs = np.empty(n_features), np.empty(n_states), np.empty(len(power))
    path, moved = np.empty(n_states + 1), np.empty(n_states + 1)
    for index in range(len(segments)):
        start, goal = segments[index]
        rotation = alignment(hand[start], hand[goal])
        path[:], moved[:], logs[:] = 0.0, 0.0, 0.0
        for frame in range(start, goal + 1):
            _observe(hand, objects, table_height, start, goal, frame, rotation, x)
            _misfit(x, mean, base, slope, misfit)
            if frame == start:
                for begin in first[:-1]:
                    path[begin + 1] = 1.0 / misfit[begin]
            else:
                _advance(path, stay, enter, misfit, moved)
                path[:] = moved
            _scale_back(path, first, logs)
        for k in range(len(power)):
            last = first[k + 1] - 1
            result[index, k] = power[k] * (logs[k] + np.log(path[last + 1] * leave[last]))
    return result


@njit(cache=True, nogil=True, inline="always")
def _misfit(x: Floats, mean: Floats, base: Floats, slope: Floats, misfit: Floats) -> None:
    """Write one over each state's density of what is not missing in x."""
    misfit[:] = 1.0
    for d in range(len(x)):
        value = x[d]
        if not np.isnan(value):
            for s in range(len(misfit)):
                off = value - mean[d, s]
                misfit[s] *= base[d, s] + slope[d, s] * off * off


@njit(cache=True, nogil=True, inline="always")
def _advance(path: Floats, stay: Floats, enter: Floats, misfit: Floats, moved: Floats) -> None:
    """Move the best path to each state on by a frame; that of state s stands at s + 1."""
    for s in range(len(misfit)):
        stayed, entered = path[s + 1] * stay[s], path[s] * enter[s]
        moved[s + 1] = (stayed if stayed > entered else entered) / misfit[s]


@njit(cache=True, nogil=True, inline="always")
def _scale_back(path: Floats, first: Indices, logs: Floats) -> None:
    """Bring each class's densities back to 1 before they leave the range of numbers; log what came off."""
    for k in range(len(logs)):
        best = 0.0
        for s in range(first[k] + 1, first[k + 1] + 1):
            best = max(best, path[s])
        if best > 0.0 and (best < _LOW or best > _HIGH):
            for s in range(first[k] + 1, first[k + 1] + 1):
                path[s] /= best
            logs[k] += np.log(best)


@njit(cache=True, nogil=True, inline="always")
def _observe(
    hand: Floats,
    objects: Floats,
    table_height: float,
    start: int,
    goal: int,
    frame: int,
    rotation: Floats,
    x: Floats,
) -> None:
    """Write the features of one frame of a segment into x; where the hand is not seen nor is the phase."""
    fraction = (frame - start) / max(goal - start, 1)
    dx = hand[frame, 0] - hand[start, 0] * (1.0 - fraction) - hand[goal, 0] * fraction
    dy = hand[frame, 1] - hand[start, 1] * (1.0 - fraction) - hand[goal, 1] * fraction
    dz = hand[frame, 2] - hand[start, 2] * (1.0 - fraction) - hand[goal, 2] * fraction
    for axis in range(3):
        x[axis] = rotation[axis, 0] * dx + rotation[axis, 1] * dy + rotation[axis, 2] * dz
    x[3] = hand[frame, 2] - table_height
    for index in range(len(objects)):
        gx = objects[index, frame, 0] - hand[frame, 0]
        gy = objects[index, frame, 1] - hand[frame, 1]
        gz = objects[index, frame, 2] - hand[frame, 2]
        x[4 + index] = np.sqrt(gx * gx + gy * gy + gz * gz)
    x[4 + len(objects)] = np.nan if np.isnan(dx) else fraction
