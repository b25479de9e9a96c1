"""Movements followed side by side: features and Viterbi in one compiled pass (Eq. (1) of the paper).

The end points of a movement move its deviation and its phase, so each movement is a pass of its own. But
many candidates run through the same frames, and are followed in *lanes*: each instruction of the processor
works for all of them, and what hangs on no end point, the *context*, is worked out once for all.

A path starts in the first state of a class. A missing value (NaN) is summed out: it adds nothing to any
state. A path has a *cost*, one over its density: the best path costs the least, and no frame needs a
division.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from app.motion.conditioning import Tracks
from app.motion.features import axes
from app.motion.model import N_OF_MOVEMENT, N_OF_ROLE, PACE, PHASE
from app.motion.simd import LANES, Vector, least, load, store, strays
from app.motion.trajectory import Floats, Indices

SCALE_EVERY = 4
"""Frames between two looks at the range of the costs: an absurd one multiplies them by up to 1e50."""

_LOW, _HIGH = 1e-90, 1e90  # costs beyond are halved until they are about 1
_LN2 = math.log(2.0)
_HEIGHT = 3  # column of the height, behind the deviation
_ORIGIN, _PHASE_STEP, _START, _WAY, _ROTATION, _ONE, _ROWS = 0, 1, 2, 5, 8, 17, 18


class States(NamedTuple):
    """The states of all classes, one after the other, in units of the background.

    All densities and probabilities are raised to the power ``1 / power`` of their class, in which Student's t
    is one over a quadratic: of feature d in state s it costs ``base + slope * (x - mean)^2``.
    first: (n_classes + 1,) where each class begins; power: (n_classes,); mean, base, slope: (n_features,
    n_columns), a column for each state and idle ones up to a multiple of LANES; stay, leave: (n_states,) what
    it costs to stay and to leave; enter: (n_states,) what it costs to come from the state before, 1 for the
    first of a class; least: (n_states,) what deviation and phase cost if they are those of the state.
    """

    first: Indices
    power: Floats
    mean: Floats
    base: Floats
    slope: Floats
    stay: Floats
    enter: Floats
    leave: Floats
    least: Floats


class Lanes(NamedTuple):
    """Movements side by side, and room to follow them in.

    movement: (n, LANES) what is fixed of each; cost: (n_fillings, n_states + n_classes, LANES) of the best
    path to each state, before those of a class what beginning costs; halved: (n_fillings, n_classes, LANES)
    how often; context: (n_fillings, n_columns) what the context of a frame costs; spare: (1, LANES).
    """

    movement: Floats
    cost: Floats
    halved: Floats
    context: Floats
    spare: Floats


@njit(cache=True, nogil=True)
def lanes_for(states: States, n_fillings: int) -> Lanes:
    """Return room for movements."""
    n_states, n_classes = len(states.stay), len(states.power)
    return Lanes(
        _aligned(_ROWS).reshape((_ROWS, LANES)),
        _aligned(n_fillings * (n_states + n_classes)).reshape((n_fillings, n_states + n_classes, LANES)),
        np.zeros((n_fillings, n_classes, LANES)),
        np.ones((n_fillings, states.mean.shape[1])),
        _aligned(1).reshape((1, LANES)),
    )


@njit(cache=True, nogil=True)
def _aligned(n_rows: int) -> Floats:
    """Return (n_rows * LANES,) ones that begin with a line of the cache: a row across two costs twice."""
    room = np.ones((n_rows + 1) * LANES)
    skipped = -room.ctypes.data // 8 % LANES
    return room[skipped : skipped + n_rows * LANES]


@njit(cache=True, nogil=True, error_model="numpy")
def put(lanes: Lanes, lane: int, origin: int, start: Floats, goal: Floats, duration: float) -> None:
    """Put a movement into a lane: from its first frame, start and goal (3,) [m] so many frames apart."""
    movement = lanes.movement
    movement[_ORIGIN, lane], movement[_PHASE_STEP, lane] = origin, 1.0 / duration
    for axis in range(3):
        movement[_START + axis, lane], movement[_WAY + axis, lane] = start[axis], goal[axis] - start[axis]
    rotation = axes(goal[0] - start[0], goal[1] - start[1], goal[2] - start[2])
    for row in range(3):
        for column in range(3):
            movement[_ROTATION + 3 * row + column, lane] = rotation[row][column]


@njit(cache=True, nogil=True)
def begin(lanes: Lanes) -> None:
    """Make ready to follow what is in the lanes."""
    lanes.cost[:], lanes.halved[:] = np.inf, 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def follow(
    lanes: Lanes,
    tracks: Tracks,
    table_height: float,
    frames: tuple[int, int, int],
    classes: Indices,
    states: States,
    fillings: Indices,
) -> None:
    """Move the best paths of some classes, in their order, on through frames [from, to), every so many.

    table_height [m]; fillings: (n_fillings, n_roles) the object in each role. A lane begins with the first
    frame looked at that is not before its origin.
    """
    hand, first, movement, cost, context = (
        tracks.hand,
        states.first,
        lanes.movement,
        lanes.cost,
        lanes.context,
    )
    stay, enter, n_fillings, n_rows = states.stay, states.enter, len(cost), cost.shape[1]
    low, high = first[classes[0]] // LANES, (first[classes[-1] + 1] - 1) // LANES + 1
    for frame in range(*frames):
        _observe_context(context, tracks, table_height, frame, low, high, states, fillings)
        _open(lanes, frame, frames[2])
        begun, misfit = load(lanes.spare, 0), load(movement, _ONE)
        is_seen = not np.isnan(hand[frame, 0])
        phase = (load(movement, _ORIGIN) * -1.0 + frame) * load(movement, _PHASE_STEP)
        x, y, z = _deviation(movement, hand, frame, phase)
        for k in classes:
            for f in range(n_fillings):
                store(cost, f * n_rows + first[k] + k, begun)
            for s in range(first[k + 1] - 1, first[k] - 1, -1):
                if is_seen:
                    across = _of(y, 1, s, states) * _of(z, 2, s, states)
                    misfit = _of(x, 0, s, states) * across * _of(phase, PHASE, s, states)
                row = s + k + 1
                cheaper = least(load(cost, row) * stay[s], load(cost, row - 1) * enter[s])
                store(cost, row, cheaper * (misfit * context[0, s]))
                for f in range(1, n_fillings):
                    row += n_rows
                    cheaper = least(load(cost, row) * stay[s], load(cost, row - 1) * enter[s])
                    store(cost, row, cheaper * (misfit * context[f, s]))
            if (frame // frames[2]) % SCALE_EVERY == 0:
                for f in range(n_fillings):
                    _halve(lanes, f, k, first[k] + k + 1, first[k + 1] + k + 1)


@njit(cache=True, nogil=True, inline="always")
def _of(value: Vector, column: int, s: int, states: States) -> Vector:
    """Return what a feature costs in a state."""
    off = value - float(states.mean[column, s])
    return off * off * float(states.slope[column, s]) + float(states.base[column, s])


@njit(cache=True, nogil=True, inline="always")
def _deviation(movement: Floats, hand: Floats, frame: int, phase: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the deviation of the hand [m]."""
    dx = load(movement, _START) * -1.0 + hand[frame, 0] - load(movement, _WAY) * phase
    dy = load(movement, _START + 1) * -1.0 + hand[frame, 1] - load(movement, _WAY + 1) * phase
    dz = load(movement, _START + 2) * -1.0 + hand[frame, 2] - load(movement, _WAY + 2) * phase
    return (
        load(movement, _ROTATION) * dx
        + load(movement, _ROTATION + 1) * dy
        + load(movement, _ROTATION + 2) * dz,
        load(movement, _ROTATION + 3) * dx
        + load(movement, _ROTATION + 4) * dy
        + load(movement, _ROTATION + 5) * dz,
        load(movement, _ROTATION + 6) * dx
        + load(movement, _ROTATION + 7) * dy
        + load(movement, _ROTATION + 8) * dz,
    )


