"""Log-likelihoods of segments: features and Viterbi in one compiled pass (Eq. (1) of the paper).

The end point of a segment moves every one of its features, so each segment is a pass of its own.
A path starts in the first state and ends by leaving the last. A missing value (NaN) is summed out: it
adds nothing to any state.

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

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import gammaln

from app.motion.conditioning import Tracks
from app.motion.features import alignment
from app.motion.model import N_OF_MOVEMENT, N_OF_ROLE, PACE, PHASE, ActionModel, Background
from app.motion.trajectory import Floats

Indices = NDArray[np.int64]

MOST_FRAMES = 200
"""Of a longer segment every second frame is looked at, or every third …, and counts for the others."""

_LOW, _HIGH = 1e-90, 1e90  # where the densities of paths are brought back to 1


class States(NamedTuple):
    """The states of all classes, one after the other, in units of the background.

    All densities and probabilities are raised to the power ``1 / power`` of their class, in which Student's t
    is one over a quadratic: of feature d in state s it is ``1 / (base + slope * (x - mean)^2)``.
    first: (n_classes + 1,) where each class begins; power: (n_classes,); mean, base, slope: (n_features,
    n_states); stay: (n_states,); enter: (n_states,) from the state before, 0 for the first of a class;
    leave: (n_states,).
    """

    first: Indices
    power: Floats
    mean: Floats
    base: Floats
    slope: Floats
    stay: Floats
    enter: Floats
    leave: Floats


class Movement(NamedTuple):
    """A movement between two points, as far as it is looked at.

    origin, through, step: its first and last frame, and every how many are looked at; start, goal: (3,) [m];
    duration: frames from start to goal.
    """

    origin: int
    through: int
    step: int
    start: Floats
    goal: Floats
    duration: float


class Paths(NamedTuple):
    """The best paths of all fillings, and room to work in.

    density: (n_fillings, n_states + 1) of the best path to state s at s + 1; logs: (n_fillings, n_classes)
    what was scaled off it [nat]; moved: (n_states + 1,); common, misfit: (n_states,) one over the density of
    the movement's features, and of all; x: (n_features,).
    """

    density: Floats
    logs: Floats
    moved: Floats
    common: Floats
    misfit: Floats
    x: Floats


def predictive(action: ActionModel) -> tuple[float, Floats]:
    """Return the degrees of freedom and the (n_states, n_features) scales [m] of the states' densities.

    The scale is the standard deviation without bias, widened by what is not known of the mean.
    """
    n = max(action.n_demonstrations, 2)
    return n - 1.0, np.sqrt(action.variances * (n + 1.0) / (n - 1.0))


def states_of(actions: Sequence[ActionModel], background: Background) -> States:
    """Return the states of all classes, ready for ``score_segments``."""
    power, base, slope, stay, enter, leave = [], [], [], [], [], []
    for action in actions:
        freedom, scale = predictive(action)
        power.append((freedom + 1.0) / 2.0)
        log_peak = gammaln(power[-1]) - gammaln(freedom / 2.0) - 0.5 * np.log(np.pi * freedom)
        base.append(np.exp((np.log(scale / background.width) - log_peak) / power[-1]))
        slope.append(base[-1] / (freedom * scale**2))
        stay.append(action.stay ** (1.0 / power[-1]))
        leave.append((1.0 - action.stay) ** (1.0 / power[-1]))
        enter.append(np.append(0.0, leave[-1][:-1]))
    return States(
        first=np.cumsum([0, *(action.n_states for action in actions)]),
        power=np.array(power),
        mean=np.ascontiguousarray(np.vstack([action.means for action in actions]).T),
        base=np.ascontiguousarray(np.vstack(base).T),
        slope=np.ascontiguousarray(np.vstack(slope).T),
        stay=np.concatenate(stay),
        enter=np.concatenate(enter),
        leave=np.concatenate(leave),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def score_segments(
    tracks: Tracks, table_height: float, segments: Indices, states: States, fillings: Indices
) -> tuple[Floats, Indices]:
    """Return (n_segments, n_classes) log-likelihood ratios to the background [nat], and whose filling it is.

    table_height [m]; segments: (n_segments, 2) first and goal frame, neither a dropout of the hand;
    fillings: (n_fillings, n_roles) the object in each role. A segment of fewer frames than a class has states
    has -inf.
    """
    first, power = states.first, states.power
    ratios = np.full((len(segments), len(power)), -np.inf)
    filled = np.zeros((len(segments), len(power)), dtype=np.int64)
    paths = room_for(states, len(fillings))
    for index in range(len(segments)):
        origin, goal = segments[index]
        duration, step = float(max(goal - origin, 1)), max((goal - origin) // MOST_FRAMES, 1)
        movement = Movement(origin, goal, step, tracks.hand[origin], tracks.hand[goal], duration)
        follow(tracks, table_height, movement, first, states, fillings, paths)
        for k in range(len(power)):
            last = first[k + 1] - 1
            for f in range(len(fillings)):
                ended = np.log(paths.density[f, last + 1] * states.leave[last])
                ratio = step * power[k] * (paths.logs[f, k] + ended)
                if ratio > ratios[index, k]:
                    ratios[index, k], filled[index, k] = ratio, f
    return ratios, filled


@njit(cache=True, nogil=True)
def room_for(states: States, n_fillings: int) -> Paths:
    """Return room for the paths of all fillings."""
    n_features, n_states = states.mean.shape
    return Paths(
        np.zeros((n_fillings, n_states + 1)),
        np.zeros((n_fillings, len(states.power))),
        np.zeros(n_states + 1),
        np.ones(n_states),
        np.ones(n_states),
        np.zeros(n_features),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def follow(
    tracks: Tracks,
    table_height: float,
    movement: Movement,
    first: Indices,
    states: States,
    fillings: Indices,
    paths: Paths,
) -> None:
    """Find the best paths of some classes, those between ``first``'s, through a movement's frames."""
    density, logs, moved, common, misfit, x = paths
    low, high = first[0], first[-1]
    density[:], moved[:], logs[:] = 0.0, 0.0, 0.0
    rotation = alignment(movement.start, movement.goal)
    for frame in range(movement.origin, movement.through + 1, movement.step):
        _observe_movement(tracks, table_height, movement, frame, rotation, x)
        common[low:high] = 1.0
        _add_misfit(x, 0, N_OF_MOVEMENT, low, high, states, common)
        for f in range(len(fillings)):
            misfit[low:high] = common[low:high]
            _observe_objects(tracks, frame, fillings, f, x)
            _add_misfit(x, N_OF_MOVEMENT, len(x), low, high, states, misfit)
            if frame == movement.origin:
                for begin in first[:-1]:
                    density[f, begin + 1] = 1.0 / misfit[begin]
            else:
                _advance(density, f, moved, misfit, low, high, states)
            _scale_back(density, f, first, logs)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_misfit(
    x: Floats, first: int, stop: int, low: int, high: int, states: States, misfit: Floats
) -> None:
    """Multiply by one over each state's density of some features; a missing value changes nothing."""
    mean, base, slope = states.mean, states.base, states.slope
    for d in range(first, stop):
        value = x[d]
        if not np.isnan(value):
            for s in range(low, high):
                off = value - mean[d, s]
                misfit[s] *= base[d, s] + slope[d, s] * off * off


