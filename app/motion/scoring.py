"""Log-likelihoods of segments: features and Viterbi in one compiled pass (Eq. (1) of the paper).

The end point of a segment moves every one of its features, so each segment is a pass of its own.
A path starts in the first state and ends in the last. A missing value (NaN) is summed out: it adds
nothing to any state.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from app.motion.features import alignment
from app.motion.model import Background, Model
from app.motion.trajectory import Floats

Indices = NDArray[np.int64]


class States(NamedTuple):
    """The states of all classes, one after the other, and the background as a last class of one state.

    first: (n_classes + 2,) where each class begins; mean, precision, norm: (n_states, n_features) such that
    the log-density of x is the sum of ``norm - precision * (x - mean)^2``; stay, advance: (n_states,)
    log-probabilities.
    """

    first: Indices
    mean: Floats
    precision: Floats
    norm: Floats
    stay: Floats
    advance: Floats


def states_of(model: Model) -> States:
    """Return the states of a model, ready for ``score_segments``."""
    background: Background = model.background
    counts = [action.n_states for action in model.actions] + [1]
    variances = np.vstack([*(action.variances for action in model.actions), background.variance])
    stay = np.concatenate([*(action.stay for action in model.actions), [1.0]])
    with np.errstate(divide="ignore"):
        log_stay, log_advance = np.log(stay), np.log1p(-stay)
    return States(
        first=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        mean=np.vstack([*(action.means for action in model.actions), background.mean]),
        precision=0.5 / variances,
        norm=-0.5 * np.log(2.0 * np.pi * variances),
        stay=log_stay,
        advance=log_advance,
    )


def score_segments(
    hand: Floats, objects: Floats, table_height: float, segments: Indices, states: States
) -> Floats:
    """Return (n_segments, n_classes) log-likelihood ratios of segments to the background [nat].

    hand: (n_frames, 3) [m]; objects: (n_objects, n_frames, 3) [m]; table_height [m]; segments:
    (n_segments, 2) first and goal frame, neither a dropout. The ratio of two densities over the same
    features has no unit: it is the same in metres and in millimetres.
    """
    log_likelihoods = viterbi_segments(hand, objects, table_height, segments, *states)
    return log_likelihoods[:, :-1] - log_likelihoods[:, -1:]


@njit(cache=True, nogil=True)
def viterbi_segments(
    hand: Floats,
    objects: Floats,
    table_height: float,
    segments: Indices,
    first: Indices,
    mean: Floats,
    precision: Floats,
    norm: Floats,
    stay: Floats,
    advance: Floats,
) -> Floats:
    """Return (n_segments, n_classes + 1) Viterbi log-probabilities, the background's last [nat]."""
    n_states, n_features = mean.shape
    n_classes = len(first) - 1
    total_norm = norm.sum(axis=1)
    result = np.empty((len(segments), n_classes))
    path = np.empty(n_states)
    x = np.empty(n_features)
    for index in range(len(segments)):
        start, goal = segments[index]
        rotation = alignment(hand[start], hand[goal])
        path[:] = -np.inf
        for frame in range(start, goal + 1):
            whole = _features(hand, objects, table_height, start, goal, frame, rotation, x)
            for k in range(n_classes):
                _advance(first[k], first[k + 1], frame == start, stay, advance, path)
            for s in range(n_states):
                if whole:
                    total = total_norm[s]
                    for d in range(n_features):
                        total -= precision[s, d] * (x[d] - mean[s, d]) ** 2
                else:
                    total = 0.0
                    for d in range(n_features):
                        if not np.isnan(x[d]):
                            total += norm[s, d] - precision[s, d] * (x[d] - mean[s, d]) ** 2
                path[s] += total
        for k in range(n_classes):
            result[index, k] = path[first[k + 1] - 1]
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


@njit(cache=True, nogil=True, inline="always")
def _features(
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
    total = 0.0
    for axis in range(3):
        x[axis] = rotation[axis, 0] * dx + rotation[axis, 1] * dy + rotation[axis, 2] * dz
    x[3] = hand[frame, 2] - table_height
    for index in range(len(objects)):
        gx = objects[index, frame, 0] - hand[frame, 0]
        gy = objects[index, frame, 1] - hand[frame, 1]
        gz = objects[index, frame, 2] - hand[frame, 2]
        x[4 + index] = np.sqrt(gx * gx + gy * gy + gz * gz)
        total += x[4 + index]
    return not np.isnan(total + dx)
