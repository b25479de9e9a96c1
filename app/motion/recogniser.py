"""Recognition of a stream: frames in, events out (Sec. III-C of the paper).

A ``Recogniser`` does no input or output and holds no clock. A socket, a file and a test drive the same
object, and what it finds does not depend on how the frames were cut into chunks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from app.motion.conditioning import Conditioned, Conditioner
from app.motion.decoding import Decoder, limits_of
from app.motion.errors import InvalidTrajectory, RoleMissing
from app.motion.hypothesis import Hypothesis, believe, expected, likely_goals
from app.motion.model import Model
from app.motion.resampling import Period, Resampler, stack
from app.motion.rest import movement
from app.motion.roles import fillings
from app.motion.search import Found, Search, bounds_of
from app.motion.state import State, Stateful, check_format, gathered, marked, scatter
from app.motion.trajectory import Flags, Floats, Scene, Trajectory
from app.motion.window import Gap, Gaps, Window

Method = Literal["viterbi", "steps", "greedy"]


@dataclass(frozen=True)
class SegmentEvent:
    """A final segment: frames [start, end) of a movement without the rest beside it, ``end`` is the goal.

    action: None if it is of no class; objects: role -> the object that fills it; log_likelihoods:
    ``criterion`` per class [nat], -inf where a class cannot be; margin: the best's over the second best
    [nat], None with one class; novelty: how much less the best class explains of it than of its own
    demonstrations [nat per frame]; t_start, t_end: times of start and goal [s].
    """

    start: int
    end: int
    action: str | None
    objects: dict[str, str]
    log_likelihoods: dict[str, float]
    margin: float | None
    novelty: float
    t_start: float
    t_end: float


Event = SegmentEvent | Gap


class Boundary(NamedTuple):
    """A point, the client's frame nearest to it, and its time [s]."""

    point: int
    frame: int
    time: float


