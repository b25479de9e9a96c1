"""The database: SQLite or PostgreSQL, its transactions, its migration.

On SQLite a commit is on the disk when it returns (``synchronous=FULL``), readers do not wait for the writer
(``WAL``), and the writers of one process take turns by a lock, for SQLite itself makes them wait by polling.
"""

from __future__ import annotations

import fcntl
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqlalchemy import URL, Connection, Engine, create_engine, event, exc, inspect, make_url, text
from sqlalchemy.orm import Session

from app.registry.errors import DatabaseUnavailable, InvalidUrl

if TYPE_CHECKING:
    from alembic.config import Config

MIGRATIONS = Path(__file__).parents[2] / "migrations"

NEWEST = "0002"
"""The newest revision in MIGRATIONS; a test holds it against alembic's head."""

BUSY_S = 30.0
"""How long a writer waits for the writers of other processes [s]; SQLite only."""

PATIENCE = {
    "connect_timeout": 5,
    "tcp_user_timeout": 15_000,
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "keepalives_count": 3,
}
"""When a PostgreSQL that says nothing is given up: the options of libpq [s], but tcp_user_timeout [ms]."""

MIGRATION_LOCK = 0x6765737461
"""Key of the PostgreSQL advisory lock under which one process at a time migrates."""

_migrating = threading.Lock()
_as_json = partial(json.dumps, allow_nan=False, separators=(",", ":"))


class Database:
    """A database by URL: ``sqlite:///PATH`` or ``postgresql://…``. Raises InvalidUrl."""

    def __init__(self, url: str) -> None:
        self.url = _checked(url)
        self._turn = _Turn()
        if self.url.get_backend_name() == "sqlite":
            self.engine = _sqlite(self.url, "BEGIN IMMEDIATE", "OFF")
            self._reading = _sqlite(self.url, "BEGIN", "ON")
        else:
            self.engine = create_engine(
                self.url, json_serializer=_as_json, pool_pre_ping=True, connect_args=PATIENCE
            )
            self._reading = self.engine.execution_options(
                isolation_level="REPEATABLE READ", postgresql_readonly=True
            )

    @property
    def embedded(self) -> bool:
        """Whether the database is a file of this machine, with no server of its own."""
        return self._path is not None

    @property
    def engine_url(self) -> str:
        """URL of the database of the job engine: a file beside this one, or the same PostgreSQL."""
        url = self.url.set(drivername=self.url.get_backend_name())
        if self._path is not None:
            url = url.set(database=str(self._path.with_name(f"{self._path.stem}-jobs{self._path.suffix}")))
        return url.render_as_string(hide_password=False)

    @contextmanager
    def transaction(self) -> Iterator[Session]:
        """Give a session to write with: committed at the end, rolled back if the block raises.

        Transactions do not nest: RuntimeError. Raises DatabaseUnavailable; where that comes of the commit,
        nobody knows whether it took place.
        """
        with _available(), self._turn.taken(self.embedded), Session(self.engine) as tx, tx.begin():
            yield tx

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """Give a session that sees one state of the database; to write with it is an error.

        Raises DatabaseUnavailable.
        """
        with _available(), Session(self._reading) as tx, tx.begin():
            yield tx

    def migrate(self) -> None:
        """Bring the tables to the newest revision; several processes may do so at once."""
        with _migrating, self._only_one(), self.engine.begin() as connection:
            if self._path is None:
                connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": MIGRATION_LOCK})
            if revision_of(connection) != NEWEST:
                from alembic import command  # noqa: PLC0415 (a server on a new database alone needs it)

                command.upgrade(migration_config(connection), "head")

    def ping(self) -> None:
        """Raise DatabaseUnavailable if the database does not answer, or ProgrammingError without tables."""
        with self.reading() as tx:
            tx.execute(text("SELECT count(*) FROM alembic_version"))

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()
        self._reading.dispose()

    @property
    def _path(self) -> Path | None:
        """The file of an SQLite database."""
        return Path(str(self.url.database)) if self.url.get_backend_name() == "sqlite" else None

    @contextmanager
    def _only_one(self) -> Iterator[None]:
        """Keep other processes from preparing the same SQLite file at the same time."""
        if self._path is None:
            yield
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.with_name(f"{self._path.name}-migrating").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield


class _Turn:
    """Lets one thread of the process write at a time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._mine = threading.local()

    @contextmanager
    def taken(self, one_at_a_time: bool) -> Iterator[None]:
        if getattr(self._mine, "writing", False):
            raise RuntimeError("a transaction was begun within a transaction")
        if one_at_a_time:
            self._lock.acquire()
        self._mine.writing = True
        try:
            yield
        finally:
            self._mine.writing = False
            if one_at_a_time:
                self._lock.release()


@contextmanager
def _available() -> Iterator[None]:
    """Say in the registry's words that the database cannot be used; no message holds its address."""
    try:
        yield
    except (exc.OperationalError, exc.InterfaceError) as error:
        raise DatabaseUnavailable(str(error.orig)) from error
    except exc.TimeoutError as error:
        raise DatabaseUnavailable("all connections are taken") from error


def migration_config(connection: Connection) -> Config:
    """Return the alembic configuration that works on this connection."""
    from alembic.config import Config  # noqa: PLC0415 (see ``migrate``)

    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    config.attributes["connection"] = connection
    return config


def revision_of(connection: Connection) -> str | None:
    """Return the revision that the tables are at, None where there are none."""
    if not inspect(connection).has_table("alembic_version"):
        return None
    found: str | None = connection.scalar(text("SELECT version_num FROM alembic_version"))
    return found


def _checked(url: str) -> URL:
    """Return the URL with its driver. The message never holds the URL: it may hold a password."""
    try:
        parsed = make_url(url)
    except exc.ArgumentError:
        raise InvalidUrl("the database needs sqlite:///PATH or postgresql://USER@HOST/NAME") from None
    if parsed.drivername == "sqlite" and parsed.database and parsed.database != ":memory:":
        return parsed
    if parsed.drivername in ("postgresql", "postgres", "postgresql+psycopg"):
        return parsed.set(drivername="postgresql+psycopg")
    raise InvalidUrl(
        f"the database needs sqlite:///PATH or postgresql://USER@HOST/NAME, not {parsed.drivername}"
    )


def _sqlite(url: URL, begin: str, query_only: str) -> Engine:
    engine = create_engine(
        url, json_serializer=_as_json, connect_args={"timeout": BUSY_S}, pool_size=20, pool_timeout=BUSY_S
    )

    @event.listens_for(engine, "connect")
    def prepare(connection: Any, _record: object) -> None:
        connection.isolation_level = None
        for pragma in (
            "journal_mode=WAL",
            "synchronous=FULL",
            "foreign_keys=ON",
            f"query_only={query_only}",
        ):
            connection.execute(f"PRAGMA {pragma}")

    @event.listens_for(engine, "begin")
    def start(connection: Connection) -> None:
        connection.exec_driver_sql(begin)

    return engine
