"""The worker: a process of its own that does the jobs, one at a time, each to its end.

The registry's jobs are the truth that clients see; DBOS makes their execution durable. The worker enqueues
every unfinished job under the job's id, so that none is lost between the two and none runs twice at once; a
worker that is killed goes on with its job when it is started again. What a job does may be done again
without harm: artifacts are stored by content, and a version is registered once for each job.
"""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Callable
from typing import Any

from dbos import DBOS, DBOSConfig, DBOSPortableJSONSerializer, SetWorkflowID

from app.motion.errors import MotionError
from app.registry import jobs
from app.registry.errors import RegistryError
from app.registry.records import JobRecord
from app.service import recognition, training
from app.service.errors import JobCancelled, ServiceError
from app.service.lab import Lab
from app.service.training import Progress

QUEUE = "jobs"
POLL = 0.2
"""How often new jobs are looked for [s]."""
INTERNAL = "internal"
TOLD = 0.2
"""Shortest time between two reports of progress [s]."""

HANDLERS: dict[str, Callable[[Lab, JobRecord, Progress], dict[str, Any]]] = {
    training.KIND: training.run_training,
    recognition.SEGMENTATION: recognition.run_recognition,
    recognition.EVALUATION: recognition.run_recognition,
}

log = logging.getLogger(__name__)


def work(lab: Lab, stop: Callable[[], bool]) -> None:
    """Do jobs until ``stop()``."""
    config: DBOSConfig = {
        "name": "gesta",
        "system_database_url": lab.database.engine_url,
        "application_version": "1",
        "executor_id": "worker",
        "serializer": DBOSPortableJSONSerializer(),
        "log_level": "WARNING",
    }
    DBOS(config=config)

    @DBOS.workflow(name="job")
    def run(job_id: str) -> None:
        DBOS.run_step({"name": "work"}, _do, lab, job_id)

    DBOS.launch()
    DBOS.register_queue(QUEUE, worker_concurrency=1, polling_interval_sec=POLL)
    try:
        _dispatch(lab, run, stop)
    finally:
        DBOS.destroy()


def _dispatch(lab: Lab, run: Callable[[str], None], stop: Callable[[], bool]) -> None:
    handed_over: set[str] = set()
    while not stop():
        with lab.database.reading() as tx:
            waiting = {job.id for job in jobs.unfinished(tx)}
        for job_id in waiting - handed_over:
            with SetWorkflowID(job_id):
                DBOS.enqueue_workflow(QUEUE, run, job_id)
        handed_over = waiting
        time.sleep(POLL)


def _do(lab: Lab, job_id: str) -> None:
    """Do a job and record how it ended; one that has ended is left alone."""
    with lab.database.transaction() as tx:
        job = jobs.start(tx, job_id)
    if job.finished:
        return
    try:
        if job.cancel_requested:
            raise JobCancelled
        result = HANDLERS[job.kind](lab, job, _Reporter(lab, job_id))
    except JobCancelled:
        with lab.database.transaction() as tx:
            jobs.cancel(tx, job_id)
    except Exception as error:
        told = _problem(error)
        log.warning("job %s failed: %s", job_id, told["code"], exc_info=told["code"] == INTERNAL)
        with lab.database.transaction() as tx:
            jobs.fail(tx, job_id, told)
    else:
        with lab.database.transaction() as tx:
            jobs.succeed(tx, job_id, result)


class _Reporter:
    """Writes a job's progress, seldom enough not to slow it down; raises JobCancelled."""

    def __init__(self, lab: Lab, job_id: str) -> None:
        self._lab = lab
        self._job_id = job_id
        self._told = -TOLD

    def __call__(self, done: int, total: int, message: str) -> None:
        now = time.monotonic()
        if now - self._told < TOLD:
            return
        self._told = now
        with self._lab.database.transaction() as tx:
            job = jobs.progress(tx, self._job_id, done, total, message)
        if job.cancel_requested:
            raise JobCancelled


def _problem(error: Exception) -> dict[str, str]:
    """Return what a client is told of a failure; of one of our own making nothing but that it was one."""
    if isinstance(error, MotionError | RegistryError | ServiceError):
        code = re.sub(r"(?<!^)(?=[A-Z])", "_", type(error).__name__).lower()
        return {"code": code, "detail": str(error)}
    return {"code": INTERNAL, "detail": "the job has failed; this is not the client's fault"}
