"""The sweep: only what nothing names and is old goes, and it goes in two steps; what is lost is named."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest

from app.registry import demonstrations, jobs, models, versions
from app.registry.database import Database
from app.registry.errors import ArtifactMissing, DatabaseUnavailable
from app.registry.records import NewDemonstration
from app.registry.store import Store, digest_of
from app.service import upkeep
from app.service.lab import Lab
from tests.service.backed_up import MODEL, Writers, check

NOW = timedelta(seconds=-60)
"""An age that everything has, whatever the clock of the store tells."""


@pytest.fixture
def lab(database: Database, store: Store) -> Lab:
    return Lab(database, store)


@pytest.fixture(params=["directory", "bucket"])
def sqlite_lab(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Lab]:
    database = Database(f"sqlite:///{tmp_path / 'gesta.db'}")
    database.migrate()
    bucket = request.param == "bucket"
    yield Lab(database, Store(request.getfixturevalue("s3_url") if bucket else tmp_path / "store"))
    database.close()


def digests(swept: upkeep.Swept) -> tuple[list[str], list[str]]:
    return [item.digest for item in swept.set_aside], [item.digest for item in swept.deleted]


def name(lab: Lab, digest: str) -> None:
    """Let a demonstration have what is in the store."""
    with lab.database.transaction() as tx:
        models.create(tx, name=MODEL, objects=["object"])
        demonstrations.add(tx, MODEL, [NewDemonstration("grasp", digest, 10, 1.0, ("object",), 0.0)])


def test_all_that_is_named_stays(lab: Lab) -> None:
    writers = Writers(lab)
    for number in range(2):
        writers.demonstration(number)
        writers.version(number)
    writers.session(0)
    for _ in range(2):
        assert digests(upkeep.sweep(lab, NOW)) == ([], [])
    check(lab)


def test_an_orphan_is_set_aside_then_deleted(sqlite_lab: Lab) -> None:
    orphan = sqlite_lab.store.put(b"orphan")
    assert digests(upkeep.sweep(sqlite_lab, NOW, dry_run=True)) == ([orphan], [])
    assert digests(upkeep.sweep(sqlite_lab, NOW)) == ([orphan], [])
    assert sqlite_lab.store.get(orphan) == b"orphan"
    assert digests(upkeep.sweep(sqlite_lab, NOW)) == ([], [orphan])
    with pytest.raises(ArtifactMissing):
        sqlite_lab.store.get(orphan)
    assert digests(upkeep.sweep(sqlite_lab, NOW)) == ([], [])


def test_what_is_young_stays(sqlite_lab: Lab) -> None:
    digest = sqlite_lab.store.put(b"orphan")
    assert digests(upkeep.sweep(sqlite_lab, timedelta(hours=1))) == ([], [])
    sqlite_lab.store.set_aside(digest)
    assert digests(upkeep.sweep(sqlite_lab, timedelta(hours=1))) == ([], [])


def test_what_was_named_after_it_was_set_aside_is_brought_back(sqlite_lab: Lab) -> None:
    digest = sqlite_lab.store.put(b"shown")
    upkeep.sweep(sqlite_lab, NOW)
    name(sqlite_lab, digest)
    assert list(upkeep.lost(sqlite_lab)) == []
    assert digests(upkeep.sweep(sqlite_lab, NOW)) == ([], [])
    assert [(held.digest, held.aside) for held in sqlite_lab.store.listing()] == [(digest, False)]


def test_what_is_put_and_named_in_the_midst_of_a_sweep_is_not_lost(
    sqlite_lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    sqlite_lab.store.put(b"shown")
    set_aside = sqlite_lab.store.set_aside

    def too_late(digest: str) -> None:
        name(sqlite_lab, sqlite_lab.store.put(b"shown"))
        set_aside(digest)

    with monkeypatch.context() as patch:
        patch.setattr(sqlite_lab.store, "set_aside", too_late)
        upkeep.sweep(sqlite_lab, NOW)
    for _ in range(2):
        assert list(upkeep.lost(sqlite_lab)) == []
        assert digests(upkeep.sweep(sqlite_lab, NOW)) == ([], [])


def test_what_a_version_was_made_of_outlives_its_demonstrations(lab: Lab) -> None:
    writers = Writers(lab)
    writers.demonstration(0)
    [(_, id_, digest)] = writers.told
    with lab.database.transaction() as tx:
        versions.register(
            tx,
            MODEL,
            artifact_digest=digest_of(b"gone"),
            actions=[],
            options={},
            demonstrations=[digest],
            library_versions={},
        )
        demonstrations.delete(tx, MODEL, id_)
    assert digests(upkeep.sweep(lab, NOW)) == ([], [])
    with lab.database.transaction() as tx:
        models.delete(tx, MODEL)
    assert digests(upkeep.sweep(lab, NOW)) == ([digest], [])


def test_a_recording_is_kept_until_its_job_has_ended_and_so_is_what_was_put_since_it_began(lab: Lab) -> None:
    recording = lab.store.put(b"recording")
    with lab.database.transaction() as tx:
        job, _ = jobs.create(tx, kind="segmentation", request={"recording": recording}, model=MODEL)
    made_so_far = lab.store.put(b"fitted, not yet registered")
    assert digests(upkeep.sweep(lab, NOW)) == ([], [])
    with lab.database.transaction() as tx:
        jobs.request_cancel(tx, job.id)
    assert sorted(digests(upkeep.sweep(lab, NOW))[0]) == sorted([recording, made_so_far])


def test_what_is_lost_is_named(lab: Lab) -> None:
    writers = Writers(lab)
    writers.demonstration(0)
    writers.version(0)
    [id_] = [told[1] for told in writers.told if told[0] == "demonstration"]
    for path in Path(lab.store.url).rglob("*"):
        if path.is_file() and path.read_bytes() == b"shown 0":
            path.write_bytes(b"other")
        elif path.is_file():
            path.unlink()
    assert list(upkeep.lost(lab)) == [
        f"version 1 of model 'table-top': the store does not hold {digest_of(b'version 0')}",
        f"demonstration {id_} of model 'table-top': the store's {digest_of(b'shown 0')} was altered",
    ]


def test_a_database_without_tables_sweeps_nothing_away(database_url: str, store: Store) -> None:
    store.put(b"content")
    lab = Lab(Database(database_url), store)
    with pytest.raises(DatabaseUnavailable):
        upkeep.sweep(lab, NOW)
    assert [held.aside for held in store.listing()] == [False]
    lab.close()
