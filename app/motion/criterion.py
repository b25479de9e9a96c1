"""The one criterion that segmentations are chosen by.

A segmentation divides a stream into actions and rest, and its value [nat] is the sum over its parts. An
action between two points counts

    evidence * log-likelihood ratio + log p(duration) - max log p(duration)

which is, up to a constant, the log posterior odds of its class against the background; the search takes off
``START`` for each action and ``PAUSE`` for each rest, so that few parts are better than many.

Neighbouring frames are not independent. A plain HMM counts them as if they were, many times over what they
say, and its ratio then outweighs how long an action takes. ``evidence`` is the share of the frames that are
independent, learned from how much the demonstrations' deviations from their states repeat themselves; it
tempers the likelihood as composite likelihoods are (Pauli, Racugno and Ventura 2011). Durations are
log-normal. No part has a unit: the same data in millimetres give the same numbers.

Rest counts what the frames of a typical action do, as long as the hand is no faster than where demonstrations
begin and end; the faster it is, the less.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.motion.conditioning import Tracks
from app.motion.features import BLEND
from app.motion.model import Model
from app.motion.scoring import Indices, score_segments, states_of
from app.motion.trajectory import Floats

START = 6.0
"""What an action must explain better than its neighbours to be one [nat]: it begins once in e^6 frames."""

PAUSE = 1.5
"""What a rest must explain better than the actions beside it to be one [nat]."""

LEAST_REST = -10.0
"""A frame that is surely no rest counts no less than this [nat]."""

NEARER = 2.5
"""An action goes at most this many times less far than any demonstration of it."""


class Scores(NamedTuple):
    """What classes say of segments, each (n_segments, n_classes).

    criterion [nat], -inf where a class cannot be or an end point is a dropout; ratio: log-likelihood ratio
    to the background [nat per frame]; filling: index of the best.
    """

    criterion: Floats
    ratio: Floats
    filling: Indices


class Criterion:
    """The criterion of a model's classes on one table; fillings: (n_fillings, n_roles) objects in roles."""

    def __init__(self, model: Model, table_height: float, fillings: Indices) -> None:
        self._states = states_of(model.actions, model.background)
        self._table_height, self._fillings = table_height, fillings
        self._evidence, self._rate, self._rest = model.evidence, model.features.rate, model.rest
        self._tempo = np.array([action.tempo for action in model.actions])
        self._nearest = np.array([max(a.lengths.min() / NEARER, BLEND) for a in model.actions])
        self.typical = float(self._evidence * model.familiarity.typical.mean())

    def __call__(self, tracks: Tracks, segments: Indices) -> Scores:
        """Return the scores of segments.

        segments: (n_segments, 2) first and goal frame.
        """
        way = np.linalg.norm(tracks.hand[segments[:, 1]] - tracks.hand[segments[:, 0]], axis=1)
        shape = (len(segments), len(self._nearest))
        result = Scores(np.full(shape, -np.inf), np.full(shape, -np.inf), np.zeros(shape, dtype=np.int64))
        goes = way >= self._nearest.min()
        if goes.any():
            for whole, part in zip(result, self._of_moving(tracks, segments[goes], way[goes]), strict=True):
                whole[goes] = part
        return result

    def _of_moving(self, tracks: Tracks, segments: Indices, way: Floats) -> Scores:
        """Return the scores of segments that go far enough for some class; way: (n_segments,) [m]."""
        ratios, filled = score_segments(tracks, self._table_height, segments, self._states, self._fillings)
        n_frames = segments[:, 1] - segments[:, 0]
        mean, deviation = self._tempo.T
        slowness = (np.log(n_frames / self._rate)[:, None] - mean) / deviation
        criterion = self._evidence * ratios - 0.5 * slowness**2
        criterion[way[:, None] < self._nearest] = -np.inf
        return Scores(criterion, ratios / (n_frames + 1)[:, None], filled)

    def rest(self, pace: Floats) -> Floats:
        """Return what frames count as rest [nat], 0 for a dropout; pace: (n,) of the hand."""
        faster = np.maximum(pace - self._rest.pace, 0.0) / self._rest.spread
        counted = self.typical + np.maximum(-0.5 * faster**2, LEAST_REST)
        return np.nan_to_num(counted, nan=0.0)
