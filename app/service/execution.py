"""Execution: one attempt of a worker at a job, stage by stage, to an end or until others have it.

What a stage finds is plain JSON, and all but the last are remembered: whoever goes on with the job begins at
the stage that was not ended. A stage may be done twice, even at once by two workers, one of which was taken
for dead: artifacts are stored by content, and of what is said of a job the registry heeds the latest attempt.
"""

from __future__ import annotations

import logging
import re
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from app.motion.errors import MotionError
from app.registry import jobs
from app.registry.errors import JobTakenOver, RegistryError, Unavailable
from app.registry.records import JobRecord
from app.service import recognition, training
from app.service.errors import JobCancelled, ServiceError
from app.service.lab import Lab
from app.service.patience import Leaving, patiently
from app.service.training import Stage

Json = dict[str, Any]
Remember = Callable[[str, Callable[[], Json]], Json]
"""Does the named stage of a job, or returns what it found when it was done before."""

INTERNAL, ABANDONED = "internal", "job_abandoned"
MOST = 5
"""So many workers may die of a job."""
TOLD = 0.2
"""Shortest time between two reports of progress [s]."""

STAGES: dict[str, tuple[tuple[str, Stage], ...]] = {
    training.KIND: training.STAGES,
    recognition.SEGMENTATION: recognition.STAGES,
    recognition.EVALUATION: recognition.STAGES,
}

log = logging.getLogger(__name__)


def execute(lab: Lab, job_id: str, worker: str, leaving: threading.Event, remember: Remember) -> None:
    """Take a job on and record how it ended; one that has ended is left alone.

    Raises JobTakenOver where another worker has it now, Leaving once it is laid down for others.
    """
    job, worn = patiently(lambda: _start(lab, job_id, worker), leaving)
    if job.finished:
        return
    try:
        if worn:
            detail = f"{MOST} workers in succession ended in the midst of it"
            outcome: Json = {"error": {"code": ABANDONED, "detail": detail}}
        elif job.cancel_requested:
            outcome = {"cancelled": True}
        else:
            outcome = _outcome(lab, job, leaving, remember)
        patiently(lambda: _end(lab, job, outcome), leaving)
    except Leaving:
        with suppress(Unavailable, JobTakenOver), lab.database.transaction() as tx:
            jobs.lay_down(tx, job.id, job.attempt)
        raise


def _start(lab: Lab, job_id: str, worker: str) -> tuple[JobRecord, bool]:
    """Return the job, and whether too many have died of it; who laid it down has not."""
    with lab.database.transaction() as tx:
        before = jobs.get(tx, job_id)
        worn = before.worker is not None and before.attempt >= MOST
        return jobs.start(tx, job_id, worker), worn


def _outcome(lab: Lab, job: JobRecord, leaving: threading.Event, remember: Remember) -> Json:
    """Go through the stages; the last has the result."""
    reporter, found = _Reporter(lab, job, leaving), Json()
    *earlier, (_, last) = STAGES[job.kind]
    for name, stage in earlier:
        outcome = remember(name, partial(_attempt, stage, lab, job, dict(found), reporter, leaving))
        if "result" not in outcome:
            return outcome
        found |= outcome["result"]
    return _attempt(last, lab, job, found, reporter, leaving)


def _attempt(
    stage: Stage, lab: Lab, job: JobRecord, found: Json, reporter: _Reporter, leaving: threading.Event
) -> Json:
    """Return what a stage finds, or why the job is over. Raises JobTakenOver, Leaving."""
    try:
        return {"result": patiently(lambda: stage(lab, job, found, reporter), leaving)}
    except JobCancelled:
        return {"cancelled": True}
    except JobTakenOver:
        raise
    except Exception as error:
        told = _problem(error)
        log.warning("job %s failed: %s", job.id, told["code"], exc_info=told["code"] == INTERNAL)
        return {"error": told}


def _end(lab: Lab, job: JobRecord, outcome: Json) -> None:
    with lab.database.transaction() as tx:
        if "result" in outcome:
            jobs.succeed(tx, job.id, job.attempt, outcome["result"])
        elif "error" in outcome:
            jobs.fail(tx, job.id, job.attempt, outcome["error"])
        else:
            jobs.cancel(tx, job.id, job.attempt)


class _Reporter:
    """Writes a job's progress, seldom enough not to slow it down.

    Raises JobCancelled, JobTakenOver, Leaving. Where the database is away the job goes on untold.
    """

    def __init__(self, lab: Lab, job: JobRecord, leaving: threading.Event) -> None:
        self._lab = lab
        self._job = job
        self._leaving = leaving
        self._told = -TOLD

    def __call__(self, done: int, total: int, message: str) -> None:
        if self._leaving.is_set():
            raise Leaving
        now = time.monotonic()
        if now - self._told < TOLD:
            return
        self._told = now
        with suppress(Unavailable), self._lab.database.transaction() as tx:
            job = jobs.progress(tx, self._job.id, self._job.attempt, done, total, message)
            if job.cancel_requested:
                raise JobCancelled


def _problem(error: Exception) -> dict[str, str]:
    """Return what a client is told of a failure; of one of our own making nothing but that it was one."""
    if isinstance(error, MotionError | RegistryError | ServiceError):
        code = re.sub(r"(?<!^)(?=[A-Z])", "_", type(error).__name__).lower()
        return {"code": code, "detail": str(error)}
    return {"code": INTERNAL, "detail": "the job has failed; this is not the client's fault"}
