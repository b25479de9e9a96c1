"""The criterion of the core, written plainly with numba: what anybody would write second.

One segment, one class and one filling after the other; logarithms of densities, nothing left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.special import gammaln

from app.motion.conditioning import Tracks
from app.motion.criterion import Criterion, Scores
from app.motion.features import alignment
from app.motion.model import N_OF_MOVEMENT, N_OF_ROLE, PACE, PHASE, Model
from app.motion.scoring import predictive
from app.motion.trajectory import Floats, Indices


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


class NumbaCriterion(Criterion):
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

    def __call__(self, tracks: Tracks, segments: Indices) -> Scores:
        """Return the scores of segments; (n_segments, 2)."""
        way = np.linalg.norm(tracks.hand[segments[:, 1]] - tracks.hand[segments[:, 0]], axis=1)
        terms, shape = self._terms, (len(segments), len(self._chains))
        scores = Scores(np.full(shape, -np.inf), np.full(shape, -np.inf), np.zeros(shape, dtype=np.int64))
        for row in np.flatnonzero(way >= terms.nearest.min()).tolist():
            start, goal = segments[row].tolist()
            slow = (np.log(goal - start) - terms.tempo[:, 0]) / terms.tempo[:, 1]
            for k, chain in enumerate(self._chains):
                ratios = [
                    _ratio(tracks, self._table_height, start, goal, each, chain) for each in self._fillings
                ]
                if way[row] >= terms.nearest[k]:
                    scores.criterion[row, k] = terms.evidence * max(ratios) - 0.5 * slow[k] ** 2
                scores.ratio[row, k] = max(ratios) / (goal - start + 1)
                scores.filling[row, k] = int(np.argmax(ratios))
        return scores

    def best(
        self, tracks: Tracks, segments: Indices, _bounds: Floats, _before: Floats, least: Floats
    ) -> Floats:
        """Return (n_segments,) values of the best class, whatever lies before."""
        values: Floats = np.maximum(self(tracks, segments).criterion.max(axis=1), least)
        return values


@njit(cache=True)
def _features(tracks: Tracks, table_height: float, start: int, goal: int, filling: Indices) -> Floats:
    """Return the (n_frames, n_features) features of a segment."""
    n = goal - start + 1
    features = np.empty((n, N_OF_MOVEMENT + N_OF_ROLE * len(filling)))
    rotation = alignment(tracks.hand[start], tracks.hand[goal])
    for frame in range(n):
        hand, phase = tracks.hand[start + frame], frame / (n - 1)
        off = hand - tracks.hand[start] * (1.0 - phase) - tracks.hand[goal] * phase
        for axis in range(3):
            features[frame, axis] = np.sum(rotation[axis] * off)
        features[frame, 3] = hand[2] - table_height
        features[frame, PACE], features[frame, PHASE] = tracks.pace[start + frame], phase
        if np.isnan(hand[0]):
            features[frame, PHASE] = np.nan
        for role, index in enumerate(filling):
            column = N_OF_MOVEMENT + N_OF_ROLE * role
            features[frame, column] = np.sqrt(np.sum((tracks.objects[index, start + frame] - hand) ** 2))
            features[frame, column + 1] = tracks.paces[index, start + frame]
    return features


@njit(cache=True)
def _ratio(
    tracks: Tracks, table_height: float, start: int, goal: int, filling: Indices, chain: Chain
) -> float:
    """Return the log-likelihood ratio of a segment to the background [nat]."""
    features, n_states = _features(tracks, table_height, start, goal, filling), len(chain.stay)
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
