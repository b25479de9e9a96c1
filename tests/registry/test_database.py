"""Transactions: all or nothing, one writer at a time, readers apart, and what cannot be opened."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError

from app.registry import models
from app.registry.database import Database
from app.registry.errors import AlreadyExists, DatabaseUnavailable, InvalidUrl, NotFound


def test_a_block_that_raises_leaves_nothing(database: Database) -> None:
    def create_and_fail() -> None:
        with database.transaction() as tx:
            models.create(tx, name="table-top", objects=["object"])
            raise KeyError

    with pytest.raises(KeyError):
        create_and_fail()
    with database.reading() as tx, pytest.raises(NotFound):
        models.get(tx, "table-top")


def test_transactions_do_not_nest(database: Database) -> None:
    with database.transaction(), pytest.raises(RuntimeError), database.transaction():
        pass
    with database.transaction() as tx:
        models.create(tx, name="table-top", objects=[])


def test_to_write_while_reading_is_an_error(database: Database) -> None:
    with pytest.raises((DBAPIError, DatabaseUnavailable)), database.reading() as tx:
        models.create(tx, name="table-top", objects=[])


def test_a_reader_sees_one_state_and_does_not_stop_the_writer(database: Database) -> None:
    with database.reading() as reading:
        assert models.page(reading, size=9).records == ()
        with database.transaction() as tx:
            models.create(tx, name="table-top", objects=[])
        assert models.page(reading, size=9).records == ()
    with database.reading() as reading:
        assert models.get(reading, "table-top").name == "table-top"


def test_writers_of_many_threads_all_get_their_turn(database: Database) -> None:
    barrier = Barrier(8)

    def create(number: int) -> None:
        barrier.wait()
        for part in range(5):
            with database.transaction() as tx:
                models.create(tx, name=f"model-{number}-{part}", objects=[])

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(create, range(8)))
    with database.reading() as tx:
        assert len(models.page(tx, size=100).records) == 40


def test_of_two_who_want_a_name_one_gets_it(database: Database) -> None:
    barrier = Barrier(2)

    def create(_: int) -> bool:
        barrier.wait()
        try:
            with database.transaction() as tx:
                models.create(tx, name="table-top", objects=[])
        except AlreadyExists:
            return False
        return True

    with ThreadPoolExecutor(2) as pool:
        assert sorted(pool.map(create, range(2))) == [False, True]


def test_what_was_committed_outlives_the_process(database: Database, database_url: str) -> None:
    program = (
        "import os, signal, sys\n"
        "from app.registry import models\n"
        "from app.registry.database import Database\n"
        "with Database(sys.argv[1]).transaction() as tx:\n"
        "    models.create(tx, name='table-top', objects=['object'])\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    killed = subprocess.run([sys.executable, "-c", program, database_url], check=False, timeout=60)
    assert killed.returncode == -9
    with database.reading() as tx:
        assert models.get(tx, "table-top").objects == ("object",)


def test_sqlite_writes_through_to_the_disk_and_checks_references(sqlite_database_url: str) -> None:
    database = Database(sqlite_database_url)
    database.migrate()
    with database.transaction() as tx:
        found = {name: tx.scalar(text(f"PRAGMA {name}")) for name in ("synchronous", "foreign_keys")}
        assert found == {"synchronous": 2, "foreign_keys": 1}
        assert tx.scalar(text("PRAGMA journal_mode")) == "wal"
    database.close()


def test_text_that_no_database_holds_finds_nothing_and_is_kept_without_it(database: Database) -> None:
    with database.transaction() as tx:
        made = models.create(tx, name="m", objects=["\0\ud800"], description="a\0b\ud800c")
        assert made.description == "a\ufffdb\ufffdc"
        assert made.objects == ("\0\ud800",)
        with pytest.raises(NotFound):
            models.get(tx, "\0")


def test_no_json_holds_a_number_that_is_not_finite(database: Database) -> None:
    with pytest.raises(Exception, match="JSON compliant"), database.transaction() as tx:
        models.create(tx, name="table-top", objects=[], features={"rate": float("nan")})


def test_ping_raises_where_nothing_answers(tmp_path: Path) -> None:
    for url in (f"sqlite:///{tmp_path}/absent/gesta.db", "postgresql://gesta:hidden@127.0.0.1:1/gesta"):
        database = Database(url)
        with pytest.raises(DatabaseUnavailable) as raised:
            database.ping()
        assert "hidden" not in str(raised.value)
        database.close()


@pytest.mark.parametrize(
    "url",
    ["sqlite://", "sqlite:///:memory:", "mysql://u:hidden@h/d", "no url: hidden", "sqlite+aiosqlite:///a.db"],
)
def test_an_unknown_kind_of_database_is_refused_without_its_password(url: str) -> None:
    with pytest.raises(InvalidUrl) as raised:
        Database(url)
    assert "hidden" not in str(raised.value)
