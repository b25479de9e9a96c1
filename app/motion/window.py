"""What a recogniser remembers of its stream: the undecided points, and where the hand was not seen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.motion.conditioning import REACH, Conditioned, Tracks
from app.motion.criterion import Criterion, Scores
from app.motion.features import BLEND
from app.motion.foresight import Foresight, Outlook
from app.motion.model import Model
from app.motion.state import State
from app.motion.trajectory import Flags, Floats, Indices, Scene

TURN, TURN_SHARE = 0.1, 0.2
"""Between two actions that touch the hand is slowest near the boundary found: within this [s], and this share
of the shortest action."""

SLOWNESS = 4.0
"""Where exactly is the mean of the points there, weighted by one over this power of their speeds."""


class Window:
    """The points from the search's origin on, at most ``capacity`` of them.

    Points are counted from 0 over the whole stream. fillings: (n_fillings, n_roles) objects in the roles.
    """

    def __init__(self, model: Model, scene: Scene, fillings: Indices, n_objects: int, capacity: int) -> None:
        self._criterion = Criterion(model, scene.table_height, fillings)
        self._foresight = Foresight(model, scene.table_height, fillings)
        self._capacity = capacity
        shortest = min(float(action.durations.min()) for action in model.actions)
        self._turn = round(min(TURN, TURN_SHARE * shortest) * model.features.rate)
        size = capacity + REACH
        self._tracks = Tracks(
            np.empty((size, 3)), np.empty(size), np.empty((n_objects, size, 3)), np.empty((n_objects, size))
        )
        self._frames: NDArray[np.int64] = np.empty(size, dtype=np.int64)
        self._times = np.empty(size)
        self._bounds = np.zeros((size + 1, len(model.actions)))
        self._begin = 0
        self.n_points = 0

    @property
    def typical(self) -> float:
        """What a frame of a typical action counts [nat]."""
        return self._criterion.typical

    @property
    def has_room(self) -> bool:
        """Whether another point fits."""
        return self.n_points - self._begin < self._capacity

    def append(self, ready: Conditioned, index: int, origin: int) -> None:
        """Take a point; what lies before ``origin`` is forgotten where its place is needed."""
        if not self.has_room:
            self._forget(origin)
        self._write(ready, slice(index, index + 1))
        place = self.n_points - self._begin
        self._bounds[place + 1] = self._bounds[place] + self._criterion.most(self._tracks, place)
        self.n_points += 1

    def look_ahead(self, ahead: Conditioned) -> int:
        """Take points that are not ready, until the next is appended; return the number of the last point."""
        self._write(ahead, slice(0, len(ahead.times)))
        return self.n_points + len(ahead.times) - 1

    def seen(self, point: int) -> bool:
        """Return whether the hand was seen at a point."""
        return not np.isnan(self._tracks.hand[point - self._begin, 0])

    def scores(self, segments: Indices) -> Scores:
        """Return the scores of (n, 2) segments."""
        return self._criterion(self._tracks, segments - self._begin)

    def criterion(self, segments: Indices) -> Floats:
        """Return the (n, n_classes) criterion alone [nat]."""
        return self.scores(segments).criterion

    def best(self, segments: Indices, before: Floats, least: Floats) -> Floats:
        """Return (n,) values of (n, 2) segments; one that cannot give the best division may have ``least``.

        before: (n,) what a division has where they begin; least: (n,) what they count at least [nat].
        """
        return self._criterion.best(self._tracks, segments - self._begin, self._bounds, before, least)

    def rest(self, start: int, stop: int) -> float:
        """Return what points ``start..stop-1`` count as rest [nat]."""
        return float(self._criterion.rest(self._tracks.pace[start - self._begin : stop - self._begin]).sum())

    def outlook(self, origin: int, through: int) -> Outlook | None:
        """Return what a movement since ``origin`` may become, None where it has no direction yet.

        It has none where either point is a dropout.
        """
        first, last, hand = origin - self._begin, through - self._begin, self._tracks.hand
        way = math.dist(hand[first].tolist(), hand[last].tolist())
        return self._foresight(self._tracks, first, last) if way >= BLEND else None

    def hand(self, start: int, end: int) -> Floats:
        """Return (end - start + 1, 3) positions of the hand at points from start to end [m]."""
        return self._tracks.hand[start - self._begin : end - self._begin + 1]

    def turn(self, point: int) -> int:
        """Return the point near a boundary where the hand turns from one action to the next."""
        place = point - self._begin
        low, high = max(place - self._turn, 0), min(place + self._turn + 1, self.n_points - self._begin)
        weights = np.nan_to_num(np.exp(-SLOWNESS * self._tracks.pace[low:high]))
        if not weights[place - low]:
            return point
        middle = round(float(np.average(np.arange(low, high), weights=weights)))
        return self._begin + middle if self.seen(self._begin + middle) else point

    def objects(self, point: int) -> Floats:
        """Return (n_objects, 3) positions of the objects at a point [m], NaN where not seen."""
        return self._tracks.objects[:, point - self._begin]

    def frame_of(self, point: int) -> tuple[int, float]:
        """Return the client's frame nearest to a point, and the point's time [s]."""
        place = point - self._begin
        return int(self._frames[place]), float(self._times[place])

    def state(self) -> State:
        """Return the points that are remembered."""
        n_kept = self.n_points - self._begin
        tracks = self._tracks.part(0, n_kept)._asdict()
        return {
            "points": np.array([self._begin, self.n_points]),
            "frames": self._frames[:n_kept].copy(),
            "times": self._times[:n_kept].copy(),
            "bounds": self._bounds[: n_kept + 1].copy(),
            **{name: track.copy() for name, track in tracks.items()},
        }

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self._begin, self.n_points = state["points"].tolist()
        n_kept = self.n_points - self._begin
        self._frames[:n_kept], self._times[:n_kept] = state["frames"], state["times"]
        self._bounds[: n_kept + 1] = state["bounds"]
        for name, track in self._tracks.part(0, n_kept)._asdict().items():
            track[:] = state[name]

    def _write(self, ready: Conditioned, part: slice) -> None:
        """Write some points behind those that are there."""
        first = self.n_points - self._begin
        places = slice(first, first + part.stop - part.start)
        mine, theirs = self._tracks, ready.tracks
        self._frames[places], self._times[places] = ready.frames[part], ready.times[part]
        mine.hand[places], mine.pace[places] = theirs.hand[part], theirs.pace[part]
        mine.objects[:, places], mine.paces[:, places] = theirs.objects[:, part], theirs.paces[:, part]

    def _forget(self, origin: int) -> None:
        begin = min(origin, self.n_points)
        keep = slice(begin - self._begin, self.n_points - self._begin)
        n_kept = keep.stop - keep.start
        for array in (self._tracks.hand, self._tracks.pace, self._frames, self._times):
            array[:n_kept] = array[keep].copy()
        self._bounds[: n_kept + 1] = self._bounds[keep.start : keep.stop + 1] - self._bounds[keep.start]
        for array in (self._tracks.objects, self._tracks.paces):
            array[:, :n_kept] = array[:, keep].copy()
        self._begin = begin


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

    def state(self) -> State:
        """Return what the frames before have left behind."""
        missing = [] if self._missing_since is None else [self._missing_since]
        return {"time": np.array(self._time), "missing": np.array(missing, dtype=np.float64)}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self._time = float(state["time"])
        missing = [(int(frame), time) for frame, time in state["missing"].tolist()]
        self._missing_since = missing[0] if missing else None

    def finish(self, n_frames: int) -> list[Gap]:
        """Return the gap that the stream ends in."""
        if self._missing_since is None:
            return []
        start, since = self._missing_since
        return [Gap(start, n_frames, self._time - since)]
