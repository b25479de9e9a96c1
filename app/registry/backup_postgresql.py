"""PostgreSQL databases in a backup: every table of the registry and of the job engine, as COPY writes it.

All is read in one transaction, which sees one state of the database, and written in one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import sqlalchemy as sa
from alembic import command
from sqlalchemy import Connection, text
from sqlalchemy.orm import Session

from app.registry import revisions
from app.registry.backup_file import BackupReader, BackupWriter
from app.registry.database import MIGRATION_LOCK, Database, migration_config
from app.registry.errors import BackupInvalid, DatabaseUnavailable

KIND = "postgresql"
ENGINE_SCHEMA = "dbos"
FOLDERS = {"registry": None, "engine": ENGINE_SCHEMA}
"""Folder of the backup -> schema, None for the database's own."""
OWN = {"registry": "alembic_version", "engine": "dbos_migrations"}
"""Tables that migrations fill: what is in them is told by the manifest."""

Json = dict[str, Any]


@contextmanager
def copy_out(database: Database, backup: BackupWriter) -> Iterator[tuple[Session, Json]]:
    """Add all tables; give the session that read them, and what the manifest is to tell of them.

    Raises DatabaseUnavailable.
    """
    with database.reading() as tx:
        connection = tx.connection()
        _speak_plainly(connection)
        columns = {}
        for folder, table in _tables(connection):
            name = f"{folder}/{table.name}"
            columns[name] = [column.name for column in table.columns if column.computed is None]
            file = backup.folder / "table"
            with _copying(connection, table, columns[name], "TO STDOUT") as copy, file.open("wb") as to:
                for block in copy:
                    to.write(block)
            backup.add(name, file)
        yield tx, {"columns": columns, "sequences": _sequences(connection), "engine": _engine(connection)}


def check_empty(database: Database) -> None:
    """Raise NotEmpty if there is anything in the database, which need not have tables."""
    with database.reading() as tx:
        revisions.check_empty(tx)


def copy_in(database: Database, backup: BackupReader) -> None:
    """Fill an empty database with the backup's and bring it to the newest revision, in one transaction.

    The engine's tables are there. Raises BackupInvalid, NotEmpty, DatabaseUnavailable.
    """
    with database.transaction() as tx:
        connection = tx.connection()
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": MIGRATION_LOCK})
        for table in revisions.telling(tx):
            connection.execute(text(f"LOCK TABLE {_quoted(connection, table)} IN ACCESS EXCLUSIVE MODE"))
        revisions.check_empty(tx)
        _speak_plainly(connection)
        config = migration_config(connection)
        command.downgrade(config, "base")
        command.upgrade(config, backup.manifest["revision"])
        _check_engine(connection, backup)
        tables = {f"{folder}/{table.name}": table for folder, table in _tables(connection)}
        _check_tables(tables, backup)
        for table in tables.values():
            connection.execute(text(f"ALTER TABLE {_quoted(connection, table)} DISABLE TRIGGER USER"))
        for table in reversed(tables.values()):
            connection.execute(sa.delete(table))
        for name, table in tables.items():
            if name in backup.manifest["columns"]:
                _fill(connection, table, backup, name)
        for name, last in backup.manifest["sequences"].items():
            connection.execute(
                text("SELECT setval(CAST(:name AS regclass), :last)"), {"name": name, "last": last}
            )
        for table in tables.values():
            connection.execute(text(f"ALTER TABLE {_quoted(connection, table)} ENABLE TRIGGER USER"))
        command.upgrade(config, "head")


def _fill(connection: Connection, table: sa.Table, backup: BackupReader, name: str) -> None:
    with _copying(connection, table, backup.manifest["columns"][name], "FROM STDIN") as copy:
        for block in backup.blocks(name):
            copy.write(block)


def _speak_plainly(connection: Connection) -> None:
    """Let values be written in a way that any server reads as they were meant."""
    for setting in ("client_encoding TO 'UTF8'", "datestyle TO 'ISO'", "intervalstyle TO 'postgres'"):
        connection.execute(text(f"SET LOCAL {setting}"))


def _tables(connection: Connection) -> Iterator[tuple[str, sa.Table]]:
    """Yield folder and table, those that others refer to first."""
    for folder, schema in FOLDERS.items():
        found = sa.MetaData()
        found.reflect(connection, schema=schema, resolve_fks=False)
        yield from ((folder, table) for table in found.sorted_tables if table.name != OWN[folder])


@contextmanager
def _copying(connection: Connection, table: sa.Table, columns: list[str], way: str) -> Iterator[Any]:
    """Give a copy of psycopg's: blocks to read, or to be written. Raises DatabaseUnavailable."""
    names = ", ".join(map(connection.dialect.identifier_preparer.quote, columns))
    cursor: Any = connection.connection.cursor()
    try:
        with cursor, cursor.copy(f"COPY {_quoted(connection, table)} ({names}) {way}") as copy:
            yield copy
    except connection.dialect.loaded_dbapi.OperationalError as error:
        raise DatabaseUnavailable(str(error)) from error


def _quoted(connection: Connection, table: sa.Table) -> str:
    return connection.dialect.identifier_preparer.format_table(table)


def _sequences(connection: Connection) -> dict[str, int]:
    """Return where the sequences are that were used."""
    query = (
        "SELECT format('%I.%I', schemaname, sequencename) AS name, last_value FROM pg_sequences "
        "WHERE last_value IS NOT NULL AND schemaname IN (current_schema(), :engine)"
    )
    found = connection.execute(text(query), {"engine": ENGINE_SCHEMA})
    return {row.name: row.last_value for row in found}


def _engine(connection: Connection) -> int:
    """Return the revision of the engine's tables, 0 where there are none."""
    if not sa.inspect(connection).has_table(OWN["engine"], schema=ENGINE_SCHEMA):
        return 0
    migrations = sa.table(OWN["engine"], sa.column("version"), schema=ENGINE_SCHEMA)
    return int(connection.scalar(sa.select(sa.func.max(migrations.c.version))) or 0)


def _check_engine(connection: Connection, backup: BackupReader) -> None:
    if backup.manifest["engine"] > (known := _engine(connection)):
        detail = (
            f"its job engine's tables are of revision {backup.manifest['engine']}, later than {known} here"
        )
        raise BackupInvalid(backup.path, f"{detail}: restore it with the Gesta that made it, or a newer one")


def _check_tables(tables: Mapping[str, sa.Table], backup: BackupReader) -> None:
    """Raise BackupInvalid where the backup has what has no place in these tables."""
    for name, columns in backup.manifest["columns"].items():
        known = tables[name].columns.keys() if name in tables else ()
        if missing := [column for column in columns if column not in known]:
            raise BackupInvalid(backup.path, f"{name} has what Gesta has no place for: {', '.join(missing)}")
