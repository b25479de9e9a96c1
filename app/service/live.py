"""The sessions that live in this process: opened, attached to a connection, resumed, ended.

At most one connection is attached to a session, the newest. A session without one waits ``Limits.resume``
for the next and is ended then. It may come back to any process: the one that it comes to takes the session
on in the database, and the one that had it before lets it go, at its next write or within ``WATCH``.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
from collections.abc import AsyncIterator, Coroutine
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from weakref import WeakValueDictionary

from app.registry.errors import Unavailable
from app.registry.records import SessionRecord, StoredEvent
from app.service.journal import Journal
from app.service.pulse import Pulse
from app.service.session import Session
from app.service.session_errors import (
    Overloaded,
    Restarting,
    SessionError,
    SessionGone,
    TakenOver,
    TokenRefused,
    TooManySessions,
)
from app.service.session_restoring import Opened
from app.service.session_start import Ticket, Wish, check_same
from app.service.session_store import SessionStore
from app.service.tokens import digest_of

POLL = 0.5
"""How often a session of another process is looked at [s]."""

WATCH = 1.0
"""How often it is looked whether sessions are still ours [s]."""

PATIENCE, BETWEEN = 20, 10
"""Beats of a process that is too late before a session has to leave, and between two of them."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Limits:
    """What a connection may ask of the server; times in seconds.

    idle: without a message from the client; send: for a message to be taken; resume: between two
    connections of a session; drain: for going away; keep_alive: between two comments in server-sent events;
    late: that the event loop may be before no session is taken on; where it is twice that for long, one after
    the other has to leave, to be resumed when there is time again.
    """

    idle: float = 60.0
    send: float = 10.0
    resume: float = 600.0
    drain: float = 5.0
    keep_alive: float = 15.0
    late: float = 0.1
    sessions: int = 500
    message_bytes: int = 1 << 20
    message_frames: int = 4096
    unacked_frames: int = 10_000


