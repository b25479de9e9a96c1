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
"""Frames between two looks at the range of the costs, which leave room for absurd ones."""

_LOW, _HIGH = 1e-90, 1e90  # costs beyond are halved until they are about 1
_LN2 = math.log(2.0)
_HEIGHT = 3  # column of the height, behind the deviation
_ORIGIN, _THROUGH, _PHASE_STEP, _START, _WAY, _ROTATION, _ROWS = 0, 1, 2, 3, 6, 9, 18


class States(NamedTuple):
    """The states of all classes, one after the other, in units of the background.

    All densities and probabilities are raised to the power ``1 / power`` of their class, in which Student's t
    is one over a quadratic: of feature d in state s it costs ``base * (1 + (root * x - centre)^2)``.
    first: (n_classes + 1,) where each class begins; power: (n_classes,); root, centre, base: (n_features,
    n_columns), a column for each state and idle ones up to a multiple of LANES; stay, enter: (n_columns,)
    what it costs to stay and to come from the state before, or to begin in the first of a class, with the
    bases of deviation and phase; unseen: (n_columns,) what takes these bases off again; leave: (n_columns,)
    what it costs to leave; ones: (LANES,).
    """

    first: Indices
    power: Floats
    root: Floats
    centre: Floats
    base: Floats
    stay: Floats
    enter: Floats
    unseen: Floats
    leave: Floats
    ones: Floats


class Lanes(NamedTuple):
    """Movements side by side, and room to follow them in.

    movement: (n, LANES) what is fixed of each; cost: (n_fillings, n_states + n_classes, LANES) of the best
    path to each state, before those of a class what beginning costs; halved: (n_fillings, n_classes, LANES)
    how often; ended: as many logarithms of what the paths to the last states cost at a lane's last frame
    [nat]; staying, entering: (n_fillings, n_columns) what the context of a frame costs who stays in a state
    and who enters it; spare: (1, LANES).
    """

    movement: Floats
    cost: Floats
    ended: Floats
    halved: Floats
    staying: Floats
    entering: Floats
    spare: Floats


@njit(cache=True, nogil=True)
def lanes_for(states: States, n_fillings: int) -> Lanes:
    """Return room for movements."""
    n_states, n_classes = states.first[-1], len(states.power)
    return Lanes(
        _aligned(_ROWS).reshape((_ROWS, LANES)),
        _aligned(n_fillings * (n_states + n_classes)).reshape((n_fillings, n_states + n_classes, LANES)),
        np.full((n_fillings, n_classes, LANES), np.inf),
        np.zeros((n_fillings, n_classes, LANES)),
        np.ones((n_fillings, states.root.shape[1])),
        np.ones((n_fillings, states.root.shape[1])),
        _aligned(1).reshape((1, LANES)),
    )


@njit(cache=True, nogil=True)
def _aligned(n_rows: int) -> Floats:
    """Return (n_rows * LANES,) ones that begin with a line of the cache: a row across two costs twice."""
    room = np.ones((n_rows + 1) * LANES)
    skipped = -room.ctypes.data // 8 % LANES
    return room[skipped : skipped + n_rows * LANES]


@njit(cache=True, nogil=True, error_model="numpy")
def put(lanes: Lanes, lane: int, span: tuple[int, int], start: Floats, goal: Floats, duration: float) -> None:
    """Put a movement into a lane.

    span: its first and last frame; start, goal: (3,) [m], so many frames apart.
    """
    movement = lanes.movement
    movement[_ORIGIN, lane], movement[_THROUGH, lane] = span
    movement[_PHASE_STEP, lane] = 1.0 / duration
    for axis in range(3):
        movement[_START + axis, lane], movement[_WAY + axis, lane] = start[axis], goal[axis] - start[axis]
    rotation = axes(goal[0] - start[0], goal[1] - start[1], goal[2] - start[2])
    for row in range(3):
        for column in range(3):
            movement[_ROTATION + 3 * row + column, lane] = rotation[row][column]


