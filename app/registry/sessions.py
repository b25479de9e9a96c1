"""Sessions: what each took in and decided, so far as it is durable.

A session's frames and events only ever go on where they end; both counts stand in its row and change in
the transaction that adds to them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, NamedTuple

import sqlalchemy as sa
from sqlalchemy.orm import Session

from app.registry import tables
from app.registry.errors import NotFound, OutOfOrder
from app.registry.paging import page_of
from app.registry.records import Chunk, Page, SessionRecord, SessionState, StoredEvent

table = tables.sessions
frames_table = tables.session_frames
events_table = tables.session_events

_Row = dict[str, Any]


class Addition(NamedTuple):
    """What a session takes in and decides: see ``append``."""

    id: str
    first_seq: int
    rows: bytes
    events: Sequence[StoredEvent]
    ended: bool


def create(
    tx: Session,
    *,
    id_: str,
    model: str,
    version: int,
    token_hash: str,
    geometry: Mapping[str, Any],
    channels: Sequence[str],
    name: str | None = None,
    start: Mapping[str, Any] | None = None,
) -> SessionRecord:
    """Create an active session; token_hash: of its resume token, start: what its client asked for."""
    row = {
        "id": id_,
        "name": name,
        "model": model,
        "version": version,
        "token_hash": token_hash,
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


def append(
    tx: Session,
    id_: str,
    *,
    first_seq: int,
    rows: bytes = b"",
    events: Sequence[StoredEvent] = (),
    ended: bool = False,
) -> SessionRecord:
    """Add frames from ``first_seq`` on and events; ``ended``: they are the last.

    rows: little-endian float64, one value per channel. Raises NotFound, OutOfOrder if they do not go on
    where the session's frames and events end.
    """
    append_all(tx, [Addition(id_, first_seq, rows, events, ended)])
    return get(tx, id_)


def append_all(tx: Session, additions: Sequence[Addition]) -> tuple[str, ...]:
    """Add to sessions, at least one and to each once; return which were over before. See ``append``."""
    query = sa.select(table).where(table.c.id.in_([each.id for each in additions])).order_by(table.c.id)
    known = {row.id: _record(row) for row in tx.execute(query.with_for_update())}
    frames, fresh, changes = list[_Row](), list[_Row](), list[_Row]()
    for each in additions:
        if (session := known.get(each.id)) is None:
            raise NotFound("session", each.id)
        n_frames = _frames_of(session, each, frames) if each.rows else 0
        n_segments = _events_of(session, each.events, fresh)
        changes.append(
            {
                "of": session.id,
                "n_frames": session.n_frames + n_frames,
                "n_events": session.n_events + len(each.events),
                "n_segments": session.n_segments + n_segments,
                "state": "ended" if each.ended else session.state,
                "last_seen_at": tables.now(),
            }
        )
    for into, rows in ((frames_table, frames), (events_table, fresh)):
        if rows:
            tx.execute(sa.insert(into), rows)
    columns: _Row = {name: sa.bindparam(name) for name in changes[0] if name != "of"}
    change = sa.update(table).where(table.c.id == sa.bindparam("of")).values(columns)
    tx.connection().execute(change, changes)
    return tuple(id_ for id_, session in known.items() if session.state != "active")


def end(tx: Session, id_: str, state: SessionState = "ended") -> SessionRecord:
    """End an active session, ``expired`` if nobody came back to it; one that has ended stays as it is.

    Raises NotFound.
    """
    tx.execute(sa.update(table).where(table.c.id == id_, table.c.state == "active").values(state=state))
    return get(tx, id_)


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


def _frames_of(session: SessionRecord, addition: Addition, frames: list[_Row]) -> int:
    """Put down the row of an addition's frames; return how many these are. Raises OutOfOrder."""
    if addition.first_seq != session.n_frames:
        raise OutOfOrder(session.id, "frame", session.n_frames, addition.first_seq)
    n_frames, rest = divmod(len(addition.rows), 8 * len(session.channels))
    if rest:
        raise ValueError(
            f"{len(addition.rows)} bytes are no whole frames of {len(session.channels)} channels"
        )
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


def _row(tx: Session, id_: str) -> sa.Row[Any]:
    row = tx.execute(sa.select(table).where(table.c.id == id_)).one_or_none()
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
    )
