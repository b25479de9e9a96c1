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
from numba import njit

from app.motion.conditioning import Tracks
from app.motion.features import BLEND
from app.motion.lanes import States, lanes_for, most
from app.motion.model import Model
from app.motion.scoring import go_together, model_states, score_segments, score_together, step_of
from app.motion.simd import LANES
from app.motion.trajectory import Floats, Indices

START = 6.0
"""What an action must explain better than its neighbours to be one [nat]: it begins once in e^6 frames."""

PAUSE = 1.5
"""What a rest must explain better than the actions beside it to be one [nat]."""

LEAST_REST = -10.0
"""A frame that is surely no rest counts no less than this [nat]."""

NEARER = 2.5
"""An action goes at most this many times less far than any demonstration of it."""


SLACK = 1e-6
"""What rounding can make of a bound, and more [nat]."""


class Scores(NamedTuple):
    """What classes say of segments, each (n_segments, n_classes).

    criterion [nat], -inf where a class cannot be or an end point is a dropout; ratio: log-likelihood ratio
    to the background [nat per frame]; filling: index of the best.
    """

    criterion: Floats
    ratio: Floats
    filling: Indices


class Terms(NamedTuple):
    """What the criterion is made of beside the ratios.

    evidence: share of the frames that counts; tempo: (n_classes, 2) mean and standard deviation of the
    logarithms of durations in frames; nearest: (n_classes,) the least way from start to goal [m].
    """

    evidence: float
    tempo: Floats
    nearest: Floats


class Criterion:
    """The criterion of a model's classes on one table; fillings: (n_fillings, n_roles) objects in roles."""

    def __init__(self, model: Model, table_height: float, fillings: Indices) -> None:
        self._states = model_states(model)
        self._table_height, self._fillings, self._rest = table_height, fillings, model.rest
        in_frames = [np.log(model.features.rate), 0.0]
        self._terms = Terms(
            evidence=model.evidence,
            tempo=np.array([np.add(action.tempo, in_frames) for action in model.actions]),
            nearest=np.array([max(action.lengths.min() / NEARER, BLEND) for action in model.actions]),
        )
        self._lanes = lanes_for(self._states, len(fillings))
        self.typical = float(model.evidence * model.familiarity.typical.mean())

    def __call__(self, tracks: Tracks, segments: Indices) -> Scores:
        """Return the scores of segments.

        segments: (n_segments, 2) first and goal frame.
        """
        scores = _scores(tracks, self._table_height, segments, self._states, self._fillings, self._terms)
        return Scores(*scores)

    def most(self, tracks: Tracks, frame: int) -> Floats:
        """Return (n_classes,) what a frame can count at most in ``ratio`` [nat]."""
        return most(self._lanes, tracks, self._table_height, frame, self._states, self._fillings)

    def best(
        self, tracks: Tracks, segments: Indices, bounds: Floats, before: Floats, least: Floats
    ) -> Floats:
        """Return (n_segments,) values of the best class, ``least`` [nat] where that is more.

        bounds: (n_frames + 1, n_classes) sums of ``most`` over all frames before; before: (n_segments,) what
        a division has where a segment begins. What cannot give the best division is not looked at: a segment
        has ``least`` then. One of which not every frame is looked at has no bound and is looked at always.
        """
        return _best(
            tracks,
            self._table_height,
            segments,
            self._states,
            self._fillings,
            self._terms,
            bounds,
            before,
            least,
        )

    def rest(self, pace: Floats) -> Floats:
        """Return what frames count as rest [nat], 0 for a dropout; pace: (n,) of the hand."""
        return _rest(pace, self._rest.pace, self._rest.spread, self.typical)


@njit(cache=True, nogil=True)
def _rest(pace: Floats, still: float, spread: float, typical: float) -> Floats:
    counted = np.zeros(len(pace))
    for index in range(len(pace)):
        if not np.isnan(pace[index]):
            faster = max(pace[index] - still, 0.0) / spread
            counted[index] = typical + max(-0.5 * faster * faster, LEAST_REST)
    return counted


@njit(cache=True, nogil=True, error_model="numpy")
def _way(tracks: Tracks, segment: Indices) -> float:
    """Return how far a segment goes [m], NaN where an end point is a dropout."""
    way = 0.0
    for axis in range(3):
        way += (tracks.hand[segment[1], axis] - tracks.hand[segment[0], axis]) ** 2
    return np.sqrt(way)  # type: ignore[no-any-return]


