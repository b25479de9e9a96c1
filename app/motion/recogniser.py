"""Recognition of a stream: frames in, events out (Sec. III-C of the paper).

A ``Recogniser`` does no input or output and holds no clock. A socket, a file and a test drive the same
object, and what it finds does not depend on how the frames were cut into chunks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.motion.errors import InvalidTrajectory, RoleMissing
from app.motion.model import Model
from app.motion.resampling import Period, Resampler, stack
from app.motion.rest import movement, rests
from app.motion.search import Found, Search, bounds_of
from app.motion.trajectory import Flags, Floats, Scene, Trajectory
from app.motion.window import Gap, Gaps, Window

Method = Literal["steps", "greedy"]


@dataclass(frozen=True)
class SegmentEvent:
    """A final segment: frames [start, end) of a movement without the rest beside it, ``end`` is the goal.

    log_likelihoods: ``criterion`` per class, of all that lies between the boundaries found [nat], -inf where
    a class has more states than there are points; margin: the best's over the second best [nat], None with
    one class; t_start, t_end: times of start and goal [s].
    """

    start: int
    end: int
    action: str
    log_likelihoods: dict[str, float]
    margin: float | None
    t_start: float
    t_end: float


@dataclass(frozen=True)
class Hypothesis:
    """What the movement under way may be; provisional.

    posteriors: per class, None for none of them, summing to 1; progress: per class, 0..1.
    """

    start: int
    through: int
    posteriors: dict[str | None, float]
    progress: dict[str, float]


Event = SegmentEvent | Gap


class Recogniser:
    """Recognises the actions of one stream.

    method: ``steps`` for the paper's Steps 1-3, ``greedy`` for Step 1 alone; rate: of the client's frames
    [Hz] where it declares one, else it is learned from their times. Raises InvalidTrajectory and RoleMissing
    on frames it refuses; these leave it as it was.
    """

    def __init__(
        self, model: Model, scene: Scene = Scene(), method: Method = "steps", rate: float | None = None
    ) -> None:
        self._model, self._look_ahead = model, method == "steps"
        self._bounds = bounds_of(model)
        self._window = Window(model, scene, 4 * self._bounds.longest)
        self._period = Period(rate)
        self._gaps = Gaps()
        self._n_frames, self._time = 0, -np.inf
        self._begin(0)

    def push(self, frames: Trajectory) -> list[Event]:
        """Take frames that follow those before; return the events that they decide, in order."""
        self._check(frames)
        positions = stack(frames, self._model.features.objects)
        intervals = np.diff(frames.times, prepend=self._time)
        jumps = np.zeros(len(frames), dtype=bool)
        first = 1 if self._n_frames == 0 else 0
        jumps[first:] = self._period.gaps(intervals[first:])
        events: list[Event] = []
        starts = np.flatnonzero(intervals > self._bounds.longest / self._model.features.rate)
        for part in np.split(np.arange(len(frames)), starts):
            if len(part):
                events += self._push(frames.times[part], positions[part], jumps[part])
        return events

    def finish(self) -> list[Event]:
        """Return the events that are left; there are no more frames."""
        return [*self._events(self._search.finish()), *self._gaps.finish(self._n_frames)]

    def hypothesis(self) -> Hypothesis | None:
        """Return what the movement under way looks like, None while nothing is under way."""
        origin = self._search.under_way
        through = self._window.n_points - 1
        if through - origin < self._bounds.shortest:
            return None
        [odds] = self._window.odds(np.array([[origin, through]]))
        if not np.isfinite(odds).any():
            return None
        weights = np.exp(np.append(odds, 0.0) - max(odds.max(), 0.0))
        posteriors = weights / weights.sum()
        elapsed = (through - origin) / self._model.features.rate
        return Hypothesis(
            start=self._window.frame_of(origin)[0],
            through=self._n_frames - 1,
            posteriors=dict(zip((*self._model.names, None), posteriors.tolist(), strict=True)),
            progress={a.action: min(elapsed / float(a.durations.mean()), 1.0) for a in self._model.actions},
        )

    def _check(self, frames: Trajectory) -> None:
        for role in self._model.features.objects:
            if role not in frames.objects:
                raise RoleMissing(role, tuple(frames.objects))
        if frames.times[0] <= self._time:
            raise InvalidTrajectory("times", 0, "must be later than the last frame before this chunk")

    def _begin(self, origin: int) -> None:
        """Start afresh: nothing that lies before has to do with what comes."""
        self._resampler = Resampler(self._model.features.rate)
        self._search = Search(self._window.criterion, self._bounds, self._look_ahead, origin)

    def _push(self, times: Floats, positions: Floats, jumps: Flags) -> list[Event]:
        """Take frames between which time does not jump by more than the longest segment."""
        decided: list[tuple[int, int, Event]] = []
        first, longest = self._n_frames, self._bounds.longest / self._model.features.rate
        if first > 0 and times[0] - self._time > longest:
            decided += [(first, 1, event) for event in self._events(self._search.finish())]
            self._begin(self._window.n_points)
        decided += [(gap.end, 0, gap) for gap in self._gaps.push(times, positions[:, 0], jumps, first)]
        grid = self._resampler.push(times, positions, jumps, first)
        for index, released in enumerate(grid.released.tolist()):
            self._window.append(grid, index, self._search.origin)
            found = self._search.frame() if self._window.has_room else self._search.catch_up()
            decided += [(released, 1, event) for event in self._events(found)]
        self._n_frames, self._time = first + len(times), float(times[-1])
        return [event for _, _, event in sorted(decided, key=lambda entry: entry[:2])]

    def _events(self, segments: list[Found]) -> list[SegmentEvent]:
        """Return the events of the segments that are actions and no rest."""
        actions = [self._model.actions[int(found.ratios.argmax())] for found in segments]
        return [
            self._event(found, action.action)
            for found, action in zip(segments, actions, strict=True)
            if not rests(self._window.hand(found.start, found.end), action)
        ]

    def _event(self, found: Found, action: str) -> SegmentEvent:
        best, *others = np.sort(found.ratios)[::-1]
        first, last = movement(self._window.hand(found.start, found.end))
        start, t_start = self._window.frame_of(found.start + first)
        end, t_end = self._window.frame_of(found.start + last)
        return SegmentEvent(
            start=start,
            end=end,
            action=action,
            log_likelihoods=dict(zip(self._model.names, found.ratios.tolist(), strict=True)),
            margin=float(best - others[0]) if others else None,
            t_start=t_start,
            t_end=t_end,
        )


def recognise(
    model: Model, trajectory: Trajectory, scene: Scene = Scene(), method: Method = "steps"
) -> list[Event]:
    """Return the events of a whole recording: what a stream of the same frames gives."""
    recogniser = Recogniser(model, scene, method)
    return recogniser.push(trajectory) + recogniser.finish()
