"""Versions: immutable, numbered 1, 2, 3… within their model.

No number is ever given out twice, not even where a model was deleted and another takes its name.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import sqlalchemy as sa
from sqlalchemy.orm import Session

from app.registry import models, tables
from app.registry.errors import NotFound
from app.registry.paging import page_of
from app.registry.records import Page, VersionRecord

table = tables.versions


def register(
    tx: Session,
    model: str,
    *,
    artifact_digest: str,
    actions: Sequence[str],
    options: Mapping[str, Any],
    demonstrations: Sequence[str],
    library_versions: Mapping[str, str],
    seed: int | None = None,
    base: int | None = None,
    evaluation: Mapping[str, Any] | None = None,
    job_id: str | None = None,
) -> VersionRecord:
    """Register an artifact that is in the store as the next version of its model.

    demonstrations: digests of what it was trained on; base: the version it goes on from. A job that
    registers a second time, its step having run twice, gets the version it made. Raises NotFound.
    """
    models.lock(tx, model)
    if job_id is not None and (made := _made_by(tx, model, job_id)) is not None:
        return made
    if base is not None:
        get(tx, model, base)
    number = _next_number(tx, model)
    row = {
        "model": model,
        "number": number,
        "artifact_digest": artifact_digest,
        "actions": list(actions),
        "options": dict(options),
        "seed": seed,
        "demonstrations": list(demonstrations),
        "base": base,
        "library_versions": dict(library_versions),
        "evaluation": None if evaluation is None else dict(evaluation),
        "job_id": job_id,
        "created_at": tables.now(),
    }
    tx.execute(sa.insert(table).values(row))
    return get(tx, model, number)


def get(tx: Session, model: str, ref: str | int) -> VersionRecord:
    """Return a version by number, by alias or, with ``latest``, the newest. Raises NotFound."""
    row = tx.execute(_query(model).where(table.c.number == _number(model, str(ref)))).one_or_none()
    if row is None:
        models.get(tx, model)
        raise NotFound("version", f"{model}/{ref}")
    return _with_aliases(tx, model, [_record(row)])[0]


def page(tx: Session, model: str, *, size: int, after: str | None = None) -> Page[VersionRecord]:
    """List the versions of a model, newest first. Raises NotFound, InvalidPageToken."""
    models.get(tx, model)
    found = page_of(tx, _query(model), table.c.number, _record, size=size, after=after, newest_first=True)
    return Page(_with_aliases(tx, model, found.records), found.next_token)


def lineage(tx: Session, model: str, number: int) -> tuple[int, ...]:
    """Return the version's base, that one's base and so on. Raises NotFound."""
    base = get(tx, model, number).base
    query = sa.select(table.c.number, table.c.base).where(table.c.model == model)
    bases = {row.number: row.base for row in tx.execute(query)}
    line = []
    while base is not None:
        line.append(base)
        base = bases[base]
    return tuple(line)


def _query(model: str) -> sa.Select[Any]:
    return sa.select(table).where(table.c.model == model)


def _number(model: str, ref: str) -> sa.ScalarSelect[int] | int:
    """Return the number that a reference stands for, or the query that finds it."""
    if ref.isascii() and ref.isdigit():
        return int(ref) if len(ref) < 10 else 0
    if ref == "latest":
        return sa.select(sa.func.max(table.c.number)).where(table.c.model == model).scalar_subquery()
    aliases = tables.aliases
    named = sa.select(aliases.c.version).where(aliases.c.model == model, aliases.c.alias == ref)
    return named.scalar_subquery()


def _made_by(tx: Session, model: str, job_id: str) -> VersionRecord | None:
    number = tx.scalar(sa.select(table.c.number).where(table.c.model == model, table.c.job_id == job_id))
    return None if number is None else get(tx, model, number)


def _next_number(tx: Session, model: str) -> int:
    numbers = tables.version_numbers
    count_up = sa.update(numbers).where(numbers.c.model == model).values(last=numbers.c.last + 1)
    return int(tx.execute(count_up.returning(numbers.c.last)).scalar_one())


def _with_aliases(tx: Session, model: str, records: Iterable[VersionRecord]) -> tuple[VersionRecord, ...]:
    aliases = tables.aliases
    named = tx.execute(sa.select(aliases).where(aliases.c.model == model).order_by(aliases.c.alias)).all()
    return tuple(
        replace(record, aliases=tuple(row.alias for row in named if row.version == record.number))
        for record in records
    )


def _record(row: sa.Row[Any]) -> VersionRecord:
    return VersionRecord(
        model=row.model,
        number=row.number,
        artifact_digest=row.artifact_digest,
        actions=tuple(row.actions),
        options=row.options,
        seed=row.seed,
        demonstrations=tuple(row.demonstrations),
        base=row.base,
        library_versions=row.library_versions,
        evaluation=row.evaluation,
        job_id=row.job_id,
        created_at=row.created_at,
    )
