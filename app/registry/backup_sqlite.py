"""SQLite databases in a backup: two files, each copied as it is at one moment while others write to it.

The job engine's is copied first. A job that began or ended between the two is known to the registry, which
is the one that counts: the worker enqueues what the engine has not heard of, and does nothing that is done.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from sqlalchemy import make_url
from sqlalchemy.orm import Session

from app.registry import revisions
from app.registry.backup_file import BackupReader, BackupWriter
from app.registry.database import BUSY_S, Database
from app.registry.errors import DatabaseUnavailable

KIND = "sqlite"
REGISTRY, ENGINE = "registry/gesta.db", "engine/gesta-jobs.db"


@contextmanager
def copy_out(database: Database, backup: BackupWriter) -> Iterator[tuple[Session, dict[str, Any]]]:
    """Add both files; give a session that reads the copy, and what the manifest is to tell of it.

    Raises DatabaseUnavailable.
    """
    for name, source in ((ENGINE, _engine_file(database)), (REGISTRY, _file(database))):
        if name == ENGINE and not source.exists():
            continue
        to = backup.folder / Path(name).name
        _copy(source, to)
        backup.add(name, to)
    copied = Database(f"sqlite:///{backup.folder / Path(REGISTRY).name}")
    try:
        with copied.reading() as tx:
            yield tx, {}
    finally:
        copied.close()


def check_empty(database: Database) -> None:
    """Raise NotEmpty if there is anything in the database, whose file need not be there."""
    if _file(database).exists():
        with database.reading() as tx:
            revisions.check_empty(tx)


def copy_in(database: Database, backup: BackupReader) -> None:
    """Fill an empty database with the backup's, brought to the newest revision.

    Each file changes in one transaction, the one that counts last. Raises DatabaseUnavailable.
    """
    folder = _file(database).parent
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder, prefix=".restore-") as temporary:
        for name, target in ((ENGINE, _engine_file(database)), (REGISTRY, _file(database))):
            if name not in backup.names(name):
                continue
            copy = Path(temporary) / target.name
            backup.extract(name, copy)
            if name == REGISTRY:
                prepared = Database(f"sqlite:///{copy}")
                prepared.migrate()
                prepared.close()
            _copy(copy, target)


def _copy(source: Path, target: Path) -> None:
    if not source.exists():
        raise DatabaseUnavailable(f"there is no {source}")
    try:
        with (
            closing(sqlite3.connect(source, timeout=BUSY_S)) as of,
            closing(sqlite3.connect(target, timeout=BUSY_S)) as to,
        ):
            to.execute("PRAGMA synchronous=FULL")
            of.backup(to)
    except sqlite3.OperationalError as error:
        raise DatabaseUnavailable(str(error)) from error


def _file(database: Database) -> Path:
    return Path(str(database.url.database))


def _engine_file(database: Database) -> Path:
    return Path(str(make_url(database.engine_url).database))
