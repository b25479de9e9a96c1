"""`gesta serve` as several processes on one socket: none that comes or goes costs a request."""

from __future__ import annotations

import asyncio
import logging
import os
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest

from app.api import supervisor
from app.api.supervisor import Supervisor
from app.motion.model import Model
from app.registry.database import Database
from app.registry.store import Store
from tests.serving import ROOT, Server
from tests.talking import talking

WAIT_S = 60.0
GESTA = [sys.executable, "-W", "error", "-m", "app.cli"]

STAND_IN = """
import os, socket, sys
if os.path.exists(sys.argv[1]):
    sys.exit(3)
line = socket.socket(fileno=int(sys.argv[3]))
line.send(b"r")
line.recv(1)
"""
"""A server that serves nothing; where a file exists it dies at once."""


@dataclass(frozen=True)
class Served:
    """A running `gesta serve`."""

    url: str
    process: subprocess.Popen[str]

    @property
    def children(self) -> set[int]:
        """The processes that it has started."""
        of_threads = Path(f"/proc/{self.process.pid}/task").glob("*/children")
        return {int(pid) for children in of_threads for pid in children.read_text().split()}

    def ask(self) -> int:
        """Ask on a new connection; return the status."""
        return httpx.get(f"{self.url}/v1/models", timeout=WAIT_S).status_code

    def hear(self, words: str) -> None:
        """Read the log until it says this."""
        assert self.process.stderr is not None
        for line in self.process.stderr:
            assert "Traceback" not in line, self.process.stderr.read(8192)
            if words in line:
                return
        raise AssertionError(f"the log ended before {words!r}")


@contextmanager
def served(folder: Path, worker: str = "none") -> Iterator[Served]:
    """Run two server processes, both of them ready."""
    database = f"sqlite:///{folder}/gesta.db"
    given = {"DATABASE_URL": database, "STORE_URL": str(folder / "store"), "JOB_WORKER": worker}
    process = subprocess.Popen(
        [*GESTA, "serve", "--port", "0", "--workers", "2"],
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "PYTHONWARNINGS": "error",
            **{f"GESTA_{name}": value for name, value in given.items()},
        },
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    found = re.search(r"http://[\d.:]+", process.stdout.readline())
    assert found is not None
    running = Served(found[0], process)
    try:
        for _ in range(2):
            running.hear(" serves")
        yield running
    finally:
        process.kill()
        process.wait(WAIT_S)
        process.stderr.read()
        process.stdout.close()
        process.stderr.close()


@contextmanager
def paused(pid: int) -> Iterator[None]:
    """Let a process do nothing for a while."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def test_each_process_serves_and_one_that_is_killed_comes_back(tmp_path: Path) -> None:
    with served(tmp_path) as serving:
        first, second = serving.children
        for other in (first, second):
            with paused(other):
                assert serving.ask() == 200
        os.kill(first, signal.SIGKILL)
        assert serving.ask() == 200
        serving.hear(f"server {first} ended with -9")
        serving.hear(" serves")
        assert len(serving.children) == 2
        with paused(second):
            assert serving.ask() == 200
        serving.process.send_signal(signal.SIGTERM)
        assert serving.process.wait(WAIT_S) == 0


def test_a_rolling_restart_refuses_nobody(tmp_path: Path) -> None:
    statuses: list[int] = []
    with served(tmp_path) as serving:
        old, rolled = serving.children, threading.Event()

        def ask() -> None:
            while not rolled.is_set():
                statuses.append(serving.ask())

        askers = [threading.Thread(target=ask) for _ in range(2)]
        for asker in askers:
            asker.start()
        serving.process.send_signal(signal.SIGHUP)
        serving.hear("2 servers are renewed")
        rolled.set()
        for asker in askers:
            asker.join()
        assert len(statuses) > 10
        assert set(statuses) == {200}
        assert len(serving.children) == 2
        assert old.isdisjoint(serving.children)


def test_a_parent_that_is_killed_leaves_nothing_behind(tmp_path: Path) -> None:
    with served(tmp_path, worker="embedded") as serving:
        commands = [Path(f"/proc/{pid}/cmdline").read_text().split("\0") for pid in serving.children]
        assert sorted(command[3] for command in commands) == ["serve-on", "serve-on", "worker"]
        serving.process.kill()
        assert serving.process.stderr is not None
        assert "Finished server process" in serving.process.stderr.read(), "it ends when all have ended"
        with pytest.raises(httpx.ConnectError):
            serving.ask()


def test_asked_of_one_all_processes_drain(tmp_path: Path, trained: Model) -> None:
    with served(tmp_path) as serving, ExitStack() as stack:
        database = Database(f"sqlite:///{tmp_path}/gesta.db")
        place = Server(serving.url, subprocess.Popen("true"), database, Store(tmp_path / "store"), tmp_path)
        place.wait()
        place.teach(trained)
        database.close()
        talks = []
        for other in serving.children:
            with paused(other):
                talks.append(stack.enter_context(talking(place)))
                talks[-1].start()
        assert httpx.post(f"{serving.url}/v1/server:drain").status_code == 202
        for talk in talks:
            assert talk.rest()[-1]["code"] == "restarting"
            assert talk.said("going_away")
            assert talk.closed_with == 1012
        assert serving.process.wait(WAIT_S) == 0


class Told(logging.Handler):
    """Puts what is logged into a queue."""

    def __init__(self, said: asyncio.Queue[str]) -> None:
        super().__init__()
        self._said = said

    def emit(self, record: logging.LogRecord) -> None:
        self._said.put_nowait(record.getMessage())


@asynccontextmanager
async def supervised(broken: Path) -> AsyncIterator[asyncio.Queue[str]]:
    """Supervise a stand-in that cannot serve where a file exists; give the log."""
    said: asyncio.Queue[str] = asyncio.Queue()
    handler, log = Told(said), logging.getLogger(supervisor.__name__)
    log.addHandler(handler)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        command = [sys.executable, "-c", STAND_IN, str(broken)]
        running = asyncio.create_task(Supervisor(listener, 1, command).run())
        try:
            yield said
        finally:
            log.removeHandler(handler)
            os.kill(os.getpid(), signal.SIGTERM)
            await running


def test_one_that_dies_at_once_is_started_after_ever_longer_pauses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisor, "SHORTEST_S", 0.01)
    monkeypatch.setattr(supervisor, "LONGEST_S", 0.04)
    (tmp_path / "broken").touch()

    async def watch() -> None:
        async with supervised(tmp_path / "broken") as said:
            for pause in ("0.01", "0.02", "0.04", "0.04"):
                assert (await said.get()).endswith(f"ended with 3; next in {pause} s")

    asyncio.run(watch())


def test_a_restart_is_given_up_where_the_new_one_cannot_serve(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, supervisor.__name__)

    async def watch() -> None:
        async with supervised(tmp_path / "broken") as said:
            old = (await said.get()).removesuffix(" serves").removeprefix("server ")
            (tmp_path / "broken").touch()
            os.kill(os.getpid(), signal.SIGHUP)
            assert (await said.get()).endswith("did not get ready: the restart is given up")
            os.kill(int(old), 0)
            (tmp_path / "broken").unlink()
            os.kill(os.getpid(), signal.SIGHUP)
            assert (await said.get()).endswith(" serves")
            assert await said.get() == "1 servers are renewed"
            with pytest.raises(ProcessLookupError):
                os.kill(int(old), 0)

    asyncio.run(watch())
