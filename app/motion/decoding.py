"""Segmental Viterbi: the best division of all that was seen into actions and rest, decided once it stands.

The search is exact over *places*, candidate boundaries ``SPACING`` apart: the segments between them are
looked at, and each place keeps the value of the best division of all that lies before. What is under way at
the newest place counts what it may become (``foresight``), so divisions can be compared while an action
lasts.

A segment is final once every surviving division has it, up to ``NEAR`` at its ends: all within
``SURVIVING`` of the best. A bound in stream time forces what stays open longer: once it has passed, what the
leading division has is final. The search sees only ``Parts``, so that it can be tested against a hand-written
table. It works frame by frame and a bounded amount for each: what it finds, and after which frame, depends
on nothing but the frames. Points are counted from 0 over the whole stream.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit

from app.motion.criterion import PAUSE, START
from app.motion.foresight import Outlook
from app.motion.model import Model
from app.motion.places import Places
from app.motion.scoring import MOST_FRAMES
from app.motion.search import SPACING, Found, bounds_of
from app.motion.state import State, gathered, scatter
from app.motion.trajectory import Floats, Indices

FINENESS = 50
"""Where a segment began is looked for to a share of one so many-th of its length."""

SURVIVING = 7.0
"""A division a thousand times less likely than the best will not catch up [nat]."""

SETTLED = 0.2
"""Where a boundary lies exactly shows this long after it [s]."""

NEAR = 0.3
"""Divisions agree on a segment whose ends lie no farther apart than this [s]."""

BIN = 0.2
"""Of the places within so much time one stands for all where a movement may have begun [s]."""

YOUNGEST = 0.08
"""A movement that began later than this cannot be told from rest [s]."""

ONSET = 0.6
"""A movement has most likely begun where it gains the most if a frame of it counts this share of typical."""

UNKNOWN = -0.5
"""A frame of a movement of no class counts this share of a typical one: as much worse than the background as
half an action is better."""

CONVERGE_EVERY = 2
"""Places between two attempts to decide."""

WORK_PER_FRAME = 40_000
"""Frames of candidate segments that are looked at for each frame that arrives."""


class Parts(Protocol):
    """What a division consists of."""

    @property
    def typical(self) -> float:
        """What a frame of a typical action counts [nat]."""

    def seen(self, point: int) -> bool:
        """Return whether the hand was seen at a point."""

    def best(self, segments: Indices, before: Floats, least: Floats) -> Floats:
        """Return the (n,) values of (n, 2) segments, ``least`` (n,) where that is more [nat].

        before: (n,) what a division has where they begin. A segment that cannot give the best division of
        all these may have ``least``.
        """

    def rest(self, start: int, stop: int) -> float:
        """Return the value of points ``start..stop-1`` at rest [nat]."""

    def outlook(self, origin: int, through: int) -> Outlook | None:
        """Return what a movement under way since ``origin`` may become, None if it cannot be one."""


@dataclass(frozen=True)
class Limits:
    """What the search goes by, in points of the internal rate [Hz]; see the constants of this module.

    shortest, longest: lengths of a segment; bound: how long after its end a segment stays open at most.
    """

    rate: float
    shortest: int
    longest: int
    bound: int

    def points(self, seconds: float) -> int:
        """Return so many seconds in points, at least one."""
        return max(round(seconds * self.rate), 1)

    @property
    def spacing(self) -> int:
        """Points between two places."""
        return self.points(SPACING)

    @property
    def horizon(self) -> int:
        """How long a point matters."""
        return 2 * self.longest + 4 * self.spacing


def limits_of(model: Model, bound: float | None = None) -> Limits:
    """Return the limits that a model's demonstrations imply; bound [s]: by default the longest segment."""
    rate, bounds = model.features.rate, bounds_of(model)
    forced = bounds.longest if bound is None else min(round(bound * rate), bounds.longest)
    return Limits(rate, bounds.shortest, bounds.longest, forced)


class Alternative(NamedTuple):
    """A division that ends in something under way: a movement with an outlook, or rest without one.

    value: of the whole; base: without what is under way; unknown: of the whole if what is under way is of no
    class [nat]; place, point: where it begins.
    """

    value: float
    base: float
    unknown: float
    place: int
    point: int
    outlook: Outlook | None


