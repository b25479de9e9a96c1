"""Dispatch: what holds the registry's jobs, DBOS's workflows and the living workers together.

Every worker looks, none leads. A job without a workflow gets one; a workflow whose worker has left or died
is put back into the queue, and so is one that DBOS regards as over while its job is not. To do so twice is
harmless: the queue gives a workflow to one worker at a time, and the registry heeds the latest attempt.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Iterable

from dbos import DBOS, SetWorkflowID, WorkflowStatus

from app.registry import jobs, workers
from app.service.lab import Lab
from app.service.vigil import Pulses

QUEUE = "jobs"
LOOK_S = 0.5
"""How often all open jobs are looked at, beside new ones [s]."""
WINDOW = 200
"""So many of the oldest open jobs are dispatched; the others wait until it is their turn."""
ENQUEUED, PENDING = "ENQUEUED", "PENDING"


log = logging.getLogger(__name__)


class Dispatcher:
    """Dispatches for one worker; ``running``: the jobs that this one is at."""

    def __init__(self, lab: Lab, worker: str, run: Callable[[str], None], running: Collection[str]) -> None:
        self._lab = lab
        self._worker = worker
        self._run = run
        self._running = running
        self._pulses = Pulses()
        self._seen: tuple[str, ...] = ()
        self._suspected: set[str] = set()
        self._looked = -LOOK_S

    def look(self) -> None:
        """Dispatch new jobs, and all LOOK_S look whether the others go on. Raises DatabaseUnavailable."""
        with self._lab.database.reading() as tx:
            waiting = jobs.unfinished(tx, WINDOW)
        new = set(waiting).difference(self._seen)
        now = time.monotonic()
        if now - self._looked >= LOOK_S:
            self._looked = now
            known = _workflows(waiting)
            self._put_back(known, self._living(now))
        else:
            known = _workflows(new)
        for job_id in waiting:
            if job_id in new and job_id not in known:
                self._enqueue(job_id)
        self._seen = waiting

    def forget(self) -> None:
        """Begin anew after a time in which nothing could be seen."""
        self._seen = ()
        self._suspected.clear()

    def _living(self, now: float) -> set[str]:
        """Return who lives, and take out who is dead."""
        with self._lab.database.reading() as tx:
            beats = workers.beats(tx)
        dead = self._pulses.dead(beats, now) - {self._worker}
        for worker in dead:
            with self._lab.database.transaction() as tx:
                buried = workers.bury(tx, worker, beats[worker])
            if buried:
                log.warning("worker %s is dead", worker)
        return {*beats, self._worker} - dead

    def _put_back(self, known: dict[str, WorkflowStatus], living: set[str]) -> None:
        """Put back what nobody is at; what may have changed since it was read only if it is so again."""
        suspected = set()
        for job_id, workflow in known.items():
            if workflow.status == PENDING and workflow.executor_id not in living:
                log.warning("job %s is taken over from worker %s", job_id, workflow.executor_id)
                DBOS.resume_workflow(job_id, queue_name=QUEUE)
            elif workflow.status == PENDING and workflow.executor_id == self._worker:
                if job_id not in self._running:
                    suspected.add(job_id)
            elif workflow.status not in (PENDING, ENQUEUED):
                suspected.add(job_id)
        for job_id in suspected & self._suspected:
            log.warning("job %s, whose workflow is %s, is put back", job_id, known[job_id].status)
            if known[job_id].status == PENDING:
                DBOS.resume_workflow(job_id, queue_name=QUEUE)
            else:
                DBOS.delete_workflow(job_id)
                self._enqueue(job_id)
        self._suspected = suspected - self._suspected

    def _enqueue(self, job_id: str) -> None:
        with SetWorkflowID(job_id):
            DBOS.enqueue_workflow(QUEUE, self._run, job_id)


def _workflows(job_ids: Iterable[str]) -> dict[str, WorkflowStatus]:
    if not (ids := list(job_ids)):
        return {}
    found = DBOS.list_workflows(workflow_ids=ids, load_input=False, load_output=False)
    return {workflow.workflow_id: workflow for workflow in found}
