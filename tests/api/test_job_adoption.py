"""Two workers on one database: what one leaves, in order, killed or paused, the other goes on with."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from queue import SimpleQueue

import numpy as np
import pytest
from dbos import DBOSClient

from app.client import GestaClient, trajectory
from app.motion.model import Model
from app.motion.simulation import recording
from app.motion.trajectory import Demonstration
from app.registry.records import JobRecord
from app.service import jobs
from app.service.lab import Lab
from tests.api.conftest import as_sent
from tests.serving import ROOT, Server, serving

GOES_ON_S = 15.0
"""How soon another worker must have gone on with the job of one that was killed [s]."""
PATIENCE_S = 60.0
LEAVES_S = 3.0
"""How soon a worker that is asked to leave must be gone, and its job with another [s]."""


@dataclass(frozen=True)
class Worker:
    """A worker's process, the id by which the registry knows it, and what it says."""

    process: subprocess.Popen[str]
    lines: SimpleQueue[str]
    id: str

    def says(self, text: str) -> None:
        """Wait until it says this."""
        while text not in self.lines.get(timeout=PATIENCE_S):
            pass


@contextmanager
def worker_of(server: Server) -> Iterator[Worker]:
    """Run a worker; it is at work when the block begins."""
    settings = {
        "GESTA_DATABASE_URL": server.database.url.render_as_string(hide_password=False),
        "GESTA_STORE_URL": server.store.url,
    }
    command = [sys.executable, "-m", "app.cli", "worker", "--parent", str(os.getpid())]
    environment = {**os.environ, **settings}
    with (
        server.log.with_name("workers.log").open("a") as log,
        subprocess.Popen(command, cwd=ROOT, env=environment, stderr=subprocess.PIPE, text=True) as process,
    ):
        lines = SimpleQueue[str]()

        def listen() -> None:
            for line in process.stderr or ():
                log.write(line)
                lines.put(line)

        listening = threading.Thread(target=listen)
        listening.start()
        try:
            while not (found := re.search(r"worker (\w+) is at work", lines.get(timeout=PATIENCE_S))):
                pass
            yield Worker(process, lines, found[1])
        finally:
            process.send_signal(signal.SIGCONT)
            process.terminate()
            process.wait(30)
            listening.join()


