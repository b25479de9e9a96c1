"""Aliases: movable names for versions. Each move goes on record in the transaction that makes it."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from sqlalchemy.orm import Session

from app.registry import models, tables, versions
from app.registry.errors import InvalidName, NotFound
from app.registry.paging import page_of
from app.registry.records import AliasChange, AliasRecord, Page

table = tables.aliases
changes = tables.alias_changes


def put(tx: Session, model: str, alias: str, version: int, *, by: str | None = None) -> AliasRecord:
    """Let the alias name a version; to name it again changes nothing. Raises NotFound, InvalidName."""
    _check_name(alias)
    models.lock(tx, model)
    versions.get(tx, model, version)
    current = _find(tx, model, alias)
    if current is None:
        tx.execute(
            sa.insert(table).values(model=model, alias=alias, version=version, updated_at=tables.now())
        )
    elif current.version == version:
        return current
    else:
        tx.execute(
            sa.update(table).where(*_named(model, alias)).values(version=version, updated_at=tables.now())
        )
    previous = None if current is None else current.version
    _note(tx, model, alias, version=version, previous=previous, by=by)
    return get(tx, model, alias)


def get(tx: Session, model: str, alias: str) -> AliasRecord:
    """Return an alias. Raises NotFound."""
    found = _find(tx, model, alias)
    if found is None:
        models.get(tx, model)
        raise NotFound("alias", f"{model}/{alias}")
    return found


def listing(tx: Session, model: str) -> tuple[AliasRecord, ...]:
    """Return all aliases of a model by name. Raises NotFound."""
    models.get(tx, model)
    rows = tx.execute(sa.select(table).where(table.c.model == model).order_by(table.c.alias))
    return tuple(_record(row) for row in rows)


def delete(tx: Session, model: str, alias: str, *, by: str | None = None) -> None:
    """Delete an alias; its history stays. Raises NotFound."""
    models.lock(tx, model)
    former = get(tx, model, alias)
    tx.execute(sa.delete(table).where(*_named(model, alias)))
    _note(tx, model, alias, version=None, previous=former.version, by=by)


def history(tx: Session, model: str, alias: str, *, size: int, after: str | None = None) -> Page[AliasChange]:
    """List the moves of an alias, newest first, also those of a deleted one. Raises NotFound."""
    models.get(tx, model)
    query = sa.select(changes).where(changes.c.model == model, changes.c.alias == alias)
    found = page_of(tx, query, changes.c.position, _change, size=size, after=after, newest_first=True)
    if not found.records and after is None:
        raise NotFound("alias", f"{model}/{alias}")
    return found


def _check_name(alias: str) -> None:
    models.check_name("alias", alias)
    if alias == "latest" or alias.isdigit():
        raise InvalidName("alias", alias, "it already means a version")


def _named(model: str, alias: str) -> tuple[sa.ColumnElement[bool], ...]:
    return table.c.model == model, table.c.alias == alias


def _find(tx: Session, model: str, alias: str) -> AliasRecord | None:
    row = tx.execute(sa.select(table).where(*_named(model, alias))).one_or_none()
    return None if row is None else _record(row)


def _note(
    tx: Session, model: str, alias: str, *, version: int | None, previous: int | None, by: str | None
) -> None:
    row = {"model": model, "alias": alias, "version": version, "previous": previous, "by": by}
    tx.execute(sa.insert(changes).values(**row, at=tables.now()))


def _record(row: sa.Row[Any]) -> AliasRecord:
    return AliasRecord(row.model, row.alias, row.version, row.updated_at)


def _change(row: sa.Row[Any]) -> AliasChange:
    return AliasChange(row.model, row.alias, row.version, row.previous, row.by, row.at)
