"""Sessions: what each took in and decided, so far as it is durable.

A session's frames and events only ever go on where they end; both counts stand in its row and change in
the transaction that adds to them. Whoever takes a session on counts its epoch up, and from then on nobody
else can add to it: a process that was paused, cut off or believed dead does no harm when it is back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, NamedTuple

import sqlalchemy as sa
from sqlalchemy.orm import Session

from app.registry import tables
from app.registry.errors import NotFound, OutOfOrder, TakenOn
from app.registry.paging import page_of
from app.registry.records import Checkpoint, Chunk, Page, SessionRecord, SessionState, StoredEvent

table = tables.sessions
frames_table = tables.session_frames
events_table = tables.session_events
checkpoints_table = tables.session_checkpoints

_Row = dict[str, Any]


class Addition(NamedTuple):
    """What a session takes in and decides: frames from ``first_seq`` on and events.

    epoch: that the writer has taken it on with; rows: little-endian float64, one value per channel; state:
    of the session with this; checkpoint: after all of this, None: the one before stays.
    """

    id: str
    epoch: int
    first_seq: int
    rows: bytes = b""
    events: Sequence[StoredEvent] = ()
    state: SessionState = "active"
    checkpoint: Checkpoint | None = None


def create(
    tx: Session,
    *,
    id_: str,
    model: str,
    version: int,
    token_hash: str,
    artifact_digest: str,
    geometry: Mapping[str, Any],
    channels: Sequence[str],
    name: str | None = None,
    start: Mapping[str, Any] | None = None,
) -> SessionRecord:
    """Create an active session of epoch 0.

    token_hash: of its resume token; artifact_digest: of its version, which it keeps even if the model is
    deleted; start: what its client asked for.
    """
    row = {
        "id": id_,
        "name": name,
        "model": model,
        "version": version,
        "token_hash": token_hash,
        "artifact_digest": artifact_digest,
        "epoch": 0,
        "state": "active",
        "geometry": dict(geometry),
        "channels": list(channels),
        "start": dict(start or {}),
        "n_frames": 0,
        "n_events": 0,
        "n_segments": 0,
        "frames_kept": True,
        "created_at": (at := tables.now()),
        "last_seen_at": at,
    }
    tx.execute(sa.insert(table).values(row))
    return get(tx, id_)


def get(tx: Session, id_: str) -> SessionRecord:
    """Return a session. Raises NotFound."""
    return _record(_row(tx, id_))


def page(
    tx: Session,
    *,
    size: int,
    after: str | None = None,
    state: SessionState | None = None,
    name: str | None = None,
) -> Page[SessionRecord]:
    """List sessions, newest first. Raises InvalidPageToken."""
    query = sa.select(table)
    if state is not None:
        query = query.where(table.c.state == state)
    if name is not None:
        query = query.where(table.c.name == name)
    return page_of(tx, query, table.c.position, _record, size=size, after=after, newest_first=True)


def lock(tx: Session, id_: str) -> SessionRecord:
    """Return a session and let no other transaction write to it before this one ends. Raises NotFound."""
    return _record(_row(tx, id_, for_update=True))


def take_on(tx: Session, id_: str) -> SessionRecord:
    """Count a session's epoch up: from now on it is the caller's to write to. Raises NotFound."""
    counted = sa.update(table).where(table.c.id == id_).values(epoch=table.c.epoch + 1)
    tx.execute(counted.values(last_seen_at=tables.now()))
    return get(tx, id_)


def owners(tx: Session, ids: Sequence[str]) -> dict[str, tuple[int, SessionState]]:
    """Return the epochs and states of those of the sessions that there are."""
    rows = tx.execute(sa.select(table.c.id, table.c.epoch, table.c.state).where(table.c.id.in_(ids)))
    return {row.id: (row.epoch, row.state) for row in rows}


def append(tx: Session, addition: Addition) -> None:
    """Add to one session: see ``append_all``."""
    append_all(tx, [addition])


def append_all(tx: Session, additions: Sequence[Addition]) -> None:
    """Add to sessions, at least one and to each once.

    What is there already, for a commit of before whose answer was lost, is left alone. Raises NotFound,
    TakenOn for a session of another epoch or one that is over, OutOfOrder if frames or events do not go on
    where its own end.
    """
    query = sa.select(table).where(table.c.id.in_([each.id for each in additions])).order_by(table.c.id)
    known = {row.id: _record(row) for row in tx.execute(query.with_for_update())}
    frames, fresh, changes = list[_Row](), list[_Row](), list[_Row]()
    for each in additions:
        if (session := known.get(each.id)) is None:
            raise NotFound("session", each.id)
        if session.epoch != each.epoch:
            raise TakenOn(each.id)
        if _is_there(session, each):
            continue
        if session.state != "active":
            raise TakenOn(each.id)
        changes.append(_change(session, each, frames, fresh))
    for into, rows in ((frames_table, frames), (events_table, fresh)):
        if rows:
            tx.execute(sa.insert(into), rows)
    if changes:
        columns: _Row = {name: sa.bindparam(name) for name in changes[0] if name != "of"}
        change = sa.update(table).where(table.c.id == sa.bindparam("of")).values(columns)
        tx.connection().execute(change, changes)
    _keep_checkpoints(tx, additions)


def checkpoint(tx: Session, id_: str) -> Checkpoint | None:
    """Return the newest checkpoint of a session, None where it has none."""
    columns = checkpoints_table.c
    row = tx.execute(sa.select(checkpoints_table).where(columns.session_id == id_)).one_or_none()
    return None if row is None else Checkpoint(row.n_frames, row.n_events, row.n_segments, row.state)


def events(tx: Session, id_: str, *, after: int = -1, limit: int | None = None) -> tuple[StoredEvent, ...]:
    """Return the events after number ``after``, at most ``limit``. Raises NotFound."""
    return _events(tx, id_, events_table.c.event, after, limit)


def segments(tx: Session, id_: str, *, after: int = -1, limit: int | None = None) -> tuple[StoredEvent, ...]:
    """Return the segment events after segment number ``after``, at most ``limit``. Raises NotFound."""
    return _events(tx, id_, events_table.c.segment, after, limit)


def chunks(tx: Session, id_: str, *, start: int = 0, stop: int | None = None) -> tuple[Chunk, ...]:
    """Return what was added at once and holds any of frames ``start..stop-1`` (None: to the last), in order.

    None if the frames are no longer kept. Raises NotFound.
    """
    get(tx, id_)
    first, columns = frames_table.c.first_seq, frames_table.c
    query = sa.select(frames_table).where(columns.session_id == id_, first + columns.n_frames > start)
    if stop is not None:
        query = query.where(first < stop)
    query = query.order_by(first)
    return tuple(Chunk(row.first_seq, row.n_frames, row.rows) for row in tx.execute(query))


def drop_frames(tx: Session, *, last_seen_before: datetime) -> int:
    """Delete the frames of sessions that are over and were last seen before then; return how many."""
    over = sa.and_(table.c.state != "active", table.c.frames_kept, table.c.last_seen_at < last_seen_before)
    ids = tx.scalars(sa.select(table.c.id).where(over)).all()
    tx.execute(sa.delete(frames_table).where(frames_table.c.session_id.in_(ids)))
    tx.execute(sa.update(table).where(table.c.id.in_(ids)).values(frames_kept=False))
    return len(ids)


def _is_there(session: SessionRecord, addition: Addition) -> bool:
    """Return whether all of an addition is there already: its epoch is the session's, so nobody else adds."""
    if not (addition.rows or addition.events):
        return False
    n_frames = addition.first_seq + _count(session, addition)
    n_events = addition.events[-1].event + 1 if addition.events else session.n_events
    had_all = session.n_frames == n_frames and session.n_events == n_events
    return had_all and session.state == addition.state


