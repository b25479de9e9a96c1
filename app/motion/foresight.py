"""What a movement under way may become: its class, how far it has come, and where it goes.

The end point of a movement moves every feature, and of a movement under way it is not known. But a class
says what share of the way is behind at each phase, so each class and phase stands for one goal: where the
way made so far leads. With that goal the frames so far are scored like those of a segment, by paths
that need not have come to the last state, and weighed by how likely the implied duration and length are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from app.motion.conditioning import Tracks
from app.motion.features import axes
from app.motion.lanes import States, begin, follow, lanes_for, least_log, put
from app.motion.model import PHASE, ActionModel, Model
from app.motion.scoring import model_states
from app.motion.simd import LANES
from app.motion.trajectory import Floats, Indices

PHASES = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97])
"""Phases that a movement under way may be in."""

MOST_FRAMES = 32
"""Of a longer movement every second frame is looked at, or every third …, and counts for the others."""

LEAST_WAY = 0.02
"""Less than this share of the way tells nothing of the rest of it."""

AIM = 0.3
"""How uncertain a goal is, as a share of the way that its phase leaves ahead."""


class Course(NamedTuple):
    """How the classes go on average.

    way: (n_classes, n_phases) share of the way behind at PHASES; aside: (n_classes, n_phases, 2) sideways and
    up [m]; tempo, extent: (n_classes, 2) mean and standard deviation of the logarithms of durations in
    frames and of lengths in metres.
    """

    way: Floats
    aside: Floats
    tempo: Floats
    extent: Floats


class Outlook(NamedTuple):
    """What a movement under way may become.

    values: (n_classes, n_phases) comparable to the criterion [nat]; goals: (n_classes, n_phases, 3) [m], and
    how uncertain they are, spreads: (n_classes, n_phases) [m].
    """

    values: Floats
    goals: Floats
    spreads: Floats


class Foresight:
    """The outlook of a model's classes on one table; fillings: (n_fillings, n_roles)."""

    def __init__(self, model: Model, table_height: float, fillings: Indices) -> None:
        self._states = model_states(model)
        self._table_height, self._fillings = table_height, fillings
        self._evidence, self._course = model.evidence, course_of(model)

    def __call__(self, tracks: Tracks, origin: int, through: int) -> Outlook:
        """Return the outlook at frame ``through`` of a movement since ``origin``, neither a dropout."""
        return Outlook(
            *_outlook(
                tracks,
                self._table_height,
                origin,
                through,
                self._evidence,
                self._states,
                self._fillings,
                self._course,
            )
        )


def course_of(model: Model) -> Course:
    """Return how a model's classes go on average."""
    paths = [_mean_deviation(action) for action in model.actions]
    lengths = [np.exp(action.extent[0]) for action in model.actions]
    in_frames = [np.log(model.features.rate), 0.0]
    return Course(
        way=np.array([PHASES + path[:, 0] / far for path, far in zip(paths, lengths, strict=True)]),
        aside=np.array([path[:, 1:] for path in paths]),
        tempo=np.array([np.add(action.tempo, in_frames) for action in model.actions]),
        extent=np.array([action.extent for action in model.actions]),
    )


def _mean_deviation(action: ActionModel) -> Floats:
    """Return the (n_phases, 3) mean deviation [m] of a class at PHASES."""
    phases = np.concatenate([[0.0], action.means[:, PHASE], [1.0]])
    columns = [np.concatenate([[0.0], action.means[:, axis], [0.0]]) for axis in range(3)]
    return np.column_stack([np.interp(PHASES, phases, column) for column in columns])


@njit(cache=True, nogil=True, error_model="numpy")
def _outlook(
    tracks: Tracks,
    table_height: float,
    origin: int,
    through: int,
    evidence: float,
    states: States,
    fillings: Indices,
    course: Course,
) -> tuple[Floats, Floats, Floats]:
    n_classes, n_phases = course.way.shape
    values, spreads = np.empty((n_classes, n_phases)), np.empty((n_classes, n_phases))
    goals = np.empty((n_classes, n_phases, 3))
    lanes, step = lanes_for(states, len(fillings)), max((through - origin) // MOST_FRAMES, 1)
    frames = (through - (through - origin) // step * step, through + 1, step)
    start, here = tracks.hand[origin], tracks.hand[through]
    begin(lanes)
    for k in range(n_classes):
        for p in range(n_phases):
            _goal(start, here, max(course.way[k, p], LEAST_WAY), course.aside[k, p], goals[k, p])
        for lane in range(LANES):
            p = min(lane, n_phases - 1)
            put(lanes, lane, (origin, through), start, goals[k, p], (through - origin) / PHASES[p])
        follow(lanes, tracks, table_height, frames, np.array([k]), states, fillings)
        for p in range(n_phases):
            slow = (np.log((through - origin) / PHASES[p]) - course.tempo[k, 0]) / course.tempo[k, 1]
            length = _distance(goals[k, p], start)
            spreads[k, p] = AIM * length * (1.0 - PHASES[p])
            far = (np.log(length + 1e-9) - course.extent[k, 0]) / course.extent[k, 1]
            ratio = -step * states.power[k] * least_log(lanes, p, k, states)
            values[k, p] = evidence * ratio - 0.5 * (slow * slow + far * far) - np.log(n_phases)
    return values, goals, spreads


@njit(cache=True, nogil=True)
def _goal(start: Floats, here: Floats, way: float, aside: Floats, goal: Floats) -> None:
    """Write where a movement leads that has made this share of its way and is so far aside of it."""
    for axis in range(3):
        goal[axis] = start[axis] + (here[axis] - start[axis]) / way
    for _ in range(2):
        _, side, above = axes(goal[0] - start[0], goal[1] - start[1], goal[2] - start[2])
        for axis in range(3):
            off = aside[0] * side[axis] + aside[1] * above[axis]
            goal[axis] = start[axis] + (here[axis] - start[axis] - off) / way


@njit(cache=True, nogil=True)
def _distance(one: Floats, other: Floats) -> float:
    dx, dy, dz = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    return np.sqrt(dx * dx + dy * dy + dz * dz)  # type: ignore[no-any-return]
