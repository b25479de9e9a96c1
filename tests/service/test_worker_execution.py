"""One attempt at a job, with what can go wrong put in its way: nothing of it loses the job."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from sqlalchemy.orm import Session

from app.motion.errors import FitFailed
from app.registry import jobs
from app.registry.database import Database
from app.registry.errors import DatabaseUnavailable, JobTakenOver
from app.registry.records import JobRecord
from app.registry.store import Store
from app.service import execution, patience
from app.service.execution import MOST, Json, execute
from app.service.lab import Lab
from app.service.patience import Leaving
from app.service.training import Progress, Stage

KIND = "sums"
Memory = dict[str, Json]


class Weather(Database):
    """A database that is away as often as it is told to be."""

    away = 0

    @contextmanager
    def transaction(self) -> Iterator[Session]:
        if self.away:
            self.away -= 1
            raise DatabaseUnavailable("injected")
        with super().transaction() as tx:
            yield tx


@pytest.fixture
def weather(database_url: str) -> Iterator[Weather]:
    opened = Weather(database_url)
    opened.migrate()
    yield opened
    opened.close()


@pytest.fixture
def lab(weather: Weather, store: Store, monkeypatch: pytest.MonkeyPatch) -> Lab:
    monkeypatch.setattr(patience, "FIRST_S", 1e-4)
    monkeypatch.setattr(execution, "TOLD", 0.0)
    return Lab(weather, store)


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Let the jobs of the test have these stages."""

    def have(*of_job: Stage) -> None:
        named = tuple((str(number), stage) for number, stage in enumerate(of_job))
        monkeypatch.setitem(execution.STAGES, KIND, named)

    return have


def new_job(lab: Lab) -> str:
    with lab.database.transaction() as tx:
        return jobs.create(tx, kind=KIND, request={})[0].id


def get(lab: Lab, job_id: str) -> JobRecord:
    with lab.database.reading() as tx:
        return jobs.get(tx, job_id)


def run(
    lab: Lab, job_id: str, memory: Memory, leaving: threading.Event | None = None, worker: str = "one"
) -> JobRecord:
    """Do a job with a memory of the stages that were ended, as JSON."""

    def remember(name: str, stage: Callable[[], Json]) -> Json:
        if name not in memory:
            memory[name] = json.loads(json.dumps(stage()))
        return memory[name]

    execute(lab, job_id, worker, leaving or threading.Event(), remember)
    return get(lab, job_id)


def one(lab: Lab, job: JobRecord, found: Json, progress: Progress) -> Json:
    progress(1, 2, "one")
    return {"one": 1}


def two(lab: Lab, job: JobRecord, found: Json, progress: Progress) -> Json:
    progress(2, 2, "two")
    return {"sum": found["one"] + 1}


def never(lab: Lab, job: JobRecord, found: Json, progress: Progress) -> Json:
    pytest.fail("this stage was done before, or is not to be done")


def test_stages_follow_each_other_to_the_result(lab: Lab, stages: Callable[..., None]) -> None:
    stages(one, two)
    job = run(lab, new_job(lab), {})
    assert (job.state, job.result, job.attempt, job.worker) == ("succeeded", {"sum": 2}, 1, "one")
    assert (job.done, job.total, job.message) == (2, 2, "two")
    stages(never, never)
    assert run(lab, job.id, {}) == job


def test_a_stage_that_was_ended_is_not_done_again(lab: Lab, stages: Callable[..., None]) -> None:
    def dies(lab: Lab, job: JobRecord, found: Json, progress: Progress) -> Json:
        raise KeyboardInterrupt

    job_id, memory = new_job(lab), Memory()
    stages(one, dies)
    with pytest.raises(KeyboardInterrupt):
        run(lab, job_id, memory)
    assert get(lab, job_id).state == "running"
    stages(never, two)
    job = run(lab, job_id, memory, worker="two")
    assert (job.state, job.result, job.attempt, job.worker) == ("succeeded", {"sum": 2}, 2, "two")


