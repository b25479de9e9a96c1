"""Segmental Viterbi: the best division of all that was seen into actions and rest, decided once it stands.

The search is exact over *places*, candidate boundaries ``SPACING`` apart: every segment between two places
is looked at, and each place keeps the value of the best division of all that lies before, and where its last
part began. What is under way at the newest place counts what it may become (``foresight``), so divisions
can be compared while an action lasts.

A segment is final once every surviving division has it, up to ``NEAR`` at its ends: all within
``SURVIVING`` of the best. A bound in stream time forces what stays open longer. The search sees only
``Parts``, so that it can be tested against a hand-written table. It works frame by frame and a bounded
amount for each: what it finds, and after which frame, depends on nothing but the frames. Points are counted
from 0 over the whole stream.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from app.motion.criterion import START
from app.motion.foresight import Outlook
from app.motion.model import Model
from app.motion.scoring import Indices
from app.motion.search import Found
from app.motion.trajectory import Flags, Floats

PACE = 2.5
"""A movement may be this many times slower or faster than any that was demonstrated."""

SPACING = 0.04
"""Places lie so far apart [s]: in that time a hand that starts or stops hardly moves."""

MOST_ORIGINS = 200
"""No place looks back at more places than this; where actions last long, places lie farther apart."""

SURVIVING = 16.0
"""A division that is worse than the best by more than this will not catch up [nat]."""

SETTLED = 0.24
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

WORK_PER_FRAME = 25_000
"""Frames of candidate segments that are looked at for each frame that arrives."""


class Parts(Protocol):
    """What a division consists of."""

    @property
    def typical(self) -> float:
        """What a frame of a typical action counts [nat]."""

    def seen(self, point: int) -> bool:
        """Return whether the hand was seen at a point."""

    def criterion(self, segments: Indices) -> Floats:
        """Return the (n, n_classes) values of (n, 2) segments [nat], -inf where one cannot be."""

    def rest(self, start: int, stop: int) -> float:
        """Return the value of points ``start..stop-1`` at rest [nat]."""

    def outlook(self, origin: int, through: int) -> Outlook | None:
        """Return what a movement under way since ``origin`` may become, None if it cannot be one."""


@dataclass(frozen=True)
class Limits:
    """What the search goes by, in points of the internal rate; see the constants of this module.

    shortest, longest: lengths of a segment; bound: how long after its end a segment is decided at the latest.
    """

    rate: float
    shortest: int
    longest: int
    bound: int

    @property
    def spacing(self) -> int:
        """Points between two places."""
        return max(round(SPACING * self.rate), -(-self.longest // MOST_ORIGINS), 1)

    @property
    def horizon(self) -> int:
        """How long a point matters."""
        return self.longest + self.bound + 4 * self.spacing


def limits_of(model: Model, bound: float | None = None) -> Limits:
    """Return the limits that a model's demonstrations imply; bound [s]: by default the longest segment."""
    rate = model.features.rate
    durations = np.concatenate([action.durations for action in model.actions])
    longest = int(np.ceil(durations.max() * PACE * rate))
    forced = longest if bound is None else min(round(bound * rate), longest)
    return Limits(rate, max(int(durations.min() / PACE * rate), 2), longest, forced)


class Alternative(NamedTuple):
    """A division that ends in something under way: a movement with an outlook, or rest without one.

    value: of the whole; base: without what is under way [nat]; place, point: where it begins.
    """

    value: float
    base: float
    place: int
    point: int
    outlook: Outlook | None