@njit(cache=True, nogil=True, error_model="numpy")
def _advance(
    density: Floats, f: int, moved: Floats, misfit: Floats, low: int, high: int, states: States
) -> None:
    """Move the best path to each state on by a frame; that of state s stands at s + 1."""
    stay, enter = states.stay, states.enter
    for s in range(low, high):
        stayed, entered = density[f, s + 1] * stay[s], density[f, s] * enter[s]
        moved[s + 1] = (stayed if stayed > entered else entered) / misfit[s]
    for s in range(low, high):
        density[f, s + 1] = moved[s + 1]


@njit(cache=True, nogil=True)
def _scale_back(density: Floats, f: int, first: Indices, logs: Floats) -> None:
    """Bring each class's densities back to 1 before they leave the range of numbers; log what came off."""
    for k in range(len(first) - 1):
        best = 0.0
        for s in range(first[k] + 1, first[k + 1] + 1):
            best = max(best, density[f, s])
        if best > 0.0 and (best < _LOW or best > _HIGH):
            for s in range(first[k] + 1, first[k + 1] + 1):
                density[f, s] /= best
            logs[f, k] += np.log(best)


@njit(cache=True, nogil=True)
def _observe_movement(
    tracks: Tracks, table_height: float, movement: Movement, frame: int, rotation: Floats, x: Floats
) -> None:
    """Write the movement's features of one frame into x; where the hand is not seen nor is the phase."""
    hand, start, goal = tracks.hand, movement.start, movement.goal
    phase = (frame - movement.origin) / movement.duration
    dx = hand[frame, 0] - start[0] * (1.0 - phase) - goal[0] * phase
    dy = hand[frame, 1] - start[1] * (1.0 - phase) - goal[1] * phase
    dz = hand[frame, 2] - start[2] * (1.0 - phase) - goal[2] * phase
    for axis in range(3):
        x[axis] = rotation[axis, 0] * dx + rotation[axis, 1] * dy + rotation[axis, 2] * dz
    x[3] = hand[frame, 2] - table_height
    x[PACE] = tracks.pace[frame]
    x[PHASE] = np.nan if np.isnan(dx) else phase


@njit(cache=True, nogil=True)
def _observe_objects(tracks: Tracks, frame: int, fillings: Indices, f: int, x: Floats) -> None:
    """Write the features of the objects in their roles into x."""
    for r in range(fillings.shape[1]):
        index = fillings[f, r]
        gx = tracks.objects[index, frame, 0] - tracks.hand[frame, 0]
        gy = tracks.objects[index, frame, 1] - tracks.hand[frame, 1]
        gz = tracks.objects[index, frame, 2] - tracks.hand[frame, 2]
        x[N_OF_MOVEMENT + N_OF_ROLE * r] = np.sqrt(gx * gx + gy * gy + gz * gz)
        x[N_OF_MOVEMENT + N_OF_ROLE * r + 1] = tracks.paces[index, frame]
