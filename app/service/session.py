"""One recognition, which may span several connections: frames in, durable events out.

A session drives one ``Recogniser`` of one pinned model version. It counts frames and events, hands both to
the journal and tells by marks how many frames it has taken in (``taken``), how many of them
(``frames_durable``) and how many events (``events``) are durable, and that either has changed (``moved``).
It knows no socket: who is attached asks for ``events_after`` and ``hypotheses``.
"""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from app.motion.recogniser import Recogniser
from app.motion.trajectory import Floats, Scene
from app.registry.records import StoredEvent
from app.service import messages
from app.service.checkpoints import Snapshot
from app.service.decisions import Decisions
from app.service.frames import Frames, Layout, settle
from app.service.geometry import Goals
from app.service.journal import Entry, Journal
from app.service.mark import Mark
from app.service.session_errors import FramesMissing, MessageMalformed, SessionError

CHECKPOINT = 250
"""Frames after which the state of the recogniser is written down, for another process to go on from."""
BATCH = 16
"""Frames that are computed before other sessions have their turn."""
UNWRITTEN = 20_000
"""Frames that a session takes in beyond those that are durable; then it waits for the disk."""
LATE = 0.02
"""Where a task wakes so much too late there is more to do than time [s]."""
REST = 10.0
"""How many times as long as it was late a task that can wait keeps out of the way."""
RECENT = 128
"""Durable events kept in memory; older ones are read from the database."""


@dataclass(frozen=True)
class Pinned:
    """What a session keeps from its start to its end; goals: where movements may go [m], by name."""

    session_id: str
    model: str
    version: int
    roles: tuple[str, ...]
    actions: tuple[str, ...]
    layout: Layout
    scene: Scene
    goals: Goals
    warnings: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class Standing:
    """How far a session has come when it begins to live in this process.

    epoch: that this process has taken it on with; newest: its last frame (1 + 3 n_tracks,), empty for none.
    """

    epoch: int = 0
    n_frames: int = 0
    n_events: int = 0
    n_segments: int = 0
    newest: Floats = field(default_factory=lambda: np.empty(0))
    ended: bool = False


