"""Log-likelihoods of segments: features and Viterbi in one compiled pass (Eq. (1) of the paper).

The end point of a segment moves every one of its features, so each segment is a pass of its own.
A path starts in the first state and ends by leaving the last. A missing value (NaN) is summed out: it
adds nothing to any state.

The criterion of all searches is the log-likelihood *ratio* of an action model to the background. It has no
unit: the same data in millimetres give the same numbers. What neither explains better adds nothing, so the
ratios of segments may be added up and compared however much of the motion they cover.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from app.motion.features import alignment
from app.motion.model import Model
from app.motion.trajectory import Floats

Indices = NDArray[np.int64]


class States(NamedTuple):
    """The states of all classes, one after the other, and the background.

    first: (n_classes + 1,) where each class begins; mean, precision, norm: (n_states, n_features) such that
    the log-density of x is the sum of ``norm - precision * (x - mean)^2``; stay, advance: (n_states,)
    log-probabilities; location, scale: (n_features,) of the background.
    """

    first: Indices
    mean: Floats
    precision: Floats
    norm: Floats
    stay: Floats
    advance: Floats
    location: Floats
    scale: Floats


def states_of(model: Model) -> States:
    """Return the states of a model, ready for ``score_segments``."""
    variances = np.vstack([action.variances for action in model.actions])
    stay = np.concatenate([action.stay for action in model.actions])
    return States(
        first=np.cumsum([0, *(action.n_states for action in model.actions)]),
        mean=np.vstack([action.means for action in model.actions]),
        precision=0.5 / variances,
        norm=-0.5 * np.log(2.0 * np.pi * variances),
        stay=np.log(stay),
        advance=np.log1p(-stay),
        location=model.background.location,
        scale=model.background.scale,
    )


@njit(cache=True, nogil=True)
def score_segments(
    hand: Floats, objects: Floats, table_height: float, segments: Indices, states: States
) -> Floats:
    """Return (n_segments, n_classes) log-likelihood ratios of segments to the background [nat].

    hand: (n_frames, 3) [m]; objects: (n_objects, n_frames, 3) [m]; table_height [m]; segments:
    (n_segments, 2) first and goal frame, neither a dropout of the hand.
    """
    first, mean, norm = states.first, states.mean, states.norm
    n_classes, (n_states, n_features) = len(first) - 1, mean.shape
    whole_norm = norm.sum(axis=1)
    result = np.empty((len(segments), n_classes))
    path, x = np.empty(n_states), np.empty(n_features)
    for index in range(len(segments)):
        start, goal = segments[index]
        rotation = alignment(hand[start], hand[goal])
        background = 0.0
        path[:] = -np.inf
        for frame in range(start, goal + 1):
            whole = _observe(hand, objects, table_height, start, goal, frame, rotation, x)
            background += _background(x, states.location, states.scale)
            for k in range(n_classes):
                _advance(first[k], first[k + 1], frame == start, states.stay, states.advance, path)
            for s in range(n_states):
                if whole:
                    density = whole_norm[s]
                    for d in range(n_features):
                        density -= states.precision[s, d] * (x[d] - mean[s, d]) ** 2
                else:
                    density = _partial(x, mean[s], states.precision[s], norm[s])
                path[s] += density
        for k in range(n_classes):
            last = first[k + 1] - 1
            result[index, k] = path[last] + states.advance[last] - background
    return result


@njit(cache=True, nogil=True, inline="always")
def _advance(begin: int, end: int, at_start: bool, stay: Floats, advance: Floats, path: Floats) -> None:
    """Move the best paths of one class on by a frame."""
    if at_start:
        path[begin] = 0.0
    else:
        for s in range(end - 1, begin, -1):
            path[s] = max(path[s] + stay[s], path[s - 1] + advance[s - 1])
        path[begin] += stay[begin]


@njit(cache=True, nogil=True)
def _partial(x: Floats, mean: Floats, precision: Floats, norm: Floats) -> float:
    """Return the log-density of what is not missing in x."""
    density = 0.0
    for d in range(len(x)):
        if not np.isnan(x[d]):
            density += norm[d] - precision[d] * (x[d] - mean[d]) ** 2
    return density


@njit(cache=True, nogil=True)
def _background(x: Floats, location: Floats, scale: Floats) -> float:
    """Return the log-density of what is not missing in x under independent Cauchy densities."""
    inverse = 1.0
    for d in range(len(x)):
        if not np.isnan(x[d]):
            z = (x[d] - location[d]) / scale[d]
            inverse *= np.pi * scale[d] * (1.0 + z * z)
    return -float(np.log(inverse))


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
) -> bool:
    """Write the features of one frame of a segment into x; return whether none is missing."""
    fraction = (frame - start) / max(goal - start, 1)
    dx = hand[frame, 0] - hand[start, 0] * (1.0 - fraction) - hand[goal, 0] * fraction
    dy = hand[frame, 1] - hand[start, 1] * (1.0 - fraction) - hand[goal, 1] * fraction
    dz = hand[frame, 2] - hand[start, 2] * (1.0 - fraction) - hand[goal, 2] * fraction
    for axis in range(3):
        x[axis] = rotation[axis, 0] * dx + rotation[axis, 1] * dy + rotation[axis, 2] * dz
    x[3] = hand[frame, 2] - table_height
    total = dx
    for index in range(len(objects)):
        gx = objects[index, frame, 0] - hand[frame, 0]
        gy = objects[index, frame, 1] - hand[frame, 1]
        gz = objects[index, frame, 2] - hand[frame, 2]
        x[4 + index] = np.sqrt(gx * gx + gy * gy + gz * gz)
        total += x[4 + index]
    return not np.isnan(total)
