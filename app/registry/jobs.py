"""Jobs: work that outlasts its request, as its clients see it.

::

    queued ◀─▶ running ──▶ succeeded | failed | cancelled
       └─────────────────▶ cancelled

The first end stands: whatever a late or repeated step says afterwards changes nothing. Whoever takes a job on
counts its attempt up, and from then on nobody may change it who took it on before.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any
from uuid import uuid4

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from app.registry import tables
from app.registry.errors import JobTakenOver, KeyReused, NotFound
from app.registry.paging import page_of
from app.registry.records import JobRecord, JobState, Page

table = tables.jobs
_OPEN = table.c.state.in_(("queued", "running"))


def create(
    tx: Session,
    *,
    kind: str,
    request: Mapping[str, Any],
    model: str | None = None,
    idempotency_key: str | None = None,
    scope: str = "",
) -> tuple[JobRecord, bool]:
    """Create a queued job; return it and True, or the job that this key made in this scope, and False.

    Raises KeyReused if the key came with another request.
    """
    row = {
        "id": (id_ := uuid4().hex),
        "kind": kind,
        "model": model,
        "request": json.loads(json.dumps(dict(request))),
        "state": "queued",
        "done": 0,
        "total": 0,
        "message": "",
        "cancel_requested": False,
        "scope": scope,
        "idempotency_key": idempotency_key,
        "created_at": (at := tables.now()),
        "updated_at": at,
    }
    try:
        with tx.begin_nested():
            tx.execute(sa.insert(table).values(row))
    except IntegrityError:
        return _made_before(tx, row), False
    return get(tx, id_), True


def get(tx: Session, id_: str) -> JobRecord:
    """Return a job. Raises NotFound."""
    row = tx.execute(sa.select(table).where(table.c.id == id_)).one_or_none()
    if row is None:
        raise NotFound("job", id_)
    return _record(row)


def page(
    tx: Session,
    *,
    size: int,
    after: str | None = None,
    state: JobState | None = None,
    model: str | None = None,
) -> Page[JobRecord]:
    """List jobs, newest first. Raises InvalidPageToken."""
    query = sa.select(table)
    if state is not None:
        query = query.where(table.c.state == state)
    if model is not None:
        query = query.where(table.c.model == model)
    return page_of(tx, query, table.c.position, _record, size=size, after=after, newest_first=True)


def unfinished(tx: Session, most: int) -> tuple[str, ...]:
    """Return the ids of the oldest jobs that are queued or running, the oldest first."""
    query = sa.select(table.c.id).where(_OPEN).order_by(table.c.position).limit(most)
    return tuple(tx.scalars(query))


def start(tx: Session, id_: str, worker: str) -> JobRecord:
    """Take a job on; its ``attempt`` is what the worker shows from now on. Raises NotFound."""
    return _change(tx, id_, _OPEN, state="running", attempt=table.c.attempt + 1, worker=worker)


def lay_down(tx: Session, id_: str, attempt: int) -> JobRecord:
    """Let a job that was taken on wait again, for another worker. Raises NotFound, JobTakenOver."""
    return _go_on(tx, id_, attempt, state="queued", worker=None)


def progress(tx: Session, id_: str, attempt: int, done: int, total: int, message: str = "") -> JobRecord:
    """Tell how far a job is. Raises NotFound, JobTakenOver."""
    return _go_on(tx, id_, attempt, done=done, total=total, message=message)


def succeed(tx: Session, id_: str, attempt: int, result: Mapping[str, Any]) -> JobRecord:
    """End a job with its result. Raises NotFound, JobTakenOver."""
    return _go_on(tx, id_, attempt, state="succeeded", result=dict(result))


def fail(tx: Session, id_: str, attempt: int, error: Mapping[str, Any]) -> JobRecord:
    """End a job with a problem object. Raises NotFound, JobTakenOver."""
    return _go_on(tx, id_, attempt, state="failed", error=dict(error))


def cancel(tx: Session, id_: str, attempt: int) -> JobRecord:
    """End a job as it was asked to. Raises NotFound, JobTakenOver."""
    return _go_on(tx, id_, attempt, state="cancelled", cancel_requested=True)


def request_cancel(tx: Session, id_: str) -> JobRecord:
    """Ask a running job to end; a queued one ends at once. Raises NotFound."""
    return _change(tx, id_, _OPEN, **_cancelling())


def release(tx: Session, model: str) -> None:
    """Ask all jobs of a model to end, and let go of its idempotency keys: the name begins anew."""
    of_model = sa.update(table).where(table.c.model == model)
    tx.execute(of_model.where(_OPEN).values(**_cancelling(), updated_at=tables.now()))
    tx.execute(sa.update(table).where(table.c.scope == model).values(idempotency_key=None))


def _cancelling() -> dict[str, Any]:
    queued = table.c.state == "queued"
    return {"state": sa.case((queued, "cancelled"), else_=table.c.state), "cancel_requested": True}


def _go_on(tx: Session, id_: str, attempt: int, **values: Any) -> JobRecord:
    """Change a job that is still that attempt's."""
    job = _change(tx, id_, sa.and_(_OPEN, table.c.attempt == attempt), **values)
    if job.attempt != attempt:
        raise JobTakenOver(id_)
    return job


def _change(tx: Session, id_: str, where: sa.ColumnElement[bool], **values: Any) -> JobRecord:
    tx.execute(sa.update(table).where(table.c.id == id_, where).values(**values, updated_at=tables.now()))
    return get(tx, id_)


def _made_before(tx: Session, row: Mapping[str, Any]) -> JobRecord:
    key = row["idempotency_key"]
    query = sa.select(table).where(table.c.scope == row["scope"], table.c.idempotency_key == key)
    found = _record(tx.execute(query).one())
    if (found.kind, found.model, found.request) != (row["kind"], row["model"], row["request"]):
        raise KeyReused(key)
    return found


def _record(row: sa.Row[Any]) -> JobRecord:
    return JobRecord(
        id=row.id,
        kind=row.kind,
        model=row.model,
        request=row.request,
        state=row.state,
        done=row.done,
        total=row.total,
        message=row.message,
        result=row.result,
        error=row.error,
        cancel_requested=row.cancel_requested,
        attempt=row.attempt,
        worker=row.worker,
        created_at=row.created_at,
        updated_at=row.updated_at,
    )