class Attachment:
    """The hold of one connection on a session; ``revoke`` takes it away with a reason."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.left = asyncio.Event()
        self._reason: asyncio.Future[SessionError] = asyncio.get_running_loop().create_future()

    def revoke(self, reason: SessionError) -> None:
        """Tell the connection to leave."""
        if self.stays:
            self._reason.set_result(reason)

    @property
    def stays(self) -> bool:
        """Whether the hold is not taken away."""
        return not self._reason.done()

    async def revoked(self) -> None:
        """Wait until the hold is taken away. Raises the reason."""
        raise await asyncio.shield(self._reason)


@dataclass(eq=False)
class _Place:
    session: Session
    token_digest: str
    attachment: Attachment | None = None
    expiry: asyncio.TimerHandle | None = None


class LiveSessions:
    """The sessions of this process. Made and closed inside the running event loop."""

    def __init__(self, store: SessionStore, limits: Limits | None = None) -> None:
        self.store = store
        self.limits = limits or Limits()
        self.draining = asyncio.Event()
        self._journal = Journal(store.write)
        self._places: dict[str, _Place] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._strained, self._taken = 0, dict[str, int]()
        self._given_up = set[str]()
        self._turns: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()
        self.pulse = Pulse(self._shed)
        self._beating = asyncio.create_task(self.pulse.beat())
        self._watching = asyncio.create_task(self._watch())

    async def open(self, wish: Wish) -> tuple[Attachment, str]:
        """Open a session; return the hold on it and its resume token.

        Raises NotFound for an unknown model or version, StartRefused, TooManySessions, Overloaded and
        Restarting.
        """
        self._check_time()
        self._make_room()
        opened, token = await asyncio.to_thread(self.store.open, wish)
        return self._attach(self._settle(opened)), token

    async def resume(self, ticket: Ticket) -> Attachment:
        """Attach a new connection to a session; the one before it is told that it was taken over.

        Raises SessionGone, TokenRefused, StartRefused if the wish is not that of the session, Overloaded,
        Restarting.
        """
        self._check_time()
        if ticket.session_id in self._given_up:
            raise SessionGone(ticket.session_id)
        async with self._turns.setdefault(ticket.session_id, asyncio.Lock()):
            place = await self._ours(ticket.session_id)
            if place is None:
                self._make_room()
                place = self._settle(await asyncio.to_thread(self.store.take_on, ticket))
            elif not hmac.compare_digest(place.token_digest, digest_of(ticket.token)):
                raise TokenRefused
            else:
                check_same(place.session.pinned, place.session.events.value, ticket)
                await self._clear(place)
            if self._places.get(ticket.session_id) is not place:
                raise SessionGone(ticket.session_id)
            return self._attach(place)

    def leave(self, attachment: Attachment) -> None:
        """Give the hold back; from now on the session waits to be resumed, unless it has failed."""
        attachment.left.set()
        place = self._places.get(attachment.session.pinned.session_id)
        if place is None or place.attachment is not attachment:
            return
        place.attachment = None
        if attachment.session.failure is not None:
            self._drop(place)
            return
        place.expiry = asyncio.get_running_loop().call_later(self.limits.resume, self._expire, place)

    def abandon(self, session: Session) -> None:
        """Give up a session that cannot go on; what is durable of it stays."""
        gone = SessionGone(session.pinned.session_id)
        if self._places.pop(gone.session_id, None) is not None:
            session.failed(gone)
            self._given_up.add(gone.session_id)
            self._start(self._give_up(gone.session_id))

    def get(self, session_id: str) -> Session | None:
        """Return the session if it lives here and has not failed."""
        place = self._places.get(session_id)
        return place.session if place is not None and place.session.failure is None else None

    async def end(self, session_id: str) -> SessionRecord:
        """End a session wherever it is; one that has ended stays so. Raises NotFound, WriteFailed."""
        session = self.get(session_id)
        if session is None or not await self._is_ended(session):
            await asyncio.to_thread(self.store.end, session_id)
        return await asyncio.to_thread(self.store.get, session_id)

    async def events(self, session_id: str, after: int) -> AsyncIterator[StoredEvent]:
        """Yield the durable events after number ``after`` as they come; ``ended`` is the last."""
        active = True
        while active:
            if (session := self.get(session_id)) is not None:
                with suppress(SessionError):
                    async for stored in session.events_after(after):
                        yield stored
                        after = stored.event
                    return
            active = (await asyncio.to_thread(self.store.get, session_id)).state == "active"
            while found := await asyncio.to_thread(self.store.events, session_id, after):
                for stored in found:
                    yield stored
                    after = stored.event
            if active:
                await asyncio.sleep(POLL)

    def touch(self) -> tuple[str, ...]:
        """Let the database know which sessions live here; return their ids."""
        for place in self._places.values():
            place.session.touch()
        return tuple(self._places)

    async def drain(self) -> None:
        """Let every connection go in order, make everything durable and stop; safe to call again."""
        if self.draining.is_set():
            return
        self.draining.set()
        holds = [place.attachment for place in self._places.values() if place.attachment is not None]
        with suppress(TimeoutError):
            async with asyncio.timeout(self.limits.drain):
                await asyncio.gather(*(hold.left.wait() for hold in holds))
        for place in self._places.values():
            if place.expiry is not None:
                place.expiry.cancel()
        for task in (self._beating, self._watching):
            task.cancel()
        await asyncio.gather(*self._tasks, self._beating, self._watching, return_exceptions=True)
        await self._journal.close()

    def _settle(self, opened: Opened) -> _Place:
        """Let a session live here."""
        session = Session(opened.pinned, opened.recogniser, self._journal, self.store.events, opened.standing)
        place = _Place(session, opened.token_digest)
        self._places[opened.pinned.session_id] = place
        return place

    async def _ours(self, session_id: str) -> _Place | None:
        """Return the place of a session that lives here, and that no other process has taken on since."""
        place = self._places.get(session_id)
        if place is None:
            return None
        owners = await asyncio.to_thread(self.store.owners, [session_id])
        if place.session.failure is None and owners[session_id][0] == place.session.epoch:
            return place
        place.session.failed(TakenOver())
        await self._clear(place)
        self._drop(place)
        return None

    async def _clear(self, place: _Place) -> None:
        """Let the connection that holds a session leave, and those that hold it meanwhile."""
        while place.attachment is not None:
            former = place.attachment
            former.revoke(TakenOver())
            await former.left.wait()

    async def _watch(self) -> None:
        """Let go of sessions that other processes have taken on or ended."""
        while True:
            await asyncio.sleep(WATCH)
            if not self._places:
                continue
            try:
                owners = await asyncio.to_thread(self.store.owners, list(self._places))
            except Unavailable:
                continue
            for id_, (epoch, state) in owners.items():
                place = self._places.get(id_)
                if place is not None and epoch > place.session.epoch:
                    place.session.failed(TakenOver() if state == "active" else SessionGone(id_))
                    if place.attachment is None:
                        self._drop(place)

    async def _is_ended(self, session: Session) -> bool:
        """End a session that lives here; return whether it was ours to end. Raises WriteFailed."""
        try:
            await session.end()
        except (SessionGone, TakenOver):
            return False
        return True

    async def _give_up(self, session_id: str) -> None:
        try:
            await asyncio.to_thread(self.store.give_up, session_id)
        finally:
            self._given_up.discard(session_id)

    def _drop(self, place: _Place) -> None:
        """Forget a session; what is durable of it stays as it is."""
        if place.expiry is not None:
            place.expiry.cancel()
        if self._places.get(place.session.pinned.session_id) is place:
            del self._places[place.session.pinned.session_id]

    def _attach(self, place: _Place) -> Attachment:
        if place.expiry is not None:
            place.expiry.cancel()
            place.expiry = None
        place.attachment = Attachment(place.session)
        return place.attachment

    def _check_time(self) -> None:
        """Raise Restarting or Overloaded where no session is taken on."""
        if self.draining.is_set():
            raise Restarting
        if self.pulse.late > self.limits.late:
            raise Overloaded

    def _shed(self) -> None:
        """Let a session go where the process has long been late: of those that take the most the newest.

        Called at every beat. A session that is alone may be as greedy as it likes.
        """
        self._strained = self._strained + 1 if self.pulse.late > 2.0 * self.limits.late else 0
        if self._strained not in (1, PATIENCE):
            return
        before = self._taken
        self._taken = {id_: place.session.next_seq for id_, place in self._places.items()}
        if self._strained == 1:
            return
        self._strained = PATIENCE - BETWEEN
        lately = {id_: seq - before.get(id_, seq) for id_, seq in self._taken.items()}
        holds = {id_: place.attachment for id_, place in self._places.items()}
        held = {id_: hold for id_, hold in holds.items() if hold is not None and hold.stays}
        most = max((lately[id_] for id_ in held), default=0)
        if len(held) > 1 and most > 0:
            *_, newest = (hold for id_, hold in held.items() if 2 * lately[id_] >= most)
            newest.revoke(Overloaded())

    def _make_room(self) -> None:
        """Where all places are taken, one that waits is given up: an ended one, else the longest waiting."""
        if len(self._places) < self.limits.sessions:
            return
        waiting = [(place, place.expiry) for place in self._places.values() if place.expiry is not None]
        if not waiting:
            raise TooManySessions(self.limits.sessions)
        self._expire(min(waiting, key=lambda pair: (not pair[0].session.ended, pair[1].when()))[0])

    def _expire(self, place: _Place) -> None:
        self._drop(place)
        self._start(place.session.end())

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._finished)

    def _finished(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        error = None if task.cancelled() else task.exception()
        if error is not None and not isinstance(error, SessionError):
            log.error("a session could not be ended", exc_info=error)
