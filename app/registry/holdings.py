"""What the registry names in the store: what must be there, and to whom it would be missing."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta
from typing import Any

import sqlalchemy as sa
from sqlalchemy.orm import Session

from app.registry import revisions, tables

CLOCKS = timedelta(hours=1)
"""How far the clocks of the store and of the database may be apart."""


def named(tx: Session) -> dict[str, str]:
    """Return digest -> what has it, such as ``version 3 of model 'table-top'``; of several, one.

    The recording of a job is named for as long as the job is not finished. Tables of older revisions do.
    Raises DatabaseUnavailable where there are none.
    """
    revisions.current(tx)
    found: dict[str, str] = {}
    for holders in (_versions, _demonstrations, _sessions, _jobs, _shown):
        for digest, title in holders(tx):
            found.setdefault(digest, title)
    return found


def at_work_since(tx: Session) -> datetime | None:
    """Return since when jobs may have put into the store what no row names yet; None if none is at work."""
    table = tables.jobs
    oldest: datetime | None = tx.scalar(sa.select(sa.func.min(table.c.created_at)).where(_unfinished()))
    return None if oldest is None else oldest - CLOCKS


def version_title(model: str, number: int) -> str:
    """Return ``version 3 of model 'table-top'``."""
    return f"version {number} of model {model!r}"


def demonstration_title(model: str, id_: str) -> str:
    """Return ``demonstration 0f… of model 'table-top'``."""
    return f"demonstration {id_} of model {model!r}"


def _versions(tx: Session) -> Iterator[tuple[str, str]]:
    table = tables.versions
    for row in tx.execute(sa.select(table.c.model, table.c.number, table.c.artifact_digest)):
        yield row.artifact_digest, version_title(row.model, row.number)


def _demonstrations(tx: Session) -> Iterator[tuple[str, str]]:
    table = tables.demonstrations
    for row in tx.execute(sa.select(table.c.id, table.c.model, table.c.digest, table.c.meta)):
        title = demonstration_title(row.model, row.id)
        yield row.digest, title
        yield from _recording(row.meta, title)


def _sessions(tx: Session) -> Iterator[tuple[str, str]]:
    table = tables.sessions
    if table.c.artifact_digest.name not in _columns(tx, table):
        return
    query = sa.select(table.c.id, table.c.artifact_digest).where(table.c.artifact_digest.is_not(None))
    for row in tx.execute(query):
        yield row.artifact_digest, f"the version of session {row.id}"


def _jobs(tx: Session) -> Iterator[tuple[str, str]]:
    table = tables.jobs
    for row in tx.execute(sa.select(table.c.id, table.c.request).where(_unfinished())):
        yield from _recording(row.request, f"job {row.id}")


def _shown(tx: Session) -> Iterator[tuple[str, str]]:
    """Yield what versions were made of: it outlives the demonstrations that were deleted since."""
    table = tables.versions
    for row in tx.execute(sa.select(table.c.model, table.c.number, table.c.demonstrations)):
        for digest in row.demonstrations:
            yield digest, f"a demonstration that {version_title(row.model, row.number)} was made of"


def _unfinished() -> sa.ColumnElement[bool]:
    return tables.jobs.c.state.in_(("queued", "running"))


def _recording(fields: dict[str, Any], title: str) -> Iterator[tuple[str, str]]:
    digest = fields.get("recording")
    if digest is not None:
        yield digest, f"the recording of {title}"


def _columns(tx: Session, table: sa.Table) -> set[str]:
    return {column["name"] for column in sa.inspect(tx.connection()).get_columns(table.name)}