@njit(cache=True, nogil=True, inline="always")
def _open(lanes: Lanes, frame: int, step: int) -> None:
    """Write what beginning costs: nothing to the lanes that begin now."""
    for lane in range(LANES):
        gone = frame - lanes.movement[_ORIGIN, lane]
        lanes.spare[0, lane] = 1.0 if 0 <= gone < step else np.inf


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _observe_context(
    context: Floats,
    tracks: Tracks,
    table_height: float,
    frame: int,
    low: int,
    high: int,
    states: States,
    fillings: Indices,
) -> None:
    """Write what height, paces and distances of a frame cost, in rows [low, high) of LANES states."""
    hand, objects, n_blocks = tracks.hand, tracks.objects, states.mean.shape[1] // LANES
    for f in range(len(fillings)):
        context[f, LANES * low : LANES * high] = 1.0
        into = f * n_blocks
        _add(context, into, hand[frame, 2] - table_height, _HEIGHT, low, high, n_blocks, states)
        _add(context, into, tracks.pace[frame], PACE, low, high, n_blocks, states)
        for r in range(fillings.shape[1]):
            index, column = fillings[f, r], N_OF_MOVEMENT + N_OF_ROLE * r
            dx = objects[index, frame, 0] - hand[frame, 0]
            dy = objects[index, frame, 1] - hand[frame, 1]
            dz = objects[index, frame, 2] - hand[frame, 2]
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            _add(context, into, distance, column, low, high, n_blocks, states)
            _add(context, into, tracks.paces[index, frame], column + 1, low, high, n_blocks, states)


