"""Candidate boundaries, and the best division of all that lies before each of them.

A *place* is reached by rest or by an action that ends there, and the best division of each kind is kept: its
value, what came before, and where its last action ended. A division is followed back from action to action.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from app.motion.search import Found
from app.motion.state import State
from app.motion.trajectory import Floats, Indices

RESTED, MOVED = 0, 1
"""How a place is reached: by rest, or by an action."""

_ARRAYS = ("points", "values", "own", "origin", "before", "end")


class Places:
    """The places of a stream, the first at point ``origin``; ``capacity`` of them are kept.

    Places are counted from the oldest that is kept. No division goes back beyond the last final boundary.
    pause: what beginning a rest costs [nat].
    """

    def __init__(self, origin: int, capacity: int, pause: float) -> None:
        self._pause = pause
        self._all_points: Indices = np.full(capacity, origin, dtype=np.int64)
        self._values = np.full((2, capacity), -np.inf)
        self._values[RESTED, 0] = 0.0
        self._own = np.full((2, capacity), -np.inf)
        self._origin: Indices = np.zeros(capacity, dtype=np.int64)
        self._before: Indices = np.zeros((2, capacity), dtype=np.int64)
        self._end: Indices = np.zeros((2, capacity), dtype=np.int64)
        self._boundary, self._n = 0, 1

    @property
    def points(self) -> Indices:
        """The (n_places,) points of the places."""
        return self._all_points[: self._n]

    @property
    def newest(self) -> int:
        """The newest place."""
        return self._n - 1

    @property
    def boundary(self) -> int:
        """The place where the last final action ended."""
        return self._boundary

    @property
    def worth(self) -> Floats:
        """The (n_places,) values of the best divisions up to each place, -inf where there is none [nat]."""
        return _worth(self._values, self._n, self._boundary)

    @property
    def rested(self) -> float:
        """The value of the best division that ends in rest at the newest place [nat]."""
        return float(self._values[RESTED, self.newest])

    def add(self, point: int, rest: float) -> None:
        """Add a place, reached by rest whose value since the place before is ``rest`` [nat]."""
        new = self._n
        self._all_points[new], self._n = point, new + 1
        self._own[:, new] = rest, -np.inf
        self._reach(new)

    def offer(self, origins: Indices, values: Floats) -> None:
        """Let actions that end at the newest place compete for it.

        origins: (n,) places where they begin; values: (n,) of them alone [nat].
        """
        totals = self._values[:, origins].max(axis=0) + values
        best, new = int(totals.argmax()), self.newest
        if totals[best] > self._values[MOVED, new]:
            self._own[MOVED, new], self._origin[new] = values[best], origins[best]
            self._reach(new)

    def _reach(self, place: int) -> None:
        """Find the best ways to a place from what is known of those before."""
        _reach(
            place, self._boundary, self._pause, self._values, self._own, self._origin, self._before, self._end
        )

    def ends(self, place: int) -> list[int]:
        """Return the places where the actions of the best division up to a place end, the first first."""
        ends = []
        end = int(self._end[self._values[:, place].argmax(), place])
        while end > self._boundary:
            ends.append(end)
            end = int(self._end[self._before[MOVED, end], self._origin[end]])
        return ends[::-1]

    def action(self, end: int) -> Found:
        """Return the action that ends at a place."""
        return Found(int(self._all_points[self._origin[end]]), int(self._all_points[end]))

    def settle(self, end: int) -> None:
        """Make the action that ends at a place final: all later places are reached through it."""
        self._boundary, self._values[RESTED, end] = end, -np.inf
        for place in range(end + 1, self._n):
            self._reach(place)

    def state(self) -> State:
        """Return what is known of the places."""
        arrays = zip(_ARRAYS, self._arrays(), strict=True)
        return {"boundary": np.array(self._boundary)} | {
            name: array[..., : self._n].copy() for name, array in arrays
        }

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self._boundary, self._n = int(state["boundary"]), len(state["points"])
        for name, array in zip(_ARRAYS, self._arrays(), strict=True):
            array[..., : self._n] = state[name]

    def _arrays(self) -> tuple[Floats | Indices, ...]:
        return self._all_points, self._values, self._own, self._origin, self._before, self._end

    @property
    def is_full(self) -> bool:
        """Whether no place can be added."""
        return self._n == len(self._all_points)

    def forget(self, point: int) -> None:
        """Forget the places before the last final boundary, and those before a point."""
        drop = max(self._boundary, int(np.searchsorted(self.points, point)))
        kept = self._n - drop
        for array in self._arrays():
            array[..., :kept] = array[..., drop : self._n].copy()
        self._origin[:kept] -= drop
        self._end[:, :kept] -= drop
        self._boundary, self._n = 0, kept


@njit(cache=True, nogil=True)
def _worth(values: Floats, n: int, boundary: int) -> Floats:
    worth = np.full(n, -np.inf)
    for place in range(boundary, n):
        worth[place] = max(values[RESTED, place], values[MOVED, place])
    return worth


@njit(cache=True, nogil=True)
def _reach(
    place: int,
    boundary: int,
    pause: float,
    values: Floats,
    own: Floats,
    origins: Indices,
    before: Indices,
    end: Indices,
) -> None:
    rested, paused = values[RESTED, place - 1], values[MOVED, place - 1] - pause
    way, origin = (MOVED if paused > rested else RESTED), origins[place]
    is_possible = boundary <= origin < place and own[MOVED, place] > -np.inf
    moved = MOVED if values[MOVED, origin] > values[RESTED, origin] else RESTED
    before[RESTED, place], before[MOVED, place] = way, moved if is_possible else RESTED
    end[RESTED, place], end[MOVED, place] = end[way, place - 1], place
    values[RESTED, place] = max(rested, paused) + own[RESTED, place]
    values[MOVED, place] = values[moved, origin] + own[MOVED, place] if is_possible else -np.inf
