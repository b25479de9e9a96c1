"""Models: named sets of action models that share one feature specification."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Literal
from uuid import uuid4

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from app.registry.errors import AlreadyExists, InvalidName, NotFound, PreconditionFailed
from app.registry.paging import page_of
from app.registry.records import ModelChanges, ModelRecord, Page
from app.registry.tables import models, now, version_numbers

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


def check_name(kind: Literal["model", "alias"], name: str) -> None:
    """Raise InvalidName if the name could not stand in a path."""
    if not _NAME.fullmatch(name):
        raise InvalidName(
            kind, name, "up to 100 letters, digits and . _ - are a name, the first a letter or a digit"
        )


def create(
    tx: Session,
    *,
    name: str,
    objects: Sequence[str],
    table_height_m: float = 0.0,
    description: str | None = None,
    features: Mapping[str, Any] | None = None,
) -> ModelRecord:
    """Create a model without versions; table height [m]. Raises AlreadyExists, InvalidName.

    Its versions are counted on from those of a deleted model of the same name.
    """
    check_name("model", name)
    at = now()
    row = {
        "name": name,
        "objects": list(objects),
        "table_height_m": table_height_m,
        "description": description,
        "features": dict(features or {}),
        "revision": uuid4().hex,
        "created_at": at,
        "updated_at": at,
    }
    try:
        with tx.begin_nested():
            tx.execute(sa.insert(models).values(row))
    except IntegrityError:
        raise AlreadyExists("model", name) from None
    if tx.scalar(sa.select(version_numbers.c.last).where(version_numbers.c.model == name)) is None:
        tx.execute(sa.insert(version_numbers).values(model=name, last=0))
    return get(tx, name)


def get(tx: Session, name: str) -> ModelRecord:
    """Return a model. Raises NotFound."""
    return _record(_row(tx, name))


def page(tx: Session, *, size: int, after: str | None = None) -> Page[ModelRecord]:
    """List the models by name. Raises InvalidPageToken."""
    return page_of(tx, sa.select(models), models.c.name, _record, size=size, after=after)


def update(tx: Session, name: str, changes: ModelChanges, *, if_match: str | None = None) -> ModelRecord:
    """Change a model if it is still what ``if_match`` names. Raises NotFound, PreconditionFailed."""
    _check_match(lock(tx, name), if_match)
    fresh = {"revision": uuid4().hex, "updated_at": now()}
    tx.execute(sa.update(models).where(models.c.name == name).values(**changes, **fresh))
    return get(tx, name)


def delete(tx: Session, name: str, *, if_match: str | None = None) -> None:
    """Delete a model with its demonstrations, versions, aliases and their history.

    Jobs and sessions stay: they tell what was done; no number of a version comes back. Raises NotFound,
    PreconditionFailed.
    """
    _check_match(lock(tx, name), if_match)
    tx.execute(sa.delete(models).where(models.c.name == name))


def lock(tx: Session, name: str) -> ModelRecord:
    """Return a model and let no other transaction write to it before this one ends. Raises NotFound."""
    return _record(_row(tx, name, for_update=True))


def _row(tx: Session, name: str, *, for_update: bool = False) -> sa.Row[Any]:
    query = sa.select(models).where(models.c.name == name)
    row = tx.execute(query.with_for_update() if for_update else query).one_or_none()
    if row is None:
        raise NotFound("model", name)
    return row


def _check_match(model: ModelRecord, if_match: str | None) -> None:
    """``if_match`` is the header: ``*`` or entity tags with commas between them; None: anything goes."""
    if if_match is None or if_match.strip() == "*":
        return
    if model.etag not in (tag.strip() for tag in if_match.split(",")):
        raise PreconditionFailed("model", model.name)


def _record(row: sa.Row[Any]) -> ModelRecord:
    return ModelRecord(
        name=row.name,
        objects=tuple(row.objects),
        table_height_m=row.table_height_m,
        description=row.description,
        features=row.features,
        etag=f'"{row.revision}"',
        created_at=row.created_at,
        updated_at=row.updated_at,
    )
