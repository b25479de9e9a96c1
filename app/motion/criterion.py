"""The one criterion that segments and classes are chosen by, in Steps 1 and 3 of the paper.

It is the log posterior odds of a class against the background, up to a constant:

    evidence * log-likelihood ratio + log p(duration) - max log p(duration)

Neighbouring frames are not independent. A plain HMM counts them as if they were, many times over what they
say, and its ratio then outweighs how long an action takes. ``evidence`` is the share of the frames that are
independent, learned from how much the demonstrations' deviations from their states repeat themselves; it
tempers the likelihood as composite likelihoods are (Pauli, Racugno and Ventura 2011). Durations are
log-normal. No part has a unit: the same data in millimetres give the same numbers.
"""

from __future__ import annotations

import numpy as np

from app.motion.model import ActionModel, Model
from app.motion.scoring import Indices, score_segments, states_of
from app.motion.trajectory import Floats

PACE = 0.2
"""Least standard deviation of the logarithm of durations: people differ in pace by a fifth."""


class Criterion:
    """The criterion of a model's classes on one table."""

    def __init__(self, model: Model, table_height: float) -> None:
        self._states, self._table_height = states_of(model), table_height
        self._evidence, self._rate = model.evidence, model.features.rate
        self._paces = np.array([_pace(action) for action in model.actions])

    def __call__(self, hand: Floats, objects: Floats, segments: Indices) -> Floats:
        """Return the (n_segments, n_classes) criterion [nat].

        hand: (n_frames, 3) [m]; objects: (n_objects, n_frames, 3) [m], at the internal rate; segments:
        (n_segments, 2) first and goal frame, neither a dropout of the hand.
        """
        seconds = (segments[:, 1] - segments[:, 0]) / self._rate
        mean, deviation = self._paces.T
        slowness = (np.log(seconds)[:, None] - mean) / deviation
        criterion: Floats = self.odds(hand, objects, segments) - 0.5 * slowness**2
        return criterion

    def odds(self, hand: Floats, objects: Floats, segments: Indices) -> Floats:
        """Return the same whatever the durations: what can be said of a movement that is under way [nat]."""
        ratios: Floats = score_segments(hand, objects, self._table_height, segments, self._states)
        return self._evidence * ratios


def _pace(action: ActionModel) -> tuple[float, float]:
    """Return mean and standard deviation of the logarithm of durations in seconds."""
    logs = np.log(action.durations)
    spread = float(logs.std(ddof=1)) if len(logs) > 1 else 0.0
    return float(logs.mean()), max(spread, PACE)
