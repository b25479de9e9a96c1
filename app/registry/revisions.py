"""Which revision the tables are of, and whether there is anything in them."""

from __future__ import annotations

import sqlalchemy as sa
from alembic.script import ScriptDirectory
from sqlalchemy.orm import Session

from app.registry import tables
from app.registry.database import MIGRATIONS, revision_of
from app.registry.errors import DatabaseUnavailable, NotEmpty


def current(tx: Session) -> str:
    """Return the revision that the tables are of. Raises DatabaseUnavailable where there are none."""
    found = revision_of(tx.connection())
    if found is None:
        raise DatabaseUnavailable("there are no tables of Gesta's in it")
    return found


def known(revision: str) -> bool:
    """Return whether this Gesta knows the revision."""
    script = ScriptDirectory(str(MIGRATIONS))
    return revision in {found.revision for found in script.walk_revisions()}


def check_empty(tx: Session) -> None:
    """Raise NotEmpty if there is anything in the database, which need not have tables."""
    for table in telling(tx):
        if tx.scalar(sa.select(sa.exists().select_from(table))):
            raise NotEmpty(table.name.replace("_", " "))


def telling(tx: Session) -> tuple[sa.Table, ...]:
    """Return the tables that are there of those without which there is nothing in a database."""
    there = set(sa.inspect(tx.connection()).get_table_names())
    return tuple(
        table
        for table in (tables.models, tables.version_numbers, tables.sessions, tables.jobs)
        if table.name in there
    )