class Decoder:
    """Finds the segments of a stream one after the other."""

    def __init__(self, parts: Parts, limits: Limits, origin: int = 0) -> None:
        self._parts, self._limits = parts, limits
        self._n_points = origin
        size = 4 * (limits.horizon // limits.spacing + 2)
        self._points: Indices = np.full(size, origin, dtype=np.int64)
        self._values, self._back = np.zeros(size), np.zeros(size, dtype=np.int64)
        self._moved: Flags = np.zeros(size, dtype=bool)
        self._base, self._n_places = 0, 1
        self._pending: Indices = np.empty(0, dtype=np.int64)

    @property
    def origin(self) -> int:
        """Point before which nothing is needed any more."""
        oldest = int(self._points[self._n_places - 1]) - self._limits.horizon
        return max(int(self._points[self._base]), oldest)

    def frame(self, work: int = WORK_PER_FRAME) -> list[Found]:
        """Take one more point; return the segments that are decided now."""
        self._n_points += 1
        return self._advance(work)

    def catch_up(self) -> list[Found]:
        """Return the segments that all the points there are decide, whatever the work."""
        return self._advance(None)

    def finish(self) -> list[Found]:
        """Return the segments that are left once there are no more points."""
        found = self._advance(None)
        last = self._n_points - 1
        if last > self._points[self._n_places - 1]:
            self._extend(last, None)
        return found + [self._commit(place) for place in self._ends(self._n_places - 1)]

    def alternatives(self, through: int) -> list[Alternative]:
        """Return what may be under way at a point, the best first; what does not survive may be missing.

        Nothing is known where the hand is not seen.
        """
        if not self._parts.seen(through):
            return []
        newest, points = self._n_places - 1, self._points
        found = []
        if not self._moved[newest]:
            base, point = float(self._values[newest]), int(points[newest])
            value = base + self._parts.rest(point, through)
            found.append(Alternative(value, base, newest, point, None))
        best = found[0].value if found else -np.inf
        for place in self._onsets(through):
            age = through - int(points[place])
            if self._values[place] + self._parts.typical * age - START < best - SURVIVING:
                continue
            begun = self._begun(place, through)
            if begun is not None:
                found.append(begun)
                best = max(best, begun.value)
        return sorted(found, key=lambda each: -each.value)

    def _advance(self, work: int | None) -> list[Found]:
        found: list[Found] = []
        while (point := int(self._points[self._n_places - 1]) + self._limits.spacing) < self._n_points:
            spent, is_complete = self._extend(point, work)
            if work is not None:
                work -= spent
            if not is_complete:
                break
            if (point // self._limits.spacing) % CONVERGE_EVERY == 0:
                found += self._converge(point)
            if work is not None and work <= 0:
                break
        return found

    def _extend(self, point: int, work: int | None) -> tuple[int, bool]:
        """Look at segments that end at a new place; return the work done, and whether it is complete."""
        if len(self._pending) == 0:
            self._begin_place(point)
        lengths = point - self._points[self._pending]
        n_ready = len(lengths) if work is None else max(int(np.searchsorted(np.cumsum(lengths), work)), 1)
        ready, self._pending = self._pending[:n_ready], self._pending[n_ready:]
        if len(ready):
            self._take(point, ready)
        is_complete = len(self._pending) == 0
        if is_complete:
            self._n_places += 1
        return int(lengths[:n_ready].sum()), is_complete

    def _begin_place(self, point: int) -> None:
        """A new place is reached by rest; every place that a segment may begin at is pending."""
        if self._n_places == len(self._points):
            self._forget()
        new, points = self._n_places, self._points[: self._n_places]
        rest = self._parts.rest(int(points[-1]), point)
        self._points[new], self._back[new], self._moved[new] = point, new - 1, False
        self._values[new] = self._values[new - 1] + rest
        ages = point - points
        allowed = (ages >= self._limits.shortest) & (ages <= self._limits.longest)
        allowed &= np.isfinite(self._values[:new])
        allowed[: self._base] = False
        self._pending = np.flatnonzero(allowed)

    def _take(self, point: int, origins: Indices) -> None:
        """Let segments from these places to the new one compete for it."""
        segments = np.column_stack([self._points[origins], np.full(len(origins), point)])
        unknown = UNKNOWN * self._parts.typical * (point - segments[:, 0])
        criterion = self._parts.criterion(segments)
        known = criterion.max(axis=1)
        possible = np.where(np.isnan(known), -np.inf, np.maximum(known, unknown))
        values = self._values[origins] + possible - START
        best, new = int(values.argmax()), self._n_places
        if values[best] > self._values[new]:
            self._values[new], self._back[new], self._moved[new] = values[best], origins[best], True

    def _onsets(self, through: int) -> list[int]:
        """Return the places where what is under way may have begun, the most promising first."""
        limits = self._limits
        places = np.arange(self._base, self._n_places)
        ages = through - self._points[places]
        young, old = round(YOUNGEST * limits.rate), limits.longest
        fits = (ages >= young) & (ages <= old) & np.isfinite(self._values[places])
        places, ages = places[fits], ages[fits]
        promise = self._values[places] + ONSET * self._parts.typical * ages
        bins = ages // max(round(BIN * limits.rate), limits.spacing)
        order = np.lexsort((-promise, bins))
        firsts = order[np.unique(bins[order], return_index=True)[1]]
        onsets: list[int] = places[firsts[np.argsort(-promise[firsts], kind="stable")]].tolist()
        return onsets

    def _begun(self, place: int, through: int) -> Alternative | None:
        point, base = int(self._points[place]), float(self._values[place]) - START
        outlook = self._parts.outlook(point, through)
        if outlook is None:
            return None
        return Alternative(base + float(np.logaddexp.reduce(outlook.values, axis=None)), base, place, point, outlook)

    def _converge(self, through: int) -> list[Found]:
        """Decide what every surviving division has."""
        found: list[Found] = []
        alternatives = self.alternatives(through)
        best = alternatives[0].place if alternatives else self._n_places - 1
        while ends := self._ends(best):
            if through - self._points[ends[0]] < self._limits.bound:
                if not alternatives or not self._agree(ends[0], alternatives):
                    break
                best = self._refined(alternatives[0], best, through)
                ends = self._ends(best)
                settled = SETTLED * self._limits.rate
                if not ends or through - self._points[ends[0]] < settled:
                    break
            found.append(self._commit(ends[0]))
        return found

    def _agree(self, end: int, alternatives: list[Alternative]) -> bool:
        """Return whether all surviving divisions have the segment that ends at a place, or one near it."""
        near = NEAR * self._limits.rate
        for each in alternatives:
            if each.value < alternatives[0].value - SURVIVING:
                break
            if not np.isfinite(self._values[each.place]):
                continue
            ends = self._ends(each.place)
            if not ends:
                return False
            for mine, theirs in ((end, ends[0]), (self._back[end], self._back[ends[0]])):
                if abs(self._points[mine] - self._points[theirs]) > near:
                    return False
        return True

    def _refined(self, leader: Alternative, place: int, through: int) -> int:
        """Return the place, near that of the leading division, where what is under way best begins."""
        if leader.outlook is None:
            return place
        near = np.abs(self._points[: self._n_places] - self._points[place]) <= BIN * self._limits.rate
        young = through - self._points[: self._n_places] >= YOUNGEST * self._limits.rate
        candidates = np.flatnonzero(near & young & np.isfinite(self._values[: self._n_places]))
        begun = [self._begun(each, through) for each in candidates[candidates >= self._base].tolist()]
        return max((each for each in begun if each is not None), key=lambda each: each.value).place

    def _ends(self, place: int) -> list[int]:
        """Return the places where the segments of the best division up to a place end, in order."""
        ends = []
        while place > self._base:
            if self._moved[place]:
                ends.append(place)
            place = int(self._back[place])
        return ends[::-1]

    def _commit(self, end: int) -> Found:
        """Make the segment that ends at a place final: divisions without that end are out."""
        found = Found(int(self._points[self._back[end]]), int(self._points[end]))
        self._base = end
        for place in range(end + 1, self._n_places):
            back = int(self._back[place])
            if back < end or not np.isfinite(self._values[back]):
                self._values[place] = -np.inf
        return found

    def _forget(self) -> None:
        """Make room: places before the horizon are not needed."""
        oldest = self._points[self._n_places - 1] - self._limits.horizon
        drop = max(self._base, int(np.searchsorted(self._points[: self._n_places], oldest)))
        kept = self._n_places - drop
        for array in (self._points, self._values, self._back, self._moved):
            array[:kept] = array[drop : self._n_places].copy()
        self._back[:kept] -= drop
        self._base, self._n_places = 0, kept