class Session:
    """A live session; ``read_events(session_id, after)`` reads its durable events from the database."""

    def __init__(
        self,
        pinned: Pinned,
        recogniser: Recogniser,
        journal: Journal,
        read_events: Callable[[str, int], Sequence[StoredEvent]],
        standing: Standing = Standing(),
    ) -> None:
        self.pinned = pinned
        self.epoch = standing.epoch
        self.taken = Mark(standing.n_frames)
        self.moved = Mark(0)
        self.frames_durable = Mark(standing.n_frames)
        self.events = Mark(standing.n_events)
        self.ended = standing.ended
        self.failure: SessionError | None = None
        self._recogniser = recogniser
        self._journal = journal
        self._read_events = read_events
        self._last_time = float(standing.newest[0]) if len(standing.newest) else -math.inf
        self._decisions = Decisions(pinned.model, pinned.version, standing.n_events, standing.n_segments)
        self._rows: list[Floats] = []
        self._fresh: list[StoredEvent] = []
        self._collected = standing.n_frames
        self._checkpointed = standing.n_frames
        self._recent: deque[StoredEvent] = deque(maxlen=RECENT)
        self._newest = standing.newest

    @property
    def next_seq(self) -> int:
        """The number of the frame wanted next."""
        return self.taken.value

    async def take(self, frames: Frames) -> None:
        """Take the frames that are new, in small batches that let others have their turn.

        Raises FramesMissing and FramesRefused, of the latter no frame is taken.
        """
        if frames.first_seq > self.next_seq:
            raise FramesMissing(self.next_seq, frames.first_seq)
        skip = self.next_seq - frames.first_seq
        if self.ended or skip >= len(frames):
            return
        rows = settle(self.pinned.layout, frames, skip, self._last_time)
        for start in range(0, len(rows), BATCH):
            if self.ended:
                return
            self._push(rows[start : start + BATCH])
            await asyncio.sleep(0)
        await self.frames_durable.beyond(self.next_seq - UNWRITTEN - 1)

    def take_at_once(self, frames: Frames) -> bool:
        """Take the next frames if they are few and need not wait for the disk; return whether they were.

        Raises FramesRefused, then no frame is taken.
        """
        unwritten = self.next_seq - self.frames_durable.value
        if self.ended or len(frames) > BATCH or frames.first_seq != self.next_seq or unwritten > UNWRITTEN:
            return False
        self._push(settle(self.pinned.layout, frames, 0, self._last_time))
        return True

    async def saved(self) -> None:
        """Return once all that was taken in and decided is durable."""
        n_events = self._decisions.n_events
        if self.frames_durable.value < self.next_seq or self.events.value < n_events:
            self._journal.note(self, urgent=True)
        await self.frames_durable.beyond(self.next_seq - 1)
        await self.events.beyond(n_events - 1)

    async def end(self, last_seq: int | None = None) -> None:
        """End the session: decide what is open; ``ended`` becomes its last event.

        Raises FramesMissing if frame ``last_seq`` was not received, MessageMalformed if later ones were.
        """
        if not self.ended:
            self._check_last(last_seq)
            self._fresh += self._decisions.take(self._recogniser.finish())
            self._fresh.append(self._decisions.end(self.next_seq))
            self.ended = True
        await self.saved()

    async def events_after(self, event: int) -> AsyncIterator[StoredEvent]:
        """Yield the durable events after ``event`` (-1: from the first), as they come, ``ended`` the last."""
        while not self.ended or event < self._decisions.n_events - 1:
            await self.events.beyond(event + 1)
            for stored in await self._stored_after(event):
                yield stored
                event = stored.event

    async def hypotheses(self, rate_hz: float) -> AsyncIterator[str]:
        """Yield the newest hypothesis as JSON text, now and after new frames; rate_hz: at most [Hz].

        Where the process is late nothing is said until it is no more: decisions go first.
        """
        seen, loop = 0, asyncio.get_running_loop()
        while True:
            seen = await self.taken.beyond(seen)
            found = None if self.ended else self._recogniser.hypothesis()
            if found is not None:
                yield messages.hypothesis(found)
            due = loop.time() + 1.0 / rate_hz
            await asyncio.sleep(1.0 / rate_hz)
            while (late := loop.time() - due) > LATE:
                due = loop.time() + REST * late
                await asyncio.sleep(REST * late)

    async def frames(self, rate_hz: float) -> AsyncIterator[str]:
        """Yield the newest frame as JSON text, now and after new ones; rate_hz: at most [Hz]."""
        seen = 0
        while True:
            seen = await self.taken.beyond(seen)
            if not self.ended:
                yield messages.frame(self.next_seq - 1, self._newest, self.pinned.layout.objects)
            await asyncio.sleep(1.0 / rate_hz)

    def collect(self) -> Entry:
        """Hand the journal what is not written yet."""
        snapshot = None
        if not self.ended and self.next_seq >= self._checkpointed + CHECKPOINT:
            counts = self.next_seq, self._decisions.n_events, self._decisions.n_segments
            snapshot = Snapshot(*counts, self._recogniser.state())
            self._checkpointed = self.next_seq
        entry = Entry(
            session_id=self.pinned.session_id,
            epoch=self.epoch,
            first_seq=self._collected,
            rows=tuple(self._rows),
            events=tuple(self._fresh),
            ended=self.ended,
            snapshot=snapshot,
        )
        self._collected = self.next_seq
        self._rows, self._fresh = [], []
        return entry

    def written(self, entry: Entry) -> None:
        """Note what is durable now."""
        self._recent.extend(entry.events)
        self.frames_durable.advance(entry.first_seq + sum(len(rows) for rows in entry.rows))
        self.events.advance(self.events.value + len(entry.events))
        self.moved.advance(self.moved.value + 1)

    def touch(self) -> None:
        """Let the database know that the session is alive."""
        if not self.ended:
            self._journal.note(self, urgent=False)

    def failed(self, error: SessionError) -> None:
        """End everybody's wait: the session cannot keep its promises any more."""
        self.failure = error
        for mark in (self.taken, self.moved, self.frames_durable, self.events):
            mark.fail(error)

    def _check_last(self, last_seq: int | None) -> None:
        if last_seq is not None and last_seq >= self.next_seq:
            raise FramesMissing(self.next_seq, last_seq)
        if last_seq is not None and last_seq < self.next_seq - 1:
            detail = f"`last_seq` {last_seq} lies before frame {self.next_seq - 1}, which was received"
            raise MessageMalformed("malformed", detail)

    def _push(self, rows: Floats) -> None:
        events = self._recogniser.take(rows[:, 0], rows[:, 1:].reshape(len(rows), -1, 3))
        self._rows.append(rows)
        self._newest = rows[-1]
        self._last_time = float(rows[-1, 0])
        self.taken.advance(self.next_seq + len(rows))
        self.moved.advance(self.moved.value + 1)
        self._fresh += self._decisions.take(events)
        self._journal.note(self, urgent=bool(events))

    async def _stored_after(self, event: int) -> Sequence[StoredEvent]:
        if self._recent and self._recent[0].event <= event + 1:
            return [stored for stored in self._recent if stored.event > event]
        return await asyncio.to_thread(self._read_events, self.pinned.session_id, event)
