"""The journal: what sessions took in and decided goes to the database, one transaction for all of them.

Frames alone wait ``PAUSE`` for company; a decision goes at once, with the frames of its own session alone.
The write runs in a thread, so the event loop goes on while the disk turns.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from app.motion.trajectory import Floats
from app.registry.errors import Unavailable
from app.registry.records import StoredEvent
from app.service.checkpoints import Snapshot
from app.service.session_errors import SessionError, WriteFailed

PAUSE = 0.4
"""How long frames wait before they are written [s]."""
PATIENCE, LAST_PATIENCE = 20.0, 5.0
"""How long a database that is away is waited for [s], and how long by a process that is to stop."""
AGAIN = 0.2
"""Time between two attempts [s]."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Entry:
    """What one session adds: rows of settled frames from ``first_seq`` on, events, and whether it ends.

    epoch: that its process has taken it on with; snapshot: after all of this.
    """

    session_id: str
    epoch: int
    first_seq: int
    rows: tuple[Floats, ...] = ()
    events: tuple[StoredEvent, ...] = ()
    ended: bool = False
    snapshot: Snapshot | None = None


class Source(Protocol):
    """A session, as the journal sees it."""

    def collect(self) -> Entry:
        """Hand over what is not written yet."""

    def written(self, entry: Entry) -> None:
        """Learn that the entry is durable."""

    def failed(self, error: SessionError) -> None:
        """Learn that it could not be made durable."""


class Journal:
    """Writes the entries of all sessions of the process.

    ``write`` does it in one transaction. Where that fails each session gets one of its own, so that none
    fails for another; what it raises is a SessionError if it is the session's own fault.
    """

    def __init__(self, write: Callable[[Sequence[Entry]], None]) -> None:
        self._write = write
        self._waiting: dict[Source, bool] = {}
        self._any = asyncio.Event()
        self._urgent = asyncio.Event()
        self._closing = False
        self._task = asyncio.create_task(self._run())

    def note(self, source: Source, urgent: bool) -> None:
        """Write what the source has to add soon, or at once."""
        if urgent:
            self._urgent.set()
        elif source in self._waiting:
            return
        self._waiting[source] = urgent
        self._any.set()

    async def close(self) -> None:
        """Write what is left and stop."""
        self._closing = True
        self._any.set()
        self._urgent.set()
        await self._task

    async def _run(self) -> None:
        clock = asyncio.get_running_loop().time
        while not self._closing or self._waiting:
            await self._any.wait()
            due = clock() + PAUSE
            while (left := due - clock()) > 0 and not self._closing:
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._urgent.wait(), left)
                await self._write_those([source for source, urgent in self._waiting.items() if urgent])
            await self._write_those(list(self._waiting))

    async def _write_those(self, sources: Sequence[Source]) -> None:
        for source in sources:
            del self._waiting[source]
        self._urgent.clear()
        if not self._waiting:
            self._any.clear()
        entries = [source.collect() for source in sources]
        if not entries:
            return
        try:
            errors = await self._errors(entries)
        except Unavailable as error:
            log.error("%d sessions could not be written: %s", len(entries), error)
            errors = [WriteFailed() for _ in entries]
        for source, entry, failure in zip(sources, entries, errors, strict=True):
            if failure is None:
                source.written(entry)
            else:
                source.failed(failure)

    async def _errors(self, entries: Sequence[Entry]) -> list[SessionError | None]:
        """Write; return what is wrong with each. Raises Unavailable where the database stays away."""
        if await self._try(entries) is None:
            return [None for _ in entries]
        return [await self._try([entry]) for entry in entries]

    async def _try(self, entries: Sequence[Entry]) -> SessionError | None:
        """Write; where the database is away, again and again for ``PATIENCE``, while everybody waits.

        Return what is wrong with the entries. Raises Unavailable.
        """
        clock = asyncio.get_running_loop().time
        begin = clock()
        while True:
            try:
                await asyncio.to_thread(self._write, entries)
            except SessionError as error:
                return error
            except Unavailable:
                if clock() - begin >= (LAST_PATIENCE if self._closing else PATIENCE):
                    raise
            except Exception:
                log.exception("%d sessions could not be written together", len(entries))
                return WriteFailed()
            else:
                return None
            await asyncio.sleep(AGAIN)