@njit(cache=True, nogil=True)
def begin(lanes: Lanes) -> None:
    """Make ready to follow what is in the lanes."""
    lanes.cost[:], lanes.ended[:], lanes.halved[:] = np.inf, np.inf, 0.0


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
    hand, first, movement, cost = tracks.hand, states.first, lanes.movement, lanes.cost
    staying, entering, n_fillings, n_rows = lanes.staying, lanes.entering, len(cost), cost.shape[1]
    blocks = first[classes[0]] // LANES, (first[classes[-1] + 1] - 1) // LANES + 1
    opened, ending = movement[_ORIGIN].max() + 2 * frames[2], movement[_THROUGH].min()
    for frame in range(*frames):
        _observe_context(staying, entering, tracks, table_height, frame, blocks, states, fillings)
        if frame < opened:
            _open(lanes, frame, frames[2], classes, first)
        is_seen, ones = not np.isnan(hand[frame, 0]), load(states.ones, 0)
        phase = (load(movement, _ORIGIN) * -1.0 + frame) * load(movement, _PHASE_STEP)
        x, y, z = _deviation(movement, hand, frame, phase)
        for k in classes:
            own = load(cost, first[k + 1] + k)
            for s in range(first[k + 1] - 1, first[k] - 1, -1):
                if is_seen:
                    across = _of(y, 1, s, states, ones) * _of(z, 2, s, states, ones)
                    misfit = (_of(x, 0, s, states, ones) * _of(phase, PHASE, s, states, ones)) * across
                else:
                    misfit = ones * states.unseen[s]
                row, before = s + k + 1, load(cost, s + k)
                store(cost, row, least(own * staying[0, s], before * entering[0, s]) * misfit)
                own = before
                for f in range(1, n_fillings):
                    row += n_rows
                    stayed, entered = load(cost, row) * staying[f, s], load(cost, row - 1) * entering[f, s]
                    store(cost, row, least(stayed, entered) * misfit)
        if (frame // frames[2]) % SCALE_EVERY == 0:
            for k in classes:
                for f in range(n_fillings):
                    _halve(lanes, f, k, first[k] + k + 1, first[k + 1] + k + 1)
        if frame >= ending:
            _end(lanes, frame, classes, first)


@njit(cache=True, nogil=True, inline="always")
def _of(value: Vector, column: int, s: int, states: States, ones: Vector) -> Vector:
    """Return what a feature costs in a state, but for its base."""
    off = value * float(states.root[column, s]) - float(states.centre[column, s])
    return off * off + ones


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
def _open(lanes: Lanes, frame: int, step: int, classes: Indices, first: Indices) -> None:
    """Write what beginning costs: nothing to the lanes that begin now."""
    for lane in range(LANES):
        gone = frame - lanes.movement[_ORIGIN, lane]
        lanes.spare[0, lane] = 1.0 if 0 <= gone < step else np.inf
    begun, n_rows = load(lanes.spare, 0), lanes.cost.shape[1]
    for k in classes:
        for f in range(len(lanes.cost)):
            store(lanes.cost, f * n_rows + first[k] + k, begun)


@njit(cache=True, nogil=True, inline="always")
def _end(lanes: Lanes, frame: int, classes: Indices, first: Indices) -> None:
    """Keep what the lanes that end now cost."""
    for lane in range(LANES):
        if lanes.movement[_THROUGH, lane] == frame:
            for k in classes:
                for f in range(len(lanes.cost)):
                    lanes.ended[f, k, lane] = _log_of(
                        lanes.cost[f, first[k + 1] + k, lane], lanes.halved[f, k, lane]
                    )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _observe_context(
    staying: Floats,
    entering: Floats,
    tracks: Tracks,
    table_height: float,
    frame: int,
    blocks: tuple[int, int],
    states: States,
    fillings: Indices,
) -> None:
    """Write what height, paces and distances of a frame cost who stays and who enters.

    blocks: the rows [low, high) of LANES states that are asked for.
    """
    hand, objects, n_blocks = tracks.hand, tracks.objects, states.root.shape[1] // LANES
    for f in range(len(fillings)):
        for block in range(blocks[0], blocks[1]):
            cost = _of_block(hand[frame, 2] - table_height, _HEIGHT * n_blocks + block, states)
            cost = cost * _of_block(tracks.pace[frame], PACE * n_blocks + block, states)
            for r in range(fillings.shape[1]):
                index, row = fillings[f, r], (N_OF_MOVEMENT + N_OF_ROLE * r) * n_blocks + block
                dx = objects[index, frame, 0] - hand[frame, 0]
                dy = objects[index, frame, 1] - hand[frame, 1]
                dz = objects[index, frame, 2] - hand[frame, 2]
                cost = cost * _of_block(np.sqrt(dx * dx + dy * dy + dz * dz), row, states)
                cost = cost * _of_block(tracks.paces[index, frame], row + n_blocks, states)
            store(staying, f * n_blocks + block, cost * load(states.stay, block))
            store(entering, f * n_blocks + block, cost * load(states.enter, block))


@njit(cache=True, nogil=True, inline="always")
def _of_block(value: float, row: int, states: States) -> Vector:
    """Return what a value costs in LANES states; one that is missing costs nothing."""
    if np.isnan(value):
        return load(states.ones, 0)
    off = load(states.root, row) * value - load(states.centre, row)
    return (off * off + load(states.ones, 0)) * load(states.base, row)


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
            best_of, exponent = lanes.spare[0, lane], 0
            if best_of < np.inf and not _LOW <= best_of <= _HIGH:
                exponent = math.frexp(best_of)[1]
            lanes.spare[0, lane] = math.ldexp(1.0, -exponent)
            lanes.halved[f, k, lane] += exponent
        factor = load(lanes.spare, 0)
        for row in range(low, high):
            store(cost, offset + row, load(cost, offset + row) * factor)


@njit(cache=True, nogil=True)
def _log_of(cost: float, halved: float) -> float:
    """Return the logarithm of a cost that was halved so often [nat]."""
    if cost == np.inf:
        return np.inf
    rest, exponent = math.frexp(cost)
    return math.log(rest) + (exponent + halved) * _LN2


@njit(cache=True, nogil=True)
def least_log(lanes: Lanes, lane: int, k: int, states: States) -> float:
    """Return the logarithm of what the best path of a lane to any state of a class costs [nat]."""
    best = np.inf
    for f in range(len(lanes.cost)):
        cost = lanes.cost[f, states.first[k] + k + 1 : states.first[k + 1] + k + 1, lane].min()
        best = min(best, _log_of(cost, lanes.halved[f, k, lane]))
    return best


@njit(cache=True, nogil=True, error_model="numpy")
def most(
    lanes: Lanes, tracks: Tracks, table_height: float, frame: int, states: States, fillings: Indices
) -> Floats:
    """Return (n_classes,) what a frame can count at most, whatever movement it is part of [nat]."""
    blocks, found = (0, states.root.shape[1] // LANES), np.full(len(states.power), -np.inf)
    staying, entering = lanes.staying, lanes.entering
    _observe_context(staying, entering, tracks, table_height, frame, blocks, states, fillings)
    is_seen = not np.isnan(tracks.hand[frame, 0])
    for k in range(len(found)):
        best = np.inf
        for f in range(len(fillings)):
            for s in range(states.first[k], states.first[k + 1]):
                best = min(best, min(staying[f, s], entering[f, s]) * (1.0 if is_seen else states.unseen[s]))
        found[k] = -states.power[k] * math.log(best)
    return found