@pytest.fixture(params=["sqlite", "postgresql"], scope="module")
def server(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server on either kind of database."""
    url = None
    if request.param == "postgresql":
        url = request.getfixturevalue("new_postgresql_database")()
    with serving(tmp_path_factory.mktemp("server"), database_url=url) as running:
        yield running


@pytest.fixture
def two(server: Server) -> Iterator[tuple[Worker, Worker]]:
    """Two workers, which must have logged no traceback."""
    log = server.log.with_name("workers.log")
    log.unlink(missing_ok=True)
    with ExitStack() as stack:
        yield stack.enter_context(worker_of(server)), stack.enter_context(worker_of(server))
    assert "Traceback" not in log.read_text(), log.read_text()


@pytest.fixture
def plenty(client: GestaClient, new_model: Callable[..., str], shown: list[Demonstration]) -> str:
    """A model with so many classes that its training lasts some seconds."""
    model = new_model()
    for number in range(24):
        away = np.array([0.01 * number, 0.0, 0.0])
        moved = [replace(each.trajectory, hand=each.trajectory.hand + away) for each in shown]
        pairs = zip(shown, moved, strict=True)
        of_number = [Demonstration(f"{each.action}-{number}", motion) for each, motion in pairs]
        client.add_demonstrations(model, [as_sent(each) for each in of_number])
    return model


def when(server: Server, job_id: str, holds: Callable[[JobRecord], bool]) -> JobRecord:
    """Watch a job until this holds."""

    async def watch() -> JobRecord:
        watched = jobs.watch(Lab(server.database, server.store), job_id, asyncio.Event())
        return await anext(job async for job in watched if holds(job))

    return asyncio.run(asyncio.wait_for(watch(), PATIENCE_S))


def in_the_midst(
    client: GestaClient, server: Server, model: str, two: tuple[Worker, Worker]
) -> tuple[str, Worker, Worker]:
    """Start a training; return its id, the worker that is in the midst of it, and the other."""
    job_id = client.train(model)["id"]
    at = when(server, job_id, lambda job: job.done > 0)
    busy, free = sorted(two, key=lambda worker: worker.id != at.worker)
    assert busy.id == at.worker
    return job_id, busy, free


def versions_of(client: GestaClient, model: str) -> list[tuple[int, str]]:
    """Return number and job of each version of a model."""
    return sorted(
        (each["version"], each["job_id"]) for each in client.pages(f"/models/{model}/versions", "versions")
    )


def test_a_killed_workers_job_goes_on_with_another(
    client: GestaClient, server: Server, plenty: str, two: tuple[Worker, Worker]
) -> None:
    job_id, busy, free = in_the_midst(client, server, plenty, two)
    busy.process.kill()
    begin = time.monotonic()
    when(server, job_id, lambda job: job.worker == free.id)
    took = time.monotonic() - begin
    print(f"killed: another goes on after {took:.1f} s")
    assert took < GOES_ON_S
    assert client.result(job_id) == {"model": plenty, "version": 1}
    assert versions_of(client, plenty) == [(1, job_id)]


@pytest.mark.parametrize("wakes", ["in the midst", "afterwards"])
def test_a_worker_that_was_only_paused_does_no_harm(
    client: GestaClient, server: Server, plenty: str, two: tuple[Worker, Worker], wakes: str
) -> None:
    job_id, busy, free = in_the_midst(client, server, plenty, two)
    busy.process.send_signal(signal.SIGSTOP)
    when(server, job_id, lambda job: job.worker == free.id)
    if wakes == "afterwards":
        when(server, job_id, lambda job: job.finished)
    busy.process.send_signal(signal.SIGCONT)
    ended = when(server, job_id, lambda job: job.finished)
    assert (ended.state, ended.worker, ended.attempt) == ("succeeded", free.id, 2)
    free.process.terminate()
    free.process.wait(30)
    second = client.train(plenty, options={"n_states": 4})["id"]
    assert client.result(second) == {"model": plenty, "version": 2}, "it was done with the first, then"
    assert when(server, second, lambda job: job.finished).worker == busy.id
    assert when(server, job_id, lambda job: job.finished) == ended
    assert versions_of(client, plenty) == [(1, job_id), (2, second)]


def test_a_worker_that_is_asked_to_leave_hands_its_job_over(
    client: GestaClient, server: Server, plenty: str, two: tuple[Worker, Worker]
) -> None:
    job_id, busy, free = in_the_midst(client, server, plenty, two)
    busy.process.terminate()
    begin = time.monotonic()
    assert busy.process.wait(30) == 0
    left = time.monotonic() - begin
    when(server, job_id, lambda job: job.worker == free.id)
    took = time.monotonic() - begin
    print(f"asked to leave: gone after {left:.1f} s, another goes on after {took:.1f} s")
    assert left < LEAVES_S
    assert took < LEAVES_S + 1.0
    assert client.result(job_id) == {"model": plenty, "version": 1}
    assert versions_of(client, plenty) == [(1, job_id)]


def test_a_workflow_that_is_over_before_its_job_begins_anew(
    client: GestaClient, server: Server, plenty: str
) -> None:
    with worker_of(server) as worker:
        job_id, *_ = in_the_midst(client, server, plenty, (worker, worker))
        behind = DBOSClient(system_database_url=server.database.engine_url)
        behind.cancel_workflow(job_id)
        behind.destroy()
        ended = when(server, job_id, lambda job: job.finished)
    assert (ended.state, ended.attempt) == ("succeeded", 2)
    assert versions_of(client, plenty) == [(1, job_id)]


def test_an_archive_is_shared(
    client: GestaClient, server: Server, trained: Model, two: tuple[Worker, Worker]
) -> None:
    model, motion = server.teach(trained), recording(41, 12).trajectory
    sent = trajectory(motion.times, motion.hand, motion.objects)
    archive = [client.segment(model, 1, sent, as_job=True)["id"] for _ in range(12)]
    [first, *others] = [client.result(job_id) for job_id in archive]
    assert all(other == first for other in others)
    ended = [when(server, job_id, lambda job: job.finished) for job_id in archive]
    assert {job.worker for job in ended} == {worker.id for worker in two}
    assert {job.attempt for job in ended} == {1}