class Recogniser:
    """Recognises the actions of one stream.

    method: ``viterbi`` for the best division of all that was seen, ``steps`` for the paper's Steps 1-3,
    ``greedy`` for its Step 1 alone; rate: of the client's frames [Hz] where it declares one, else it is
    learned from their times; objects: names of those that the stream carries, by default the roles; goals:
    named places (3,) [m] where movements may go; bound: how long after its end a segment is decided at the
    latest [s], by default as long as the longest. Raises RoleMissing and InvalidRequest for objects that
    cannot fill the roles, InvalidTrajectory and RoleMissing on frames it refuses; these leave it as it was.
    """

    def __init__(
        self,
        model: Model,
        scene: Scene = Scene(),
        method: Method = "viterbi",
        rate: float | None = None,
        objects: tuple[str, ...] | None = None,
        goals: Mapping[str, Floats] = {},
        bound: float | None = None,
    ) -> None:
        self._model, self._method, self._goals = model, method, dict(goals)
        self._objects = model.features.objects if objects is None else objects
        self._fillings = fillings(model.features.objects, self._objects)
        self._limits, self._bounds = limits_of(model, bound), bounds_of(model)
        room = self._limits.horizon + self._limits.horizon // 4
        self._window = Window(model, scene, self._fillings, len(self._objects), room)
        self._period = Period(rate)
        self._gaps = Gaps()
        self._n_frames, self._time = 0, -np.inf
        self._last: Boundary | None = None
        self._begin(0)

    def push(self, frames: Trajectory) -> list[Event]:
        """Take frames that follow those before; return the events that they decide, in order."""
        self._check(frames)
        return self.take(frames.times, stack(frames, self._objects))

    def take(self, times: Floats, positions: Floats) -> list[Event]:
        """Take frames that are known to be sound and to follow those before; return what they decide.

        times: (n_frames,) [s]; positions: (n_frames, 1 + n_objects, 3) [m], the hand's first.
        """
        times, positions = np.array(times, order="C"), np.array(positions, order="C")
        intervals = np.empty(len(times))
        intervals[0] = times[0] - self._time
        np.subtract(times[1:], times[:-1], out=intervals[1:])
        jumps = np.zeros(len(times), dtype=bool)
        first = 1 if self._n_frames == 0 else 0
        jumps[first:] = self._period.gaps(intervals[first:])
        longest = self._limits.longest / self._model.features.rate
        if not (intervals[1:] > longest).any():
            return self._push(times, positions, jumps)
        events: list[Event] = []
        for part in np.split(np.arange(len(times)), np.flatnonzero(intervals > longest)):
            if len(part):
                events += self._push(times[part], positions[part], jumps[part])
        return events

    def finish(self) -> list[Event]:
        """Return the events that are left; there are no more frames."""
        return [*self._finish_search(), *self._gaps.finish(self._n_frames)]

    def hypothesis(self) -> Hypothesis | None:
        """Return what the movement under way looks like, None where nothing is known; ``viterbi`` only."""
        if not isinstance(self._search, Decoder) or self._n_frames == 0:
            return None
        through = self._window.look_ahead(self._conditioner.ahead())
        alternatives = self._search.alternatives(through)
        if not alternatives:
            return None
        belief = believe(alternatives, len(self._model.actions))
        start = self._window.frame_of(alternatives[0].point)[0]
        return Hypothesis(
            start=start,
            through=self._n_frames - 1,
            actions=expected(belief, self._model.names),
            goals=likely_goals(belief, self._candidates(through)),
        )

    def state(self) -> State:
        """Return what the frames before have left behind, for ``restore``; ``viterbi`` only."""
        last = [] if self._last is None else [self._last]
        own: State = {
            "n_frames": np.array(self._n_frames),
            "time": np.array(self._time),
            "last": np.array(last, dtype=np.float64),
        }
        return marked(own | gathered(**self._parts()))

    def restore(self, state: State) -> None:
        """Go on bit for bit where a recogniser of the same stream was when it gave its ``state``.

        Raises InvalidState, KeyError or ValueError for one that does not fit; this one is of no use then.
        """
        check_format(state)
        self._n_frames, self._time = int(state["n_frames"]), float(state["time"])
        last = [Boundary(int(point), int(frame), time) for point, frame, time in state["last"].tolist()]
        self._last = last[0] if last else None
        scatter(state, **self._parts())

    def _parts(self) -> dict[str, Stateful]:
        if not isinstance(self._search, Decoder):
            raise TypeError("the state of Steps 1-3 and greedy cannot be kept")
        return {
            "window": self._window,
            "period": self._period,
            "gaps": self._gaps,
            "resampler": self._resampler,
            "conditioner": self._conditioner,
            "search": self._search,
        }

    def _candidates(self, through: int) -> dict[str, Floats]:
        """Return where a movement may go: the objects that are seen, and the goals that were named."""
        seen = zip(self._objects, self._window.objects(through), strict=True)
        return {name: place for name, place in seen if not np.isnan(place[0])} | self._goals

    def _check(self, frames: Trajectory) -> None:
        for name in self._objects:
            if name not in frames.objects:
                raise RoleMissing(name, tuple(frames.objects))
        if frames.times[0] <= self._time:
            raise InvalidTrajectory("times", 0, "must be later than the last frame before this chunk")

    def _begin(self, origin: int) -> None:
        """Start afresh: nothing that lies before has to do with what comes."""
        self._last = None
        self._resampler = Resampler(self._model.features.rate)
        self._conditioner = Conditioner(self._model.features, 1 + len(self._objects))
        self._search: Decoder | Search
        if self._method == "viterbi":
            self._search = Decoder(self._window, self._limits, origin)
        else:
            look_ahead = self._method == "steps"
            self._search = Search(self._window.criterion, self._bounds, look_ahead, origin)

    def _push(self, times: Floats, positions: Floats, jumps: Flags) -> list[Event]:
        """Take frames between which time does not jump by more than the longest segment."""
        decided: list[tuple[int, int, Event]] = []
        first, longest = self._n_frames, self._limits.longest / self._model.features.rate
        if first > 0 and times[0] - self._time > longest:
            decided += [(first, 1, event) for event in self._finish_search()]
            self._begin(self._window.n_points)
        decided += [(gap.end, 0, gap) for gap in self._gaps.push(times, positions[:, 0], jumps, first)]
        grid = self._resampler.push(times, positions, jumps, first)
        decided += [(at, 1, event) for at, event in self._search_in(self._conditioner.push(grid))]
        self._n_frames, self._time = first + len(times), float(times[-1])
        return [event for _, _, event in sorted(decided, key=lambda entry: entry[:2])]

    def _search_in(self, ready: Conditioned) -> list[tuple[int, SegmentEvent]]:
        """Return the segments that conditioned points decide, each with the frame that decides it."""
        decided = []
        for index, released in enumerate(ready.released.tolist()):
            self._window.append(ready, index, self._search.origin)
            found = self._search.frame() if self._window.has_room else self._search.frame(None)
            decided += [(released, event) for event in self._events(found)]
        return decided

    def _finish_search(self) -> list[SegmentEvent]:
        left = [event for _, event in self._search_in(self._conditioner.finish())]
        return left + self._events(self._search.finish())

    def _events(self, found: Sequence[Found]) -> list[SegmentEvent]:
        """Return the events of segments that some class can be."""
        events = [self._event(each) for each in found]
        return [event for event in events if event is not None]

    def _trimmed(self, found: Found) -> tuple[Boundary, Boundary]:
        """Return where the hand moves in a segment of Steps 1-3, which know no rest."""
        first, last = movement(self._window.hand(found.start, found.end))
        return self._boundary_at(found.start + first), self._boundary_at(found.start + last)

    def _span(self, found: Found) -> tuple[Boundary, Boundary]:
        """Return where a segment starts and ends; one that touches its predecessor starts where that ends."""
        start = self._boundary_at(found.start)
        if self._last is not None and found.start <= self._last.point:
            start = self._last
        end = self._boundary_at(self._window.turn(found.end) if found.is_shared else found.end)
        self._last = end if end.point > found.end else end._replace(point=found.end)
        return start, end

    def _boundary_at(self, point: int) -> Boundary:
        return Boundary(point, *self._window.frame_of(point))

    def _event(self, found: Found) -> SegmentEvent | None:
        scores = self._window.scores(np.array([[found.start, found.end]]))
        criterion, ratio, filling = (of_segment[0] for of_segment in scores)
        best = int(criterion.argmax())
        if not np.isfinite(criterion[best]):
            return None
        start, end = self._trimmed(found) if self._method != "viterbi" else self._span(found)
        names, familiarity = self._model.names, self._model.familiarity
        ordered = np.sort(criterion)
        filled = self._fillings[filling[best]]
        roles = self._model.features.objects
        return SegmentEvent(
            start=start.frame,
            end=end.frame,
            action=names[best] if ratio[best] >= familiarity.least[best] else None,
            objects={role: self._objects[index] for role, index in zip(roles, filled, strict=True)},
            log_likelihoods=dict(zip(names, criterion.tolist(), strict=True)),
            margin=float(ordered[-1] - ordered[-2]) if len(ordered) > 1 else None,
            novelty=float(familiarity.typical[best] - ratio[best]),
            t_start=start.time,
            t_end=end.time,
        )


def recognise(
    model: Model,
    trajectory: Trajectory,
    scene: Scene = Scene(),
    method: Method = "viterbi",
    goals: Mapping[str, Floats] = {},
) -> list[Event]:
    """Return the events of a whole recording: what a stream of the same frames gives."""
    recogniser = Recogniser(model, scene, method, objects=tuple(trajectory.objects), goals=goals)
    return recogniser.push(trajectory) + recogniser.finish()