@njit(cache=True, nogil=True, inline="always")
def _add(
    context: Floats, into: int, value: float, column: int, low: int, high: int, n_blocks: int, states: States
) -> None:
    if not np.isnan(value):
        for block in range(low, high):
            row = column * n_blocks + block
            off = load(states.mean, row) * -1.0 + value
            cost = off * off * load(states.slope, row) + load(states.base, row)
            store(context, into + block, load(context, into + block) * cost)


@njit(cache=True, nogil=True, inline="always")
def _halve(lanes: Lanes, f: int, k: int, low: int, high: int) -> None:
    """Halve the costs of a class, rows [low, high), before they leave the range of numbers, and count it.

    Halving is exact, so a path costs the same whenever it is done.
    """
    cost, offset = lanes.cost, f * lanes.cost.shape[1]
    best = load(cost, offset + low)
    for row in range(low + 1, high):
        best = least(best, load(cost, offset + row))
    if strays(best, _LOW, _HIGH):
        store(lanes.spare, 0, best)
        for lane in range(LANES):
            if lanes.spare[0, lane] < np.inf:
                exponent = math.frexp(lanes.spare[0, lane])[1]
                for row in range(low, high):
                    cost[f, row, lane] = math.ldexp(cost[f, row, lane], -exponent)
                lanes.halved[f, k, lane] += exponent


@njit(cache=True, nogil=True)
def log_of(cost: float, halved: float) -> float:
    """Return the logarithm of a cost that was halved so often [nat]."""
    rest, exponent = math.frexp(cost)
    return math.log(rest) + (exponent + halved) * _LN2


@njit(cache=True, nogil=True)
def least_log(lanes: Lanes, lane: int, k: int, states: States) -> float:
    """Return the logarithm of what the best path of a lane to any state of a class costs [nat]."""
    best = np.inf
    for f in range(len(lanes.cost)):
        cost = lanes.cost[f, states.first[k] + k + 1 : states.first[k + 1] + k + 1, lane].min()
        if cost < np.inf:
            best = min(best, log_of(cost, lanes.halved[f, k, lane]))
    return best


@njit(cache=True, nogil=True, error_model="numpy")
def most(
    context: Floats, tracks: Tracks, table_height: float, frame: int, states: States, fillings: Indices
) -> Floats:
    """Return (n_classes,) what a frame can count at most, whatever movement it is part of [nat].

    context: (n_fillings, n_columns) room to work in.
    """
    n_blocks, found = states.mean.shape[1] // LANES, np.full(len(states.power), -np.inf)
    _observe_context(context, tracks, table_height, frame, 0, n_blocks, states, fillings)
    is_seen = not np.isnan(tracks.hand[frame, 0])
    for k in range(len(found)):
        best = np.inf
        for f in range(len(fillings)):
            for s in range(states.first[k], states.first[k + 1]):
                best = min(best, context[f, s] * (states.least[s] if is_seen else 1.0))
        found[k] = -states.power[k] * math.log(best)
    return found