@pytest.mark.parametrize("away", [1, 3, 8])
def test_a_database_that_is_away_fails_nothing(
    lab: Lab, weather: Weather, stages: Callable[..., None], away: int
) -> None:
    def storm(lab: Lab, job: JobRecord, found: Json, progress: Progress) -> Json:
        weather.away = away
        return two(lab, job, found, progress)

    stages(one, storm)
    job_id = new_job(lab)
    weather.away = away
    job = run(lab, job_id, {})
    assert weather.away == 0
    assert (job.state, job.result) == ("succeeded", {"sum": 2})


def test_a_stage_that_finds_the_disk_full_is_tried_again(lab: Lab, stages: Callable[..., None]) -> None:
    full = [OSError("no space left"), OSError("no space left")]

    def writes(lab: Lab, job: JobRecord, found: Json, progress: Progress) -> Json:
        if full:
            raise full.pop()
        return {}

    stages(writes)
    assert run(lab, new_job(lab), {}).state == "succeeded"


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (
            FitFailed("grasp", "is too short"),
            {"code": "fit_failed", "detail": "action 'grasp': is too short"},
        ),
        (
            ValueError("secret"),
            {"code": "internal", "detail": "the job has failed; this is not the client's fault"},
        ),
    ],
)
def test_what_fails_for_good_is_told(
    lab: Lab, stages: Callable[..., None], error: Exception, told: Json
) -> None:
    def fails(lab: Lab, job: JobRecord, found: Json, progress: Progress) -> Json:
        raise error

    for of_job in ((fails,), (fails, never)):
        stages(*of_job)
        job = run(lab, new_job(lab), {})
        assert (job.state, job.error) == ("failed", told)


def test_a_job_is_cancelled_at_its_next_report(lab: Lab, stages: Callable[..., None]) -> None:
    def cancels(lab: Lab, job: JobRecord, found: Json, progress: Progress) -> Json:
        with lab.database.transaction() as tx:
            assert jobs.request_cancel(tx, job.id).state == "running"
        return two(lab, job, {"one": 1}, progress)

    for of_job in ((cancels,), (cancels, never)):
        stages(*of_job)
        assert run(lab, new_job(lab), {}).state == "cancelled"


def test_a_job_that_was_taken_over_is_the_others(lab: Lab, stages: Callable[..., None]) -> None:
    def overtaken(lab: Lab, job: JobRecord, found: Json, progress: Progress) -> Json:
        with lab.database.transaction() as tx:
            jobs.start(tx, job.id, "other")
        return found

    def reports(lab: Lab, job: JobRecord, found: Json, progress: Progress) -> Json:
        overtaken(lab, job, found, progress)
        return two(lab, job, {"one": 1}, progress)

    for stage in (overtaken, reports):
        stages(stage)
        job_id = new_job(lab)
        with pytest.raises(JobTakenOver):
            run(lab, job_id, {})
        job = get(lab, job_id)
        assert (job.state, job.worker, job.attempt, job.done) == ("running", "other", 2, 0)


def test_a_worker_that_leaves_lays_its_job_down(lab: Lab, stages: Callable[..., None]) -> None:
    leaving = threading.Event()

    def goes(lab: Lab, job: JobRecord, found: Json, progress: Progress) -> Json:
        leaving.set()
        return one(lab, job, found, progress)

    stages(goes, two)
    job_id = new_job(lab)
    with pytest.raises(Leaving):
        run(lab, job_id, {}, leaving)
    job = get(lab, job_id)
    assert (job.state, job.worker, job.attempt) == ("queued", None, 1)


def test_a_job_that_its_workers_die_of_fails(lab: Lab, stages: Callable[..., None]) -> None:
    stages(never)
    job_id = new_job(lab)
    for attempt in range(MOST):
        with lab.database.transaction() as tx:
            assert jobs.start(tx, job_id, f"dead {attempt}").attempt == attempt + 1
    job = run(lab, job_id, {})
    assert (job.state, job.error and job.error["code"]) == ("failed", "job_abandoned")


def test_one_that_was_often_laid_down_does_not(lab: Lab, stages: Callable[..., None]) -> None:
    stages(one)
    job_id = new_job(lab)
    for _ in range(2 * MOST):
        with lab.database.transaction() as tx:
            jobs.lay_down(tx, job_id, jobs.start(tx, job_id, "leaving").attempt)
    assert run(lab, job_id, {}).state == "succeeded"
