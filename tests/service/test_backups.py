"""Backups: consistent while all is at work, whole or refused, restored to nothing but an empty lab."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import sqlalchemy as sa
from alembic import command

from app.registry import models, revisions, tables, versions
from app.registry.backup_file import BackupWriter
from app.registry.database import NEWEST, Database, migration_config
from app.registry.errors import BackupInvalid, DatabaseUnavailable, NotEmpty, StoreUnavailable
from app.registry.store import Store, digest_of
from app.service.backups import Kept, back_up, restore
from app.service.lab import Lab
from tests.service.backed_up import MODEL, Writers, check, enqueue, enqueued, found

NewLab = Callable[[], Lab]


@pytest.fixture
def new_lab(database_url: str, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[NewLab]:
    """Make labs with a store in a directory and a database without tables, all of one kind."""
    labs: list[Lab] = []

    def make() -> Lab:
        folder = tmp_path / f"lab-{len(labs)}"
        if database_url.startswith("sqlite"):
            url = f"sqlite:///{folder / 'gesta.db'}"
        else:
            url = request.getfixturevalue("new_postgresql_database")()
        labs.append(Lab(Database(url), Store(folder / "store")))
        return labs[-1]

    yield make
    for made in labs:
        made.close()


@pytest.fixture
def lab(new_lab: NewLab) -> Lab:
    made = new_lab()
    made.database.migrate()
    return made


@pytest.fixture
def tar(tmp_path: Path) -> Path:
    return tmp_path / "backup.tar"


def restored(new_lab: NewLab, tar: Path) -> tuple[Lab, Kept]:
    other = new_lab()
    kept = restore(other.database, other.store, tar)
    return other, kept


def test_a_backup_taken_while_all_write_has_what_was_acknowledged(
    lab: Lab, new_lab: NewLab, tar: Path
) -> None:
    writers = Writers(lab)
    enqueue(lab, "first", "second")
    with writers.writing(least=20):
        acknowledged = set(writers.told)
        back_up(lab, tar)
    other, kept = restored(new_lab, tar)
    assert acknowledged <= found(other) <= found(lab)
    assert kept.lost == ()
    check(other)
    assert enqueued(other) == {"first", "second"}


def test_what_was_restored_goes_on_counting(lab: Lab, new_lab: NewLab, tar: Path) -> None:
    writers = Writers(lab)
    for number in range(3):
        writers.version(number)
        writers.demonstration(number)
    back_up(lab, tar)
    other, _ = restored(new_lab, tar)
    assert found(other) == writers.told
    with other.database.transaction() as tx:
        models.delete(tx, MODEL)
    again = Writers(other)
    again.version(0)
    again.demonstration(0)
    assert [told[1] for told in again.told if told[0] == "version"] == [4]
    with other.database.reading() as tx:
        assert tx.scalar(sa.select(sa.func.max(tables.demonstrations.c.position))) in (1, 4)


def test_no_version_of_a_restored_database_can_be_changed(lab: Lab, new_lab: NewLab, tar: Path) -> None:
    Writers(lab).version(0)
    back_up(lab, tar)
    other, _ = restored(new_lab, tar)
    change = sa.update(tables.versions).values(artifact_digest="other")
    with pytest.raises(sa.exc.IntegrityError, match="immutable"), other.database.transaction() as tx:
        tx.execute(change)


def test_what_only_an_unfinished_job_knows_of_is_in_it(lab: Lab, new_lab: NewLab, tar: Path) -> None:
    Writers(lab).job(0)
    made_so_far = lab.store.put(b"fitted, not yet registered")
    back_up(lab, tar)
    other, _ = restored(new_lab, tar)
    assert other.store.get(made_so_far) == b"fitted, not yet registered"


def test_what_nothing_names_is_not_in_it(lab: Lab, new_lab: NewLab, tar: Path) -> None:
    Writers(lab).demonstration(0)
    lab.store.put(b"orphan")
    assert back_up(lab, tar).n_artifacts == 1
    assert restored(new_lab, tar)[1].n_artifacts == 1


def test_what_was_lost_before_is_told_by_name(lab: Lab, new_lab: NewLab, tar: Path) -> None:
    writers = Writers(lab)
    writers.version(0)
    writers.demonstration(0)
    digest = digest_of(b"version 0")
    lab.store.set_aside(digest)
    lab.store.discard(digest)
    told = (f"version 1 of model 'table-top': the store does not hold {digest}",)
    assert back_up(lab, tar) == Kept(1, told)
    other, kept = restored(new_lab, tar)
    assert kept == Kept(1, told)
    assert found(other) == writers.told


def test_it_may_be_restored_to_another_kind_of_store(
    lab: Lab, new_lab: NewLab, tar: Path, s3_url: str
) -> None:
    writers = Writers(lab)
    writers.version(0)
    writers.demonstration(0)
    back_up(lab, tar)
    other = Lab(new_lab().database, Store(s3_url))
    assert restore(other.database, other.store, tar) == Kept(2, ())
    check(other)


def test_a_lab_that_has_something_is_left_alone(lab: Lab, tar: Path) -> None:
    writers = Writers(lab)
    writers.version(0)
    back_up(lab, tar)
    writers.version(1)
    with pytest.raises(NotEmpty, match="models"):
        restore(lab.database, lab.store, tar)
    with lab.database.transaction() as tx:
        models.delete(tx, MODEL)
    with pytest.raises(NotEmpty, match="version numbers"):
        restore(lab.database, lab.store, tar)


def test_tables_that_are_empty_are_filled(lab: Lab, new_lab: NewLab, tar: Path) -> None:
    writers = Writers(lab)
    writers.version(0)
    enqueue(lab, "first")
    back_up(lab, tar)
    other = new_lab()
    other.database.migrate()
    enqueue(other)
    restore(other.database, other.store, tar)
    assert found(other) == writers.told
    assert enqueued(other) == {"first"}


def test_a_restore_that_fails_can_be_begun_again(
    lab: Lab, new_lab: NewLab, tar: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writers = Writers(lab)
    writers.version(0)
    back_up(lab, tar)
    other = new_lab()

    def fails(*_: object) -> None:
        raise OSError(28, "no space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("app.registry.backup_sqlite._copy", fails)
        patch.setattr("app.registry.backup_postgresql._fill", fails)
        with pytest.raises(OSError, match="no space"):
            restore(other.database, other.store, tar)
    restore(other.database, other.store, tar)
    assert found(other) == writers.told


def test_a_backup_of_an_older_revision_is_restored_and_migrated(lab: Lab, new_lab: NewLab, tar: Path) -> None:
    with lab.database.engine.begin() as connection:
        command.downgrade(migration_config(connection), "0001")
        connection.execute(
            sa.text(
                "INSERT INTO models (name, objects, table_height_m, features, revision, last_version, "
                "created_at, updated_at) VALUES ('old', '[]', 0, '{}', 'x', 7, :at, :at)"
            ),
            {"at": "2026-01-01 00:00:00"},
        )
    back_up(lab, tar)
    other, _ = restored(new_lab, tar)
    with other.database.transaction() as tx:
        assert models.get(tx, "old").objects == ()
        assert tx.scalar(sa.text("SELECT version_num FROM alembic_version")) == NEWEST
        made = versions.register(
            tx, "old", artifact_digest="", actions=[], options={}, demonstrations=[], library_versions={}
        )
    assert made.number == 8


def test_a_database_without_tables_has_no_backup(new_lab: NewLab, tar: Path) -> None:
    with pytest.raises(DatabaseUnavailable):
        back_up(new_lab(), tar)
    assert list(tar.parent.glob("*backup*")) == []


def test_a_database_that_goes_away_in_the_midst_leaves_no_part_of_a_backup(
    postgresql_database_url: str, tmp_path: Path, tar: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lab = Lab(Database(postgresql_database_url), Store(tmp_path / "store"))
    lab.database.migrate()
    Writers(lab).version(0)
    everybody = (
        "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
        "WHERE datname = current_database() AND pid <> pg_backend_pid()"
    )

    def goes_away(*_: object) -> None:
        with lab.database.engine.connect() as connection:
            connection.execute(sa.text(everybody))

    with monkeypatch.context() as patch:
        patch.setattr(BackupWriter, "add", goes_away)
        with pytest.raises(DatabaseUnavailable):
            back_up(lab, tar)
    assert not [path for path in tmp_path.iterdir() if "backup" in path.name]
    back_up(lab, tar)
    lab.close()


def test_a_backup_of_the_other_kind_or_of_a_newer_gesta_is_refused(
    lab: Lab, new_lab: NewLab, tar: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Writers(lab).version(0)
    back_up(lab, tar)
    other = new_lab()
    with monkeypatch.context() as patch:
        patch.setattr("app.registry.revisions.known", lambda _: False)
        with pytest.raises(BackupInvalid, match="newer Gesta"):
            restore(other.database, other.store, tar)
    with monkeypatch.context() as patch:
        patch.setattr("app.registry.backup_sqlite.KIND", "another")
        patch.setattr("app.registry.backup_postgresql.KIND", "another")
        with pytest.raises(BackupInvalid, match="this is another"):
            restore(other.database, other.store, tar)
    assert list(other.store.listing()) == []


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.99])
def test_a_part_of_a_backup_changes_nothing(lab: Lab, new_lab: NewLab, tar: Path, share: float) -> None:
    writers = Writers(lab)
    for number in range(5):
        writers.demonstration(number)
    back_up(lab, tar)
    whole = tar.read_bytes().rstrip(b"\0")
    tar.write_bytes(whole[: int(share * len(whole))])
    other = new_lab()
    with pytest.raises(BackupInvalid, match=r"backup\.tar: is"):
        restore(other.database, other.store, tar)
    assert list(other.store.listing()) == []
    if not other.database.embedded:
        with pytest.raises(DatabaseUnavailable), other.database.reading() as tx:
            revisions.current(tx)


def test_a_store_that_takes_nothing_leaves_the_database_empty(lab: Lab, new_lab: NewLab, tar: Path) -> None:
    Writers(lab).version(0)
    back_up(lab, tar)
    other = new_lab()
    Path(other.store.url).parent.mkdir(exist_ok=True)
    Path(other.store.url).touch()
    with pytest.raises(StoreUnavailable):
        restore(other.database, other.store, tar)
    Path(other.store.url).unlink()
    restore(other.database, other.store, tar)
