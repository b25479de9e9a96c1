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
from app.motion.features import alignment
from app.motion.model import PHASE, ActionModel, Model
from app.motion.scoring import Indices, Movement, States, follow, room_for, states_of
from app.motion.trajectory import Floats

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
        self._states = states_of(model.actions, model.background)
        self._table_height, self._fillings = table_height, fillings
        self._evidence, self._course = model.evidence, course_of(model)

    def __call__(self, tracks: Tracks, origin: int, through: int) -> Outlook:
        """Return the outlook at frame ``through`` of a movement since ``origin``, neither a dropout."""
        values, goals = _outlook(
            tracks,
            self._table_height,
            origin,
            through,
            self._evidence,
            self._states,
            self._fillings,
            self._course,
        )
        ahead = np.linalg.norm(goals - tracks.hand[origin], axis=2) * (1.0 - PHASES)
        return Outlook(values, goals, AIM * ahead)


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
) -> tuple[Floats, Floats]:
    n_classes, n_phases = course.way.shape
    values, goals = np.empty((n_classes, n_phases)), np.empty((n_classes, n_phases, 3))
    paths, step = room_for(states, len(fillings)), max((through - origin) // MOST_FRAMES, 1)
    start, here = tracks.hand[origin], tracks.hand[through]
    for k in range(n_classes):
        first = states.first[k : k + 2]
        for p in range(n_phases):
            goal = _goal(start, here, max(course.way[k, p], LEAST_WAY), course.aside[k, p])
            duration = (through - origin) / PHASES[p]
            movement = Movement(origin, through, step, start, goal, duration)
            follow(tracks, table_height, movement, first, states, fillings, paths)
            ratio = -np.inf
            for f in range(len(fillings)):
                best = paths.density[f, first[0] + 1 : first[1] + 1].max()
                ratio = max(ratio, states.power[k] * (paths.logs[f, 0] + np.log(best)))
            slow = (np.log(duration) - course.tempo[k, 0]) / course.tempo[k, 1]
            length = np.sqrt(np.sum((goal - start) ** 2)) + 1e-9
            far = (np.log(length) - course.extent[k, 0]) / course.extent[k, 1]
            values[k, p] = evidence * step * ratio - 0.5 * (slow * slow + far * far) - np.log(n_phases)
            goals[k, p] = goal
    return values, goals


@njit(cache=True, nogil=True)
def _goal(start: Floats, here: Floats, way: float, aside: Floats) -> Floats:
    """Return where a movement leads that has made this share of its way and is so far aside of it."""
    goal = start + (here - start) / way
    for _ in range(2):
        rotation = alignment(start, goal)
        goal = start + (here - start - aside[0] * rotation[1] - aside[1] * rotation[2]) / way
    return goal
