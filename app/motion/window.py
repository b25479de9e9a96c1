"""What a recogniser remembers of its stream: the undecided grid points, and where the hand was not seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.motion.criterion import Criterion
from app.motion.model import Model
from app.motion.resampling import Grid
from app.motion.scoring import Indices
from app.motion.trajectory import Flags, Floats, Scene


class Window:
    """The grid points from the search's origin on, at most ``capacity`` of them.

    Points are counted from 0 over the whole stream.
    """

    def __init__(self, model: Model, scene: Scene, capacity: int) -> None:
        self._criterion = Criterion(model, scene.table_height)
        self._n_classes = len(model.actions)
        self._hand = np.empty((capacity, 3))
        self._objects = np.empty((len(model.features.objects), capacity, 3))
        self._frames: NDArray[np.int64] = np.empty(capacity, dtype=np.int64)
        self._times = np.empty(capacity)
        self._begin = 0
        self.n_points = 0

    @property
    def has_room(self) -> bool:
        """Whether another point fits."""
        return self.n_points - self._begin < len(self._times)

    def append(self, grid: Grid, index: int, origin: int) -> None:
        """Take a point of a grid; what lies before ``origin`` is forgotten where its place is needed."""
        if not self.has_room:
            self._forget(origin)
        place = self.n_points - self._begin
        self._hand[place] = grid.positions[index, 0]
        self._objects[:, place] = grid.positions[index, 1:]
        self._frames[place], self._times[place] = grid.frames[index], grid.times[index]
        self.n_points += 1

    def criterion(self, segments: Indices) -> Floats:
        """Return the (n, n_classes) criterion; -inf where an end point is a dropout [nat]."""
        return self._of_seen(self._criterion, segments)

    def odds(self, segments: Indices) -> Floats:
        """Return the same whatever the durations."""
        return self._of_seen(self._criterion.odds, segments)

    def hand(self, start: int, end: int) -> Floats:
        """Return (end - start + 1, 3) positions of the hand at points from start to end [m]."""
        return self._hand[start - self._begin : end - self._begin + 1]

    def frame_of(self, point: int) -> tuple[int, float]:
        """Return the client's frame nearest to a point, and the point's time [s]."""
        place = point - self._begin
        return int(self._frames[place]), float(self._times[place])

    def _of_seen(self, function: Callable[[Floats, Floats, Indices], Floats], segments: Indices) -> Floats:
        places = segments - self._begin
        seen = ~np.isnan(self._hand[places, 0]).any(axis=1)
        values = np.full((len(segments), self._n_classes), -np.inf)
        values[seen] = function(self._hand, self._objects, places[seen])
        return values

    def _forget(self, origin: int) -> None:
        keep = slice(min(origin, self.n_points) - self._begin, self.n_points - self._begin)
        n_kept = keep.stop - keep.start
        self._hand[:n_kept] = self._hand[keep].copy()
        self._objects[:, :n_kept] = self._objects[:, keep].copy()
        self._frames[:n_kept] = self._frames[keep].copy()
        self._times[:n_kept] = self._times[keep].copy()
        self._begin = min(origin, self.n_points)


@dataclass(frozen=True)
class Gap:
    """Frames [start, end) in which the hand was not seen; none where the time jumped before ``start``."""

    start: int
    end: int
    seconds: float


class Gaps:
    """Finds the gaps of a stream, chunk by chunk."""

    def __init__(self) -> None:
        self._time = 0.0
        self._missing_since: tuple[int, float] | None = None

    def push(self, times: Floats, hand: Floats, jumps: Flags, first: int) -> list[Gap]:
        """Return the gaps that end within these frames; times (n,) [s], hand (n, 3), jumps (n,)."""
        missing = np.isnan(hand[:, 0])
        if self._missing_since is None and not missing.any() and not jumps.any():
            self._time = float(times[-1])
            return []
        gaps = []
        for index, (time, is_missing, jumped) in enumerate(
            zip(times.tolist(), missing.tolist(), jumps.tolist(), strict=True)
        ):
            frame = first + index
            if is_missing:
                self._missing_since = self._missing_since or (frame, time)
            elif self._missing_since is not None:
                start, since = self._missing_since
                gaps.append(Gap(start, frame, time - since))
                self._missing_since = None
            elif jumped:
                gaps.append(Gap(frame, frame, time - self._time))
            self._time = time
        return gaps

    def finish(self, n_frames: int) -> list[Gap]:
        """Return the gap that the stream ends in."""
        if self._missing_since is None:
            return []
        start, since = self._missing_since
        return [Gap(start, n_frames, self._time - since)]