def _count(session: SessionRecord, addition: Addition) -> int:
    """Return the number of an addition's frames."""
    n_frames, rest = divmod(len(addition.rows), 8 * len(session.channels))
    if rest:
        raise ValueError(
            f"{len(addition.rows)} bytes are no whole frames of {len(session.channels)} channels"
        )
    return n_frames


def _change(session: SessionRecord, addition: Addition, frames: list[_Row], fresh: list[_Row]) -> _Row:
    """Put down the rows of an addition; return how it changes the session's. Raises OutOfOrder."""
    n_frames = _frames_of(session, addition, frames) if addition.rows else 0
    n_segments = _events_of(session, addition.events, fresh)
    return {
        "of": session.id,
        "n_frames": session.n_frames + n_frames,
        "n_events": session.n_events + len(addition.events),
        "n_segments": session.n_segments + n_segments,
        "state": addition.state,
        "last_seen_at": tables.now(),
    }


def _keep_checkpoints(tx: Session, additions: Sequence[Addition]) -> None:
    """Put checkpoints in the place of those before; a session that is over needs none."""
    fresh = [each for each in additions if each.checkpoint is not None or each.state != "active"]
    if not fresh:
        return
    ids = [each.id for each in fresh]
    tx.execute(sa.delete(checkpoints_table).where(checkpoints_table.c.session_id.in_(ids)))
    rows = [
        {"session_id": each.id, **vars(each.checkpoint)}
        for each in fresh
        if each.checkpoint is not None and each.state == "active"
    ]
    if rows:
        tx.execute(sa.insert(checkpoints_table), rows)


