"""Log-likelihoods of segments (Eq. (1) of the paper).

A path starts in the first state and ends by leaving the last; ``lanes`` follows it.

All log-likelihoods are *ratios* to the background. They have no unit: the same data in millimetres give the
same numbers. What neither explains better adds nothing, so the ratios of segments may be added up and
compared however much of the motion they cover.

What a state says of a frame is the predictive density of its Gaussian. Its mean and variance are known from
n demonstrations only, whose frames are too much alike to count each, so that is Student's t with n - 1
degrees of freedom: few demonstrations leave heavy tails, many a Gaussian.

A *filling* says which object fills which role. Each is a path of its own, and the best one counts: the
object that behaves as the role's did in the demonstrations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numba import njit

from app.motion.conditioning import Tracks
from app.motion.features import N_DEVIATIONS
from app.motion.lanes import Lanes, States, begin, follow, lanes_for, put
from app.motion.model import PHASE, ActionModel, Background, Model
from app.motion.simd import LANES
from app.motion.trajectory import Floats, Indices

MOST_FRAMES = 200
"""Of a longer segment every second frame is looked at, or every third …, and counts for the others."""

KEPT = 32
"""Models whose states are kept."""


def predictive(action: ActionModel) -> tuple[float, Floats]:
    """Return the degrees of freedom and the (n_states, n_features) scales [m] of the states' densities.

    The scale is the standard deviation without bias, widened by what is not known of the mean.
    """
    n = max(action.n_demonstrations, 2)
    return n - 1.0, np.sqrt(action.variances * (n + 1.0) / (n - 1.0))


def states_of(actions: Sequence[ActionModel], background: Background) -> States:
    """Return the states of all classes, ready for ``score_segments``."""
    power, base, root, stay, enter, leave, least = [], [], [], [], [], [], []
    for action in actions:
        freedom, scale = predictive(action)
        power.append((freedom + 1.0) / 2.0)
        log_peak = math.lgamma(power[-1]) - math.lgamma(freedom / 2.0) - 0.5 * math.log(math.pi * freedom)
        base.append(np.exp((np.log(scale / background.width) - log_peak) / power[-1]))
        root.append(1.0 / (np.sqrt(freedom) * scale))
        least.append(base[-1][:, [*range(N_DEVIATIONS), PHASE]].prod(axis=1))
        stay.append(action.stay ** (-1.0 / power[-1]))
        leave.append((1.0 - action.stay) ** (-1.0 / power[-1]))
        enter.append(np.append(1.0, leave[-1][:-1]))
    return States(
        first=np.cumsum([0, *(action.n_states for action in actions)]),
        power=np.array(power),
        root=_columns(root, 0.0),
        centre=_columns([at * action.means for at, action in zip(root, actions, strict=True)], 0.0),
        base=_columns(base, 1.0),
        stay=_columns(stay, 1.0) * _columns(least, 1.0),
        enter=_columns(enter, 1.0) * _columns(least, 1.0),
        unseen=1.0 / _columns(least, 1.0),
        leave=_columns(leave, 1.0),
        ones=np.ones(LANES),
    )


@lru_cache(maxsize=KEPT)
def model_states(model: Model) -> States:
    """Return the states of a model, the same to all who ask while it is among the last."""
    return states_of(model.actions, model.background)


def _columns(of_actions: Sequence[Floats], idle: float) -> Floats:
    """Return (…, n_columns) values of all states, and of idle ones up to a multiple of LANES."""
    rows = np.concatenate(of_actions)
    columns = np.full((*rows.shape[1:], -(-len(rows) // LANES) * LANES), idle)
    columns[..., : len(rows)] = rows.T
    return columns


@njit(cache=True, nogil=True, error_model="numpy")
def score_segments(
    tracks: Tracks, table_height: float, segments: Indices, states: States, fillings: Indices
) -> tuple[Floats, Indices]:
    """Return (n_segments, n_classes) log-likelihood ratios to the background [nat], and whose filling it is.

    table_height [m]; segments: (n_segments, 2) first and goal frame, neither a dropout of the hand;
    fillings: (n_fillings, n_roles) the object in each role. A segment of fewer frames than a class has states
    has -inf.
    """
    shape = (len(segments), len(states.power))
    ratios, filled = np.full(shape, -np.inf), np.zeros(shape, dtype=np.int64)
    lanes, classes = lanes_for(states, len(fillings)), np.arange(len(states.power))
    order, done = _order(segments), 0
    while done < len(segments):
        stop = done + 1
        while stop < min(done + LANES, len(segments)) and go_together(
            segments[order[done]], segments[order[stop]]
        ):
            stop += 1
        group = order[done:stop]
        best, of_best = ratios[group], filled[group]
        score_together(lanes, tracks, table_height, segments[group], classes, states, fillings, best, of_best)
        for row, index in enumerate(group):
            ratios[index], filled[index] = best[row], of_best[row]
        done = stop
    return ratios, filled


@njit(cache=True, nogil=True)
def _order(segments: Indices) -> Indices:
    """Return an order in which segments that go together are beside each other."""
    steps = np.array([step_of(segment) for segment in segments])
    return np.argsort(steps * 2**32 + segments[:, 1] % steps, kind="mergesort")


@njit(cache=True, nogil=True)
def step_of(segment: Indices) -> int:
    """Return every how many frames of a segment are looked at."""
    return max((segment[1] - segment[0]) // MOST_FRAMES, 1)  # type: ignore[no-any-return]


@njit(cache=True, nogil=True)
def go_together(one: Indices, other: Indices) -> bool:
    """Return whether the frames that are looked at of one segment are among those of another, or after."""
    step = step_of(one)
    return step == step_of(other) and bool((other[1] - one[1]) % step == 0)


@njit(cache=True, nogil=True, error_model="numpy")
def score_together(
    lanes: Lanes,
    tracks: Tracks,
    table_height: float,
    segments: Indices,
    classes: Indices,
    states: States,
    fillings: Indices,
    ratios: Floats,
    filled: Indices,
) -> None:
    """Write what ``score_segments`` says of at most LANES segments that go together, of some classes."""
    for lane in range(LANES):
        origin, goal = segments[min(lane, len(segments) - 1)]
        duration = float(max(goal - origin, 1))
        put(lanes, lane, (origin, goal), tracks.hand[origin], tracks.hand[goal], duration)
    begin(lanes)
    step, last = step_of(segments[0]), segments[:, 1].max()
    frames = last - (last - segments[:, 0].min()) // step * step, last + 1, step
    follow(lanes, tracks, table_height, frames, classes, states, fillings)
    for lane in range(len(segments)):
        for k in classes:
            leave = math.log(states.leave[states.first[k + 1] - 1])
            for f in range(len(fillings)):
                ratio = -step * states.power[k] * (lanes.ended[f, k, lane] + leave)
                if ratio > ratios[lane, k]:
                    ratios[lane, k], filled[lane, k] = ratio, f
