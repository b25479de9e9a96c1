"""The worker: a process of its own that does jobs, one at a time; any number of them share one queue.

The registry's jobs are the truth that clients see; DBOS makes their execution durable. A worker that dies is
missed by the others, who go on with its job at the stage it was at; one that leaves in order lays its job
down for them. What a job does may be done again without harm: see ``execution``.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager

from dbos import DBOS, DBOSConfig, DBOSPortableJSONSerializer

from app.registry import workers
from app.registry.errors import Unavailable
from app.service.dispatch import QUEUE, Dispatcher
from app.service.execution import Json, execute
from app.service.lab import Lab
from app.service.patience import Leaving
from app.service.vigil import Heart

POLL_S = 0.1
"""How often a worker looks for work [s]."""
AWAY_S = 1.0
"""Pause where the database is away [s]."""
LEAVE_S = 1.0
"""How long a worker that leaves waits for its job to be laid down, and for DBOS [s]."""

log = logging.getLogger(__name__)


def work(lab: Lab, stop: Callable[[], bool]) -> None:
    """Do jobs until ``stop()``; then a thread may still be at a kernel, for which nobody is to wait."""
    worker = _joined(lab, stop)
    if worker is None:
        return
    leaving, running = threading.Event(), _Running()
    with Heart(lab, worker):
        run = _launched(lab, worker, leaving, running)
        dispatcher = Dispatcher(lab, worker, run, running)
        threading.Thread(target=_dispatch, args=(dispatcher, leaving), name="dispatcher", daemon=True).start()
        log.info("worker %s is at work", worker)
        try:
            while not stop():
                time.sleep(POLL_S)
        finally:
            leaving.set()
            running.wait_for_none(LEAVE_S)
    ending = threading.Thread(target=DBOS.destroy, name="ending", daemon=True)
    ending.start()
    ending.join(LEAVE_S)


def _joined(lab: Lab, stop: Callable[[], bool]) -> str | None:
    """Join the workers as soon as the database is there; return the id, None where it is to stop."""
    while not stop():
        try:
            with lab.database.transaction() as tx:
                return workers.join(tx)
        except Unavailable as error:
            log.warning("waiting: %s", error)
            time.sleep(AWAY_S)
    return None


def _launched(lab: Lab, worker: str, leaving: threading.Event, running: _Running) -> Callable[[str], None]:
    """Launch DBOS and return the workflow of a job."""
    config: DBOSConfig = {
        "name": "gesta",
        "system_database_url": lab.database.engine_url,
        "application_version": "1",
        "executor_id": worker,
        "serializer": DBOSPortableJSONSerializer(),
        "log_level": "WARNING",
    }
    DBOS(config=config)

    def remember(name: str, stage: Callable[[], Json]) -> Json:
        return DBOS.run_step({"name": name}, stage)

    @DBOS.workflow(name="job")
    def run(job_id: str) -> None:
        with running.at(job_id):
            if leaving.is_set():
                raise Leaving
            execute(lab, job_id, worker, leaving, remember)

    DBOS.launch()
    DBOS.register_queue(QUEUE, worker_concurrency=1, polling_interval_sec=POLL_S)
    return run


def _dispatch(dispatcher: Dispatcher, leaving: threading.Event) -> None:
    """Look for work; whatever goes wrong, look again."""
    pause = POLL_S
    while not leaving.wait(pause):
        try:
            dispatcher.look()
            pause = POLL_S
        except Exception as error:
            log.warning("cannot look for jobs: %s", error, exc_info=not isinstance(error, Unavailable))
            dispatcher.forget()
            pause = AWAY_S


class _Running(Collection[str]):
    """The jobs that the worker is at."""

    def __init__(self) -> None:
        self._jobs: Counter[str] = Counter()
        self._changed = threading.Condition()

    def __contains__(self, job_id: object) -> bool:
        return self._jobs[str(job_id)] > 0

    def __iter__(self) -> Iterator[str]:
        return iter(+self._jobs)

    def __len__(self) -> int:
        return (+self._jobs).total()

    @contextmanager
    def at(self, job_id: str) -> Iterator[None]:
        """Be at a job for as long as the block lasts."""
        with self._changed:
            self._jobs[job_id] += 1
        try:
            yield
        finally:
            with self._changed:
                self._jobs[job_id] -= 1
                self._changed.notify_all()

    def wait_for_none(self, most: float) -> None:
        """Wait until there is none, so long at most [s]."""
        with self._changed:
            self._changed.wait_for(lambda: not len(self), most)