class Decoder:
    """Finds the segments of a stream one after the other."""

    def __init__(self, parts: Parts, limits: Limits, origin: int = 0) -> None:
        self._parts, self._limits, self._unknown = parts, limits, UNKNOWN * parts.typical
        self._n_points = origin
        self._places = Places(origin, 2 * (limits.horizon // limits.spacing + 2), PAUSE)
        self._pending: Indices = np.empty(0, dtype=np.int64)
        self._is_open = False

    @property
    def origin(self) -> int:
        """Point before which nothing is needed any more."""
        points = self._places.points
        return max(int(points[self._places.boundary]), int(points[-1]) - self._limits.horizon)

    def frame(self, work: int | None = WORK_PER_FRAME) -> list[Found]:
        """Take one more point; return the segments that are decided now; work: None for all there is."""
        self._n_points += 1
        return self._advance(work)

    def finish(self) -> list[Found]:
        """Return the segments that are left once there are no more points."""
        found, places = self._advance(None), self._places
        if self._n_points - 1 > places.points[-1]:
            self._extend(self._n_points - 1, None)
        ends = places.ends(places.newest)
        for end, after in zip(ends, [*ends[1:], None], strict=False):
            found.append(self._settle(end, None if after is None else places.action(after).start))
        return found

    def alternatives(self, through: int) -> list[Alternative]:
        """Return what may be under way at a point, the best first; what does not survive may be missing.

        Nothing is known where the hand is not seen.
        """
        if not self._parts.seen(through):
            return []
        places, worth = self._places, self._places.worth
        base, point = places.rested, int(places.points[-1])
        best = base + self._parts.rest(point, through)
        found = [Alternative(best, base, -np.inf, places.newest, point, None)]
        for place in self._onsets(through):
            most = self._parts.typical * (through - places.points[place])
            if worth[place] - START + most >= best - SURVIVING:
                begun = self._begun(place, worth, through)
                if begun is not None:
                    found.append(begun)
                    best = max(best, begun.value)
        return sorted(found, key=lambda each: -each.value)

    def state(self) -> State:
        """Return what the points before have left behind."""
        counts = {"n_points": np.array(self._n_points), "is_open": np.array(self._is_open)}
        return counts | {"pending": self._pending} | gathered(places=self._places)

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self._n_points, self._is_open = int(state["n_points"]), bool(state["is_open"])
        self._pending = state["pending"]
        scatter(state, places=self._places)

    def _advance(self, work: int | None) -> list[Found]:
        """Look at places whose points are there, until the work is done."""
        found: list[Found] = []
        while (point := self._next_point()) < self._n_points and (work is None or work > 0):
            spent = self._extend(point, work)
            if work is not None:
                work -= spent
            if not self._is_open and (point // self._limits.spacing) % CONVERGE_EVERY == 0:
                found += self._converge(point)
        return found

    def _next_point(self) -> int:
        newest = int(self._places.points[-1])
        return newest if self._is_open else newest + self._limits.spacing

    def _extend(self, point: int, work: int | None) -> int:
        """Look at segments that end at the newest place, a new one at ``point`` if none is open.

        Return the frames looked at; the place stays open until all segments were.
        """
        if not self._is_open:
            self._open(point)
        lengths = np.minimum(point - self._places.points[self._pending], 2 * MOST_FRAMES)
        n_ready = len(lengths)
        if work is not None:
            n_ready = min(int(np.searchsorted(np.cumsum(lengths), work)) + 1, n_ready)
        ready, self._pending = self._pending[:n_ready], self._pending[n_ready:]
        if len(ready):
            self._look(point, ready)
        self._is_open = len(self._pending) > 0
        return int(lengths[:n_ready].sum()) + 1

    def _open(self, point: int) -> None:
        """Add a place; every place that a segment to it may begin at is pending."""
        places, limits = self._places, self._limits
        if places.is_full:
            places.forget(point - limits.horizon)
        self._pending = _origins(
            places.points, places.worth, point, limits.shortest, limits.longest, limits.spacing
        )
        places.add(point, self._parts.rest(int(places.points[-1]), point))

    def _look(self, point: int, origins: Indices) -> None:
        """Let segments from these places to the newest compete for it."""
        segments = np.column_stack([self._places.points[origins], np.full(len(origins), point)])
        if self._parts.seen(point):
            unknown = self._unknown * (point - segments[:, 0])
            values = self._parts.best(segments, self._places.worth[origins], unknown)
            self._places.offer(origins, values - START)

    def _onsets(self, through: int) -> list[int]:
        """Return the places where what is under way may have begun, the most promising first."""
        limits, places = self._limits, self._places
        onsets: list[int] = _onsets(
            places.points,
            places.worth,
            through,
            (limits.points(YOUNGEST), limits.longest),
            limits.points(BIN),
            ONSET * self._parts.typical,
        ).tolist()
        return onsets

    def _begun(self, place: int, worth: Floats, through: int) -> Alternative | None:
        point, base = int(self._places.points[place]), float(worth[place]) - START
        outlook = self._parts.outlook(point, through)
        if outlook is None:
            return None
        value = base + float(np.logaddexp.reduce(outlook.values, axis=None))
        return Alternative(value, base, base + self._unknown * (through - point), place, point, outlook)

    def _converge(self, through: int) -> list[Found]:
        """Decide what every surviving division has."""
        found: list[Found] = []
        alternatives, places = self.alternatives(through), self._places
        best = alternatives[0].place if alternatives else places.newest
        while ends := places.ends(best):
            if through - places.points[ends[0]] < self._limits.bound:
                if not alternatives or not self._agree(ends[0], alternatives):
                    break
                best = self._refined(alternatives[0], best, through)
                ends = places.ends(best)
                if not ends or through - places.points[ends[0]] < self._limits.points(SETTLED):
                    break
            begins = places.action(ends[1]).start if len(ends) > 1 else int(places.points[best])
            found.append(self._settle(ends[0], begins))
        return found

    def _agree(self, end: int, alternatives: list[Alternative]) -> bool:
        """Return whether all surviving divisions have the segment that ends at a place, or one near it."""
        places, mine = self._places, self._places.action(end)
        worth = places.worth
        for each in alternatives:
            if each.value < alternatives[0].value - SURVIVING:
                break
            if not np.isfinite(worth[each.place]):
                continue
            ends = places.ends(each.place)
            if not ends:
                return False
            off = np.abs(np.subtract(mine[:2], places.action(ends[0])[:2]))
            if off.max() > self._limits.points(NEAR):
                return False
        return True

    def _refined(self, leader: Alternative, place: int, through: int) -> int:
        """Return the place, near that of the leading division, where what is under way best begins."""
        points, worth, limits = self._places.points, self._places.worth, self._limits
        if leader.outlook is None:
            return place
        near = np.abs(points - points[place]) <= limits.points(BIN)
        fits = near & (through - points >= limits.points(YOUNGEST)) & np.isfinite(worth)
        begun = [self._begun(each, worth, through) for each in np.flatnonzero(fits).tolist()]
        best = max((each for each in begun if each is not None), key=lambda each: each.value, default=leader)
        return best.place

    def _settle(self, end: int, next_start: int | None) -> Found:
        """Make the action that ends at a place final; next_start: point where what follows begins."""
        action = self._places.action(end)
        self._places.settle(end)
        return action._replace(is_shared=next_start == action.end)


@njit(cache=True, nogil=True)
def _origins(
    points: Indices, worth: Floats, point: int, shortest: int, longest: int, spacing: int
) -> Indices:
    """Return the places where a segment that ends at a point may begin."""
    found, size = np.empty(len(points), dtype=np.int64), 0
    for place in range(len(points)):
        age, coarse = point - points[place], 1
        while age >= 2 * coarse * spacing * FINENESS:
            coarse *= 2
        is_looked_at = (points[place] // spacing) % coarse == 0
        if shortest <= age <= longest and worth[place] > -np.inf and is_looked_at:
            found[size] = place
            size += 1
    return found[:size]


@njit(cache=True, nogil=True)
def _onsets(
    points: Indices, worth: Floats, through: int, ages: tuple[int, int], width: int, gain: float
) -> Indices:
    """Return the most promising place of each bin of so many points, the most promising first.

    ages: of what is under way, at least and at most; gain: what a point of it adds [nat].
    """
    youngest, oldest = ages
    best = np.full(oldest // width + 1, -1)
    promise = np.full(len(best), -np.inf)
    for place in range(len(points)):
        age = through - points[place]
        if youngest <= age <= oldest and worth[place] + gain * age > promise[age // width]:
            best[age // width], promise[age // width] = place, worth[place] + gain * age
    order = np.argsort(-promise, kind="mergesort")
    return best[order][: np.sum(promise > -np.inf)]
