"""Jobs and workers in the registry: attempts fence, keys are one model's, beats show who lives."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from sqlalchemy.orm import Session

from app.registry import jobs, workers
from app.registry.database import Database
from app.registry.errors import JobTakenOver
from app.registry.records import JobRecord

SAYS: list[Callable[[Session, str, int], JobRecord]] = [
    lambda tx, id_, attempt: jobs.progress(tx, id_, attempt, 1, 2),
    lambda tx, id_, attempt: jobs.succeed(tx, id_, attempt, {}),
    lambda tx, id_, attempt: jobs.fail(tx, id_, attempt, {}),
    jobs.cancel,
    jobs.lay_down,
]


def created(database: Database, key: str | None = None, model: str = "table-top") -> str:
    with database.transaction() as tx:
        job, _ = jobs.create(tx, kind="training", request={}, model=model, idempotency_key=key, scope=model)
        return job.id


def started(database: Database, id_: str, worker: str = "one") -> JobRecord:
    with database.transaction() as tx:
        return jobs.start(tx, id_, worker)


@pytest.mark.parametrize("say", SAYS)
def test_only_the_latest_attempt_is_heeded(
    database: Database, say: Callable[[Session, str, int], JobRecord]
) -> None:
    id_ = created(database)
    first, second = started(database, id_), started(database, id_, "two")
    assert (first.attempt, second.attempt, second.worker) == (1, 2, "two")
    with pytest.raises(JobTakenOver), database.transaction() as tx:
        say(tx, id_, first.attempt)
    with database.reading() as tx:
        assert jobs.get(tx, id_) == second
    with database.transaction() as tx:
        assert say(tx, id_, second.attempt) != second


def test_the_first_end_stands(database: Database) -> None:
    id_ = created(database)
    attempt = started(database, id_).attempt
    with database.transaction() as tx:
        ended = jobs.succeed(tx, id_, attempt, {"version": 1})
    for say in SAYS:
        with database.transaction() as tx:
            assert say(tx, id_, attempt) == ended
    assert started(database, id_, "two") == ended


def test_a_job_that_was_laid_down_waits_for_anybody(database: Database) -> None:
    id_ = created(database)
    attempt = started(database, id_).attempt
    with database.transaction() as tx:
        laid_down = jobs.lay_down(tx, id_, attempt)
    assert (laid_down.state, laid_down.worker, laid_down.attempt) == ("queued", None, attempt)
    assert started(database, id_, "two").attempt == attempt + 1


def test_the_oldest_open_jobs_come_first(database: Database) -> None:
    ids = [created(database) for _ in range(4)]
    with database.transaction() as tx:
        jobs.request_cancel(tx, ids[1])
    with database.reading() as tx:
        assert jobs.unfinished(tx, 2) == (ids[0], ids[2])


def test_a_name_begins_anew_where_its_jobs_are_released(database: Database) -> None:
    queued, running, ended = (created(database, key) for key in ("a", "b", "c"))
    other = created(database, "a", "other")
    started(database, running)
    with database.transaction() as tx:
        jobs.succeed(tx, ended, jobs.start(tx, ended, "one").attempt, {})
        jobs.release(tx, "table-top")
    with database.reading() as tx:
        found = [jobs.get(tx, id_) for id_ in (queued, running, ended, other)]
    assert [(job.state, job.cancel_requested) for job in found] == [
        ("cancelled", True),
        ("running", True),
        ("succeeded", False),
        ("queued", False),
    ]
    assert created(database, "a") not in (queued, running, ended)
    assert created(database, "a", "other") == other


def test_workers_beat_until_they_leave_or_are_buried(database: Database) -> None:
    with database.transaction() as tx:
        one, two = workers.join(tx), workers.join(tx)
        workers.beat(tx, one)
        assert workers.beats(tx) == {one: 1, two: 0}
        assert not workers.bury(tx, one, 0), "it has beaten since"
        assert workers.bury(tx, one, 1)
        assert not workers.bury(tx, one, 1)
        workers.leave(tx, two)
        assert workers.beats(tx) == {}
        workers.beat(tx, one)
        assert workers.beats(tx) == {one: 0}, "it was only paused"
