"""Demonstrations: a model has each at most once, by the digest of its content.

Their trajectories are in the store. Put there first, acknowledged later: a row never names what is not kept.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from uuid import uuid4

import sqlalchemy as sa
from sqlalchemy.orm import Session

from app.motion.trajectory import Demonstration
from app.registry import models, tables
from app.registry.errors import NotFound
from app.registry.paging import page_of
from app.registry.records import Added, DemonstrationRecord, NewDemonstration, Page

table = tables.demonstrations


def describe(
    demonstration: Demonstration, digest: str, meta: Mapping[str, Any] | None = None
) -> NewDemonstration:
    """Return the row of a demonstration whose payload is in the store."""
    trajectory = demonstration.trajectory
    return NewDemonstration(
        action=demonstration.action,
        digest=digest,
        n_frames=len(trajectory),
        duration_s=float(trajectory.times[-1] - trajectory.times[0]),
        objects=tuple(trajectory.objects),
        table_height_m=demonstration.scene.table_height,
        meta=meta or {},
    )


def add(tx: Session, model: str, items: Sequence[NewDemonstration]) -> Added:
    """Add those demonstrations that the model does not have yet. Raises NotFound."""
    models.lock(tx, model)
    ids = _ids_by_digest(tx, model)
    created: dict[str, NewDemonstration] = {}
    duplicates: dict[str, None] = {}
    for item in items:
        if item.digest in ids:
            duplicates[ids[item.digest]] = None
            continue
        ids[item.digest] = id_ = uuid4().hex
        created[id_] = item
    if created:
        tx.execute(sa.insert(table), [_row(id_, model, item) for id_, item in created.items()])
    return Added(tuple(created), tuple(id_ for id_ in duplicates if id_ not in created))


def get(tx: Session, model: str, id_: str) -> DemonstrationRecord:
    """Return a demonstration of a model. Raises NotFound."""
    return load(tx, model, [id_])[0]


def load(tx: Session, model: str, ids: Sequence[str] | None = None) -> tuple[DemonstrationRecord, ...]:
    """Return the named demonstrations as named, or all in order of arrival. Raises NotFound."""
    models.get(tx, model)
    query = sa.select(table).where(table.c.model == model).order_by(table.c.position)
    if ids is not None:
        query = query.where(table.c.id.in_(ids))
    found = {row.id: _record(row) for row in tx.execute(query)}
    for id_ in ids or ():
        if id_ not in found:
            raise NotFound("demonstration", id_)
    return tuple(found[id_] for id_ in (found if ids is None else ids))


def page(
    tx: Session, model: str, *, size: int, after: str | None = None, action: str | None = None
) -> Page[DemonstrationRecord]:
    """List demonstrations in order of arrival. Raises NotFound, InvalidPageToken."""
    models.get(tx, model)
    query = sa.select(table).where(table.c.model == model)
    if action is not None:
        query = query.where(table.c.action == action)
    return page_of(tx, query, table.c.position, _record, size=size, after=after)


def counts(tx: Session, model: str) -> dict[str, int]:
    """Return the number of demonstrations of each action class, by name. Raises NotFound."""
    models.get(tx, model)
    query = sa.select(table.c.action, sa.func.count()).where(table.c.model == model).group_by(table.c.action)
    return dict(sorted((action, number) for action, number in tx.execute(query)))


def delete(tx: Session, model: str, id_: str) -> None:
    """Delete a demonstration; its payload stays for the versions that were made of it. Raises NotFound."""
    get(tx, model, id_)
    tx.execute(sa.delete(table).where(table.c.model == model, table.c.id == id_))


def _ids_by_digest(tx: Session, model: str) -> dict[str, str]:
    query = sa.select(table.c.digest, table.c.id).where(table.c.model == model)
    return {row.digest: row.id for row in tx.execute(query)}


def _row(id_: str, model: str, item: NewDemonstration) -> dict[str, Any]:
    return {
        "id": id_,
        "model": model,
        "action": item.action,
        "digest": item.digest,
        "n_frames": item.n_frames,
        "duration_s": item.duration_s,
        "objects": list(item.objects),
        "table_height_m": item.table_height_m,
        "meta": dict(item.meta),
        "created_at": tables.now(),
    }


def _record(row: sa.Row[Any]) -> DemonstrationRecord:
    return DemonstrationRecord(
        id=row.id,
        model=row.model,
        action=row.action,
        digest=row.digest,
        n_frames=row.n_frames,
        duration_s=row.duration_s,
        objects=tuple(row.objects),
        table_height_m=row.table_height_m,
        meta=row.meta,
        created_at=row.created_at,
    )
