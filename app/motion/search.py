"""Steps 1-3 of the paper (Sec. III-C): where one action ends and the next begins.

The search sees only ``ratios(segments)``, log-likelihood ratios to the background or a criterion made of
them, so that it can be tested against a hand-written table. It works
frame by frame and a bounded amount for each: what it finds, and after which frame, depends on nothing but
the frames. Frames are counted from 0 over the whole stream.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from app.motion.model import Model
from app.motion.trajectory import Floats, Indices

PACE = 2.5
"""A movement may be this many times slower or faster than any that was demonstrated."""

NEIGHBOURHOOD = 0.25
"""Successors are tried from origins within this of a candidate boundary [s]."""

SPACING = 0.04
"""These origins lie so far apart [s]: in that time a hand that starts or stops hardly moves."""

STRIDE = 0.1
"""Where nothing begins, the search goes on this much later [s]."""

WORK_PER_FRAME = 5000
"""Frames of candidate segments that are looked at for each frame that arrives."""


@dataclass(frozen=True)
class Bounds:
    """What the search goes by, in frames.

    shortest, longest: lengths of a segment; patience: how long past the best candidate boundary Step 1
    looks for a better one; neighbourhood, spacing, stride: see the constants of this module.
    """

    shortest: int
    longest: int
    patience: int
    neighbourhood: int
    spacing: int
    stride: int


def bounds_of(model: Model) -> Bounds:
    """Return the bounds that a model's demonstrations imply at its internal rate."""
    rate = model.features.rate
    durations = np.concatenate([action.durations for action in model.actions])
    patience = int(np.ceil(durations.max() * rate))
    return Bounds(
        shortest=max(int(durations.min() / PACE * rate), 2),
        longest=int(np.ceil(durations.max() * PACE * rate)),
        patience=patience,
        neighbourhood=min(round(NEIGHBOURHOOD * rate), patience),
        spacing=max(round(SPACING * rate), 1),
        stride=max(round(STRIDE * rate), 1),
    )


class Found(NamedTuple):
    """A segment [start, end) in points; is_shared: its end is where the next one starts."""

    start: int
    end: int
    is_shared: bool = False


class Row:
    """Step 1 from one origin: the ratios of its candidate segments, one end after the other."""

    def __init__(self, origin: int, bounds: Bounds) -> None:
        self.origin = origin
        self.next_end = origin + bounds.shortest
        self.best_end, self.best = origin + bounds.shortest, -np.inf
        self.closed = False
        self._bounds = bounds
        self._ratios: list[Floats] = []

    def ends(self, n_frames: int) -> range:
        """Return the ends, among the first ``n_frames`` frames, that have not been looked at."""
        if self.closed:
            return range(0)
        return range(self.next_end, min(n_frames, self.origin + self._bounds.longest + 1))

    def extend(self, ratios: Floats) -> None:
        """Take the (n_ends, n_classes) ratios of the next ends."""
        for of_end in ratios:
            if self.closed:
                return
            self._ratios.append(of_end)
            if (value := float(of_end.max())) > self.best:
                self.best, self.best_end = value, self.next_end
            last = self.next_end - self.origin >= self._bounds.longest
            self.closed = last or self.next_end - self.best_end >= self._bounds.patience
            self.next_end += 1

    def at(self, end: int) -> Floats:
        """Return the (n_classes,) ratios of the segment that ends at ``end``."""
        return self._ratios[end - self.origin - self._bounds.shortest]

    @property
    def gain(self) -> float:
        """What the best segment from here adds over the background, 0 where none is better [nat]."""
        return max(self.best, 0.0)


class Search:
    """Finds segments one after the other.

    ratios: (n, 2) segments -> (n, n_classes) log-likelihood ratios [nat], -inf where a segment cannot start
    or end; look_ahead: whether the successor has a say in where a segment ends (Steps 2 and 3); without it
    the search is greedy (Fig. 7, top).
    """

    def __init__(
        self,
        ratios: Callable[[Indices], Floats],
        bounds: Bounds,
        look_ahead: bool = True,
        origin: int = 0,
    ) -> None:
        self._ratios, self._bounds, self._look_ahead = ratios, bounds, look_ahead
        self._n_frames = origin
        self._current = Row(origin, bounds)
        self._successors: list[Row] = []

    @property
    def origin(self) -> int:
        """Frame from which on everything is undecided; what lies before is not needed any more."""
        return self._current.origin

    def frame(self, work: int | None = WORK_PER_FRAME) -> list[Found]:
        """Take one more frame; return the segments that are decided now; work: None for all there is."""
        self._n_frames += 1
        return self._advance(work, finished=False)

    def finish(self) -> list[Found]:
        """Return the segments that are left once there are no more frames."""
        return self._advance(None, finished=True)

    def _advance(self, work: int | None, finished: bool) -> list[Found]:
        found: list[Found] = []
        while work is None or work > 0:
            rows = [row for row in (self._current, *self._successors) if not row.closed]
            spent = self._look(rows, work)
            if work is not None:
                work -= spent
            if finished and spent == 0:
                for row in rows:
                    row.closed = True
            if all(row.closed for row in (self._current, *self._successors)):
                if finished and self.origin + self._bounds.shortest >= self._n_frames:
                    break
                found += self._decide()
            elif spent == 0:
                break
        return found

    def _look(self, rows: list[Row], work: int | None) -> int:
        """Look at candidate segments of these rows, up to ``work`` frames of them; return how many."""
        batches, spent = [], 0
        for row in rows:
            ends = row.ends(self._n_frames)
            if work is not None:
                longest = max(ends.stop - row.origin, 1)
                ends = ends[: max((work - spent) // longest, 1 if spent == 0 else 0)]
            if ends:
                batches.append((row, np.array([(row.origin, end) for end in ends])))
                spent += sum(end - row.origin for end in ends)
        if batches:
            ratios = self._ratios(np.concatenate([segments for _, segments in batches]))
            splits = np.cumsum([len(segments) for _, segments in batches])[:-1]
            for (row, _), of_row in zip(batches, np.split(ratios, splits), strict=True):
                row.extend(of_row)
        return spent

    def _decide(self) -> list[Found]:
        """All open rows are complete: take the next step of the algorithm."""
        row = self._current
        if self._successors:
            return [self._end_at(max(self._successors, key=self._joint))]
        if row.gain == 0.0:
            self._current = Row(row.origin + self._bounds.stride, self._bounds)
            return []
        if self._look_ahead:
            self._successors = [Row(origin, self._bounds) for origin in self._origins()]
            return []
        return [self._end_at(Row(row.best_end, self._bounds))]

    def _origins(self) -> list[int]:
        """Return where a successor may begin: the candidate boundary and frames in its neighbourhood."""
        row, spacing = self._current, self._bounds.spacing
        reach = self._bounds.neighbourhood // spacing * spacing
        nearby = range(row.best_end - reach, row.best_end + reach + 1, spacing)
        return [origin for origin in nearby if row.origin + self._bounds.shortest <= origin < row.next_end]

    def _joint(self, successor: Row) -> float:
        """Step 3, Eq. (2): how well both sides of a boundary are explained [nat]."""
        return float(self._current.at(successor.origin).max()) + successor.gain

    def _end_at(self, successor: Row) -> Found:
        row, self._current, self._successors = self._current, successor, []
        return Found(row.origin, successor.origin)
