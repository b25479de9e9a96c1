"""The revisions: up, down, and in step with the tables."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import inspect, text
from sqlalchemy.exc import IntegrityError

from app.registry import aliases, models, versions
from app.registry.database import NEWEST, Database, migration_config
from app.registry.tables import metadata


def table_names(database: Database) -> set[str]:
    return set(inspect(database.engine).get_table_names())


def test_the_revisions_make_the_tables_as_the_registry_knows_them(database: Database) -> None:
    with database.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, metadata) == []


def test_foreign_keys_and_checks_are_in_the_database(database: Database) -> None:
    inspector = inspect(database.engine)
    for table in metadata.tables.values():
        found = inspector.get_foreign_keys(table.name)
        assert {key["name"] for key in found} == {key.name for key in table.foreign_key_constraints}
    assert {check["name"] for check in inspector.get_check_constraints("versions")} == {
        "ck_versions_counts_from_one",
        "ck_versions_base_is_older",
    }


def test_the_newest_revision_is_known_without_looking(database: Database) -> None:
    with database.engine.connect() as connection:
        scripts = ScriptDirectory.from_config(migration_config(connection))
        assert scripts.get_current_head() == NEWEST


def test_down_and_up_again(database: Database) -> None:
    before = table_names(database)
    with database.engine.begin() as connection:
        command.downgrade(migration_config(connection), "base")
    assert table_names(database) == {"alembic_version"}
    database.migrate()
    assert table_names(database) == before == set(metadata.tables) | {"alembic_version"}


def test_threads_may_migrate_at_once(database_url: str) -> None:
    databases = [Database(database_url) for _ in range(4)]
    barrier = Barrier(4)

    def migrate(database: Database) -> None:
        barrier.wait()
        database.migrate()

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(migrate, databases))
    for database in databases:
        assert set(metadata.tables) < table_names(database)
        database.close()


def test_processes_may_migrate_at_once(database_url: str) -> None:
    program = "import sys; from app.registry.database import Database; Database(sys.argv[1]).migrate()"
    started = [subprocess.Popen([sys.executable, "-c", program, database_url]) for _ in range(3)]
    assert [process.wait(timeout=60) for process in started] == [0, 0, 0]
    database = Database(database_url)
    assert set(metadata.tables) < table_names(database)
    database.close()


def test_what_the_first_revision_holds_is_there_after_the_newest(database_url: str) -> None:
    database = Database(database_url)
    if database.embedded:
        database.migrate()
    with database.engine.begin() as connection:
        config = migration_config(connection)
        command.upgrade(config, "head")
        command.downgrade(config, "0001")
        connection.execute(
            text(
                "INSERT INTO models (name, objects, table_height_m, features, revision, last_version,"
                " created_at, updated_at) VALUES ('old', '[]', 0, '{}', 'r', 3, '2026-01-01', '2026-01-01')"
            )
        )
    database.migrate()
    with database.transaction() as tx:
        assert models.get(tx, "old").objects == ()
        made = versions.register(
            tx,
            "old",
            artifact_digest="sha256:0",
            actions=["grasp"],
            options={},
            demonstrations=[],
            library_versions={},
        )
        assert made.number == 4
    database.close()


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE version_numbers SET last = 0",
        "DELETE FROM version_numbers",
        "UPDATE versions SET artifact_digest = 'sha256:1'",
        "INSERT INTO versions SELECT model, 7, artifact_digest, actions, options, seed, demonstrations, base,"
        " library_versions, evaluation, 'another', created_at FROM versions",
        "UPDATE aliases SET version = 2",
        "DELETE FROM versions",
    ],
)
def test_the_database_itself_keeps_versions_numbers_and_aliases(database: Database, statement: str) -> None:
    with database.transaction() as tx:
        models.create(tx, name="m", objects=[])
        versions.register(
            tx, "m", artifact_digest="d", actions=[], options={}, demonstrations=[], library_versions={}
        )
        aliases.put(tx, "m", "production", 1)
    with pytest.raises(IntegrityError), database.transaction() as tx:
        tx.execute(text(statement))


def test_numbers_go_on_where_a_deleted_model_ended(database: Database) -> None:
    def train() -> int:
        models.create(tx, name="m", objects=[])
        return versions.register(
            tx, "m", artifact_digest="d", actions=[], options={}, demonstrations=[], library_versions={}
        ).number

    with database.transaction() as tx:
        assert train() == 1
        models.delete(tx, "m")
        assert train() == 2
