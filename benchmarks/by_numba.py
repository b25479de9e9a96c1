"""The criterion of the core, written plainly with numba: what anybody would write second.

One segment, one class and one filling after the other; logarithms of densities, nothing left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.special import gammaln

from app.motion.conditioning import Tracks
from app.motion.features import axes
from app.motion.model import N_OF_MOVEMENT, N_OF_ROLE, PACE, PHASE, Model
from app.motion.scoring import predictive
from app.motion.trajectory import Floats, Indices
from benchmarks.plainly import Plainly


class Chain(NamedTuple):
    """A class.

    mean, scale, peak: (n_states, n_features) of its densities; freedom: of Student's t; stay, leave:
    (n_states,) logarithms.
    """

    mean: Floats
    scale: Floats
    peak: Floats
    freedom: float
    stay: Floats
    leave: Floats


class NumbaCriterion(Plainly):
    """The criterion with one pass per segment, class and filling."""

    def __init__(self, model: Model, table_height: float, fillings: Indices) -> None:
        super().__init__(model, table_height, fillings)
        self._chains = []
        for action in model.actions:
            freedom, scale = predictive(action)
            peak = gammaln((freedom + 1.0) / 2.0) - gammaln(freedom / 2.0) - 0.5 * np.log(np.pi * freedom)
            peaks = peak - np.log(scale) + np.log(model.background.width)
            stay, leave = np.log(action.stay), np.log1p(-action.stay)
            self._chains.append(Chain(action.means, scale, peaks, freedom, stay, leave))

    def _ratios(self, part: Tracks, filling: list[int]) -> list[float]:
        """Return the (n_classes,) log-likelihood ratios to the background of a whole movement [nat]."""
        features = _features(part, self._table_height, np.array(filling, dtype=np.int64))
        return [_ratio(features, chain) for chain in self._chains]


@njit(cache=True)
def _features(part: Tracks, table_height: float, filling: Indices) -> Floats:
    """Return the (n_frames, n_features) features of a whole movement."""
    n, start, goal = len(part.hand), part.hand[0], part.hand[-1]
    features = np.empty((n, N_OF_MOVEMENT + N_OF_ROLE * len(filling)))
    rotation = np.array(axes(goal[0] - start[0], goal[1] - start[1], goal[2] - start[2]))
    for frame in range(n):
        hand, phase = part.hand[frame], frame / (n - 1)
        off = hand - start * (1.0 - phase) - goal * phase
        for axis in range(3):
            features[frame, axis] = np.sum(rotation[axis] * off)
        features[frame, 3] = hand[2] - table_height
        features[frame, PACE], features[frame, PHASE] = part.pace[frame], phase
        if np.isnan(hand[0]):
            features[frame, PHASE] = np.nan
        for role, index in enumerate(filling):
            column = N_OF_MOVEMENT + N_OF_ROLE * role
            features[frame, column] = np.sqrt(np.sum((part.objects[index, frame] - hand) ** 2))
            features[frame, column + 1] = part.paces[index, frame]
    return features


@njit(cache=True)
def _ratio(features: Floats, chain: Chain) -> float:
    """Return the log-likelihood ratio of a whole movement to the background [nat]."""
    n_states = len(chain.stay)
    paths = np.full(n_states, -np.inf)
    for frame in range(len(features)):
        before = paths.copy()
        for s in range(n_states):
            best = before[s] + chain.stay[s]
            if s > 0:
                best = max(best, before[s - 1] + chain.leave[s - 1])
            elif frame == 0:
                best = 0.0
            for d in range(features.shape[1]):
                if not np.isnan(features[frame, d]):
                    z = (features[frame, d] - chain.mean[s, d]) / chain.scale[s, d]
                    best += chain.peak[s, d] - 0.5 * (chain.freedom + 1.0) * np.log1p(z * z / chain.freedom)
            paths[s] = best
    return float(paths[-1] + chain.leave[-1])