@njit(cache=True, nogil=True, error_model="numpy")
def _of_duration(segment: Indices, k: int, terms: Terms) -> float:
    """Return what the duration of a segment counts for a class, 0 at most [nat]."""
    slowness = (np.log(segment[1] - segment[0]) - terms.tempo[k, 0]) / terms.tempo[k, 1]
    return -0.5 * slowness * slowness  # type: ignore[no-any-return]


@njit(cache=True, nogil=True, error_model="numpy")
def _scores(
    tracks: Tracks, table_height: float, segments: Indices, states: States, fillings: Indices, terms: Terms
) -> tuple[Floats, Floats, Indices]:
    shape = (len(segments), len(terms.nearest))
    criterion, per_frame = np.full(shape, -np.inf), np.full(shape, -np.inf)
    filling = np.zeros(shape, dtype=np.int64)
    ways = np.array([_way(tracks, segment) for segment in segments])
    moving = np.flatnonzero(ways >= terms.nearest.min())
    ratios, filled = score_segments(tracks, table_height, segments[moving], states, fillings)
    for row, index in enumerate(moving):
        segment = segments[index]
        per_frame[index] = ratios[row] / (segment[1] - segment[0] + 1)
        filling[index] = filled[row]
        for k in range(shape[1]):
            if ways[index] >= terms.nearest[k]:
                criterion[index, k] = terms.evidence * ratios[row, k] + _of_duration(segment, k, terms)
    return criterion, per_frame, filling


@njit(cache=True, nogil=True, error_model="numpy")
def _best(
    tracks: Tracks,
    table_height: float,
    segments: Indices,
    states: States,
    fillings: Indices,
    terms: Terms,
    bounds: Floats,
    before: Floats,
    least: Floats,
) -> Floats:
    values = least.copy()
    if len(segments) == 0:
        return values
    most_of_all = (before + least).max()
    most_of = _bounds(tracks, segments, terms, bounds)
    most = before + _row_maxima(most_of)
    lanes, shape = lanes_for(states, len(fillings)), (LANES, len(terms.nearest))
    while most.max() > -np.inf and most.max() >= most_of_all:
        group = _group(segments, most, most_of_all)
        could = np.zeros(shape[1], dtype=np.bool_)
        for index in group:
            could |= before[index] + most_of[index] >= most_of_all
        ratios, filled = np.full(shape, -np.inf), np.zeros(shape, dtype=np.int64)
        classes = np.flatnonzero(could)
        score_together(
            lanes, tracks, table_height, segments[group], classes, states, fillings, ratios, filled
        )
        for lane, index in enumerate(group):
            for k in range(shape[1]):
                if could[k] and most_of[index, k] > -np.inf:
                    value = terms.evidence * ratios[lane, k] + _of_duration(segments[index], k, terms)
                    values[index] = max(values[index], value)
            most_of_all = max(most_of_all, before[index] + values[index])
            most[index] = -np.inf
    return values


@njit(cache=True, nogil=True, error_model="numpy")
def _bounds(tracks: Tracks, segments: Indices, terms: Terms, bounds: Floats) -> Floats:
    """Return (n_segments, n_classes) what the criterion is at most."""
    found = np.full((len(segments), len(terms.nearest)), -np.inf)
    for index in range(len(segments)):
        segment, way = segments[index], _way(tracks, segments[index])
        for k in range(len(terms.nearest)):
            if way >= terms.nearest[k]:
                found[index, k] = np.inf
                if step_of(segment) == 1:
                    ratio = bounds[segment[1] + 1, k] - bounds[segment[0], k]
                    found[index, k] = terms.evidence * ratio + _of_duration(segment, k, terms) + SLACK
    return found


@njit(cache=True, nogil=True)
def _row_maxima(values: Floats) -> Floats:
    maxima = np.empty(len(values))
    for index in range(len(values)):
        maxima[index] = values[index].max()
    return maxima


@njit(cache=True, nogil=True)
def _group(segments: Indices, most: Floats, needed: float) -> Indices:
    """Return the most promising segment, and of those beside it up to LANES in all that can be looked at."""
    middle = most.argmax()
    group, size = np.empty(LANES, dtype=np.int64), 0
    for step in range(2 * LANES):
        index = middle + ((step + 1) // 2) * (1 if step % 2 else -1)
        could = 0 <= index < len(most) and size < LANES and most[index] >= needed
        if could and go_together(segments[middle], segments[index]):
            group[size] = index
            size += 1
    return np.sort(group[:size])