def _frames_of(session: SessionRecord, addition: Addition, frames: list[_Row]) -> int:
    """Put down the row of an addition's frames; return how many these are. Raises OutOfOrder."""
    if addition.first_seq != session.n_frames:
        raise OutOfOrder(session.id, "frame", session.n_frames, addition.first_seq)
    n_frames = _count(session, addition)
    row = {"session_id": session.id, "first_seq": addition.first_seq, "n_frames": n_frames}
    frames.append({**row, "rows": addition.rows})
    return n_frames


def _events_of(session: SessionRecord, events: Sequence[StoredEvent], fresh: list[_Row]) -> int:
    """Put down the rows of events; return how many of them are segments. Raises OutOfOrder."""
    n_segments = 0
    for number, stored in enumerate(events, session.n_events):
        if stored.event != number:
            raise OutOfOrder(session.id, "event", number, stored.event)
        is_segment = stored.type == "segment"
        fresh.append(
            {
                "session_id": session.id,
                "event": number,
                "type": stored.type,
                "text": stored.text,
                "segment": session.n_segments + n_segments if is_segment else None,
            }
        )
        n_segments += is_segment
    return n_segments


def _events(
    tx: Session, id_: str, number: sa.Column[int], after: int, limit: int | None
) -> tuple[StoredEvent, ...]:
    get(tx, id_)
    query = sa.select(events_table).where(events_table.c.session_id == id_, number > after)
    rows = tx.execute(query.order_by(number).limit(limit))
    return tuple(StoredEvent(row.event, row.type, row.text) for row in rows)


def _row(tx: Session, id_: str, *, for_update: bool = False) -> sa.Row[Any]:
    query = sa.select(table).where(table.c.id == id_)
    row = tx.execute(query.with_for_update() if for_update else query).one_or_none()
    if row is None:
        raise NotFound("session", id_)
    return row


def _record(row: sa.Row[Any]) -> SessionRecord:
    return SessionRecord(
        id=row.id,
        name=row.name,
        model=row.model,
        version=row.version,
        token_hash=row.token_hash,
        state=row.state,
        geometry=row.geometry,
        channels=tuple(row.channels),
        start=row.start,
        n_frames=row.n_frames,
        n_events=row.n_events,
        n_segments=row.n_segments,
        frames_kept=row.frames_kept,
        created_at=row.created_at,
        last_seen_at=row.last_seen_at,
        artifact_digest=row.artifact_digest,
        epoch=row.epoch,
    )
