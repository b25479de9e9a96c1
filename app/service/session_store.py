"""Sessions in the database: opened, written, taken on by another process, ended."""

from __future__ import annotations

import hmac
import logging
import secrets
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timedelta
from uuid import uuid4

import numpy as np

from app.motion.errors import MotionError
from app.motion.model import Model
from app.registry import models, sessions
from app.registry.errors import ArtifactInvalid, NotFound, RegistryError, TakenOn
from app.registry.holdings import version_title
from app.registry.records import SessionRecord, SessionState, StoredEvent
from app.registry.tables import now
from app.service.decisions import Decisions
from app.service.journal import Entry
from app.service.lab import Lab, Version
from app.service.session import Standing
from app.service.session_errors import SessionGone, StartRefused, TakenOver, TokenRefused
from app.service.session_restoring import Opened, restored
from app.service.session_start import (
    Ticket,
    Wish,
    check_same,
    pinned_before,
    pinned_to,
    recogniser_of,
    start_of,
)
from app.service.tokens import digest_of

MOST_EVENTS = 1000
"""Events read at once."""
PAGE = 500
"""Sessions looked at at once."""

log = logging.getLogger(__name__)


class SessionStore:
    """Opens sessions, keeps them in the database, takes on those of other processes; all of it may wait.

    resume: how long after it was seen last a session can be resumed that has ended.
    """

    def __init__(self, lab: Lab, resume: timedelta = timedelta(minutes=10)) -> None:
        self._lab = lab
        self._resume = resume

    def open(self, wish: Wish) -> tuple[Opened, str]:
        """Create a session on the version it asks for; return it and its resume token.

        Raises NotFound, StartRefused.
        """
        version = self._version(wish)
        with self._lab.database.reading() as tx:
            height = models.get(tx, wish.model).table_height_m
        pinned = pinned_to(uuid4().hex, wish, version.model, version.record.number, height)
        recogniser = recogniser_of(version.model, pinned)
        token, layout = secrets.token_urlsafe(24), pinned.layout
        with self._lab.database.transaction() as tx:
            sessions.create(
                tx,
                id_=pinned.session_id,
                model=wish.model,
                version=pinned.version,
                token_hash=digest_of(token),
                artifact_digest=version.record.artifact_digest,
                geometry=vars(wish.geometry),
                channels=("t", *layout.channels) if layout.rate_hz else layout.channels,
                name=wish.name,
                start=start_of(wish, pinned),
            )
        return Opened(pinned, recogniser, digest_of(token), Standing()), token

    def take_on(self, ticket: Ticket) -> Opened:
        """Go on with a session that lived in another process, or lives there: it is ours from now on.

        One that has ended stays as it is. Raises SessionGone, TokenRefused, StartRefused.
        """

        try:
            model = self._model(self.get(ticket.session_id))
        except NotFound:
            raise SessionGone(ticket.session_id) from None
        with self._lab.database.transaction() as tx:
            record = sessions.lock(tx, ticket.session_id)
            self._check(record, model, ticket)
            if record.state == "active":
                record = sessions.take_on(tx, record.id)
        return restored(self._lab, record, model)

    def write(self, entries: Sequence[Entry]) -> None:
        """Make what sessions add durable, all of it or nothing.

        Raises TakenOver for a session that another process has taken on, SessionGone where it has ended.
        """
        try:
            with self._lab.database.transaction() as tx:
                sessions.append_all(tx, [_addition(entry) for entry in entries])
        except TakenOn as error:
            is_over = self.get(error.session_id).state != "active"
            raise SessionGone(error.session_id) if is_over else TakenOver from error

    def get(self, session_id: str) -> SessionRecord:
        """Return what is durable of a session. Raises NotFound."""
        with self._lab.database.reading() as tx:
            return sessions.get(tx, session_id)

    def owners(self, session_ids: Sequence[str]) -> Mapping[str, tuple[int, SessionState]]:
        """Return the epochs and states of sessions."""
        with self._lab.database.reading() as tx:
            return sessions.owners(tx, session_ids)

    def events(self, session_id: str, after: int) -> tuple[StoredEvent, ...]:
        """Return the first ``MOST_EVENTS`` of the durable events after number ``after``. Raises NotFound."""
        with self._lab.database.reading() as tx:
            return sessions.events(tx, session_id, after=after, limit=MOST_EVENTS)

    def end(self, session_id: str) -> None:
        """Decide what is open of a session that lives elsewhere, or nowhere any more, and end it.

        One that is over stays as it is. Raises NotFound.
        """
        self._finish(session_id, "ended")

    def give_up(self, session_id: str) -> None:
        """End a session without deciding what is open. Raises NotFound."""
        record = self._mine(session_id)
        if record is not None:
            self._close(record, [_counted(record).end(record.n_frames)], "ended")

    def expire(self, last_seen_before: datetime, living: Collection[str]) -> int:
        """End active sessions that no process has seen since then; return how many.

        living: ids of those that live in this process.
        """
        token, ids = None, []
        while True:
            with self._lab.database.reading() as tx:
                page = sessions.page(tx, size=PAGE, after=token, state="active")
            ids += [record.id for record in page.records if record.last_seen_at < last_seen_before]
            if (token := page.next_token) is None:
                break
        return sum(self._finish(id_, "expired", last_seen_before) for id_ in ids if id_ not in living)

    def drop_frames(self, last_seen_before: datetime) -> int:
        """Drop the frames of sessions that are over and were last seen before then; return how many."""
        with self._lab.database.transaction() as tx:
            return sessions.drop_frames(tx, last_seen_before=last_seen_before)

    def _version(self, wish: Wish) -> Version:
        try:
            return self._lab.version(wish.model, wish.version)
        except ArtifactInvalid as error:
            detail = f"what was trained cannot be read ({error}): train the model again"
            raise StartRefused("version_unusable", detail) from error

    def _model(self, record: SessionRecord) -> Model:
        if record.artifact_digest is None:
            return self._lab.version(record.model, str(record.version)).model
        return self._lab.load(record.artifact_digest, version_title(record.model, record.version))

    def _check(self, record: SessionRecord, model: Model, ticket: Ticket) -> None:
        """Raise what keeps a client from going on with a session."""
        if not hmac.compare_digest(record.token_hash, digest_of(ticket.token)):
            raise TokenRefused
        late = record.state == "ended" and now() - record.last_seen_at > self._resume
        if record.state == "expired" or late:
            raise SessionGone(record.id)
        check_same(pinned_before(record, model), record.n_events, ticket)

    def _mine(self, session_id: str, last_seen_before: datetime | None = None) -> SessionRecord | None:
        """Take a session on in order to end it; None where it is over, or was seen since then."""
        with self._lab.database.transaction() as tx:
            record = sessions.lock(tx, session_id)
            seen = last_seen_before is not None and record.last_seen_at >= last_seen_before
            return None if seen or record.state != "active" else sessions.take_on(tx, session_id)

    def _finish(self, session_id: str, state: SessionState, last_seen_before: datetime | None = None) -> bool:
        """Take a session on, decide what is open and end it; return whether it was ours to end."""
        record = self._mine(session_id, last_seen_before)
        if record is None:
            return False
        decisions = _counted(record)
        try:
            events = decisions.take(restored(self._lab, record, self._model(record)).recogniser.finish())
        except (MotionError, RegistryError) as error:
            log.error("session %s: what is open cannot be decided: %s", session_id, error)
            events = []
        return self._close(record, [*events, decisions.end(record.n_frames)], state)

    def _close(self, record: SessionRecord, last: Sequence[StoredEvent], state: SessionState) -> bool:
        """Make the last events of a session durable; return whether it still was ours to end."""
        addition = sessions.Addition(record.id, record.epoch, record.n_frames, events=last, state=state)
        with suppress(TakenOn), self._lab.database.transaction() as tx:
            sessions.append(tx, addition)
            return True
        return False


def _counted(record: SessionRecord) -> Decisions:
    """Return what counts a session's events on."""
    return Decisions(record.model, record.version, record.n_events, record.n_segments)


def _addition(entry: Entry) -> sessions.Addition:
    return sessions.Addition(
        entry.session_id,
        entry.epoch,
        entry.first_seq,
        rows=np.concatenate(entry.rows).astype("<f8").tobytes() if entry.rows else b"",
        events=entry.events,
        state="ended" if entry.ended else "active",
        checkpoint=None if entry.snapshot is None else entry.snapshot.packed(),
    )
