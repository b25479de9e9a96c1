"""A real server for a load: a process bound to one core, with the recogniser or a spin in its place.

What it listens on is handed over as an open socket; it runs what ``gesta serve`` runs, without the worker.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.api.stream_server import StreamServer, stream_config
from app.demo import stop
from app.main import create_app
from app.motion.hypothesis import Expected, Hypothesis
from app.motion.model import Model
from app.motion.recogniser import Event
from app.motion.state import State
from app.motion.trajectory import Floats
from app.registry import models, versions
from app.registry.artifacts import dump_model
from app.registry.database import Database
from app.registry.store import Store
from app.service import session_start

NAME = "load"
"""Of the model that is streamed to."""
ROOT = Path(__file__).parents[1]
START_S = 60.0


@dataclass(frozen=True)
class Cost:
    """What is spent in place of a recogniser, of the thread's own time: a frame, a hypothesis [ns]."""

    frame: float
    hypothesis: float


class Spin:
    """Takes the place of a recogniser: it spends the time and finds nothing."""

    cost: Cost

    def __init__(self, *_: Any, **__: Any) -> None:
        self._n_frames = 0

    def take(self, times: Floats, _: Floats) -> list[Event]:
        """Spend the time of these frames."""
        self._n_frames += len(times)
        _spend(len(times) * self.cost.frame)
        return []

    def finish(self) -> list[Event]:
        """Return nothing."""
        return []

    def state(self) -> State:
        """Return nothing."""
        return {}

    def hypothesis(self) -> Hypothesis:
        """Spend the time of a hypothesis."""
        _spend(self.cost.hypothesis)
        return Hypothesis(0, self._n_frames - 1, (Expected("rest", 1.0, None),), {})


@dataclass(frozen=True)
class Place:
    """A running server: its port, and the id of its process."""

    port: int
    pid: int

    @property
    def memory(self) -> int:
        """What it keeps in memory [bytes]."""
        pages = int(Path(f"/proc/{self.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE")


def register(folder: Path, model: Model) -> None:
    """Make a database and a store in ``folder`` that know the model."""
    database, store = Database(settings_of(folder)["GESTA_DATABASE_URL"]), Store(folder / "store")
    database.migrate()
    digest = store.put(dump_model(model))
    with database.transaction() as tx:
        models.create(tx, name=NAME, objects=model.features.objects)
        versions.register(
            tx,
            NAME,
            artifact_digest=digest,
            actions=model.names,
            options={},
            demonstrations=[],
            library_versions={},
        )
    database.close()


@contextmanager
def serving(folder: Path, core: int, spin: Cost | None = None) -> Iterator[Place]:
    """Run a server on what is registered in ``folder``; spin: what it spends in place of recognising."""
    log = folder / f"server-{core}.log"
    with socket.create_server(("127.0.0.1", 0), backlog=2048) as listener, log.open("ab") as output:
        cost = [] if spin is None else [str(spin.frame), str(spin.hypothesis)]
        process = subprocess.Popen(
            [sys.executable, __file__, str(listener.fileno()), str(core), *cost],
            cwd=ROOT,
            env={**os.environ, **settings_of(folder)},
            pass_fds=[listener.fileno()],
            stdout=output,
            stderr=output,
        )
        port = listener.getsockname()[1]
    try:
        try:
            httpx.get(f"http://127.0.0.1:{port}/readyz", timeout=START_S).raise_for_status()
        except httpx.HTTPError as error:
            raise RuntimeError(f"the server did not start: {log.read_text()}") from error
        yield Place(port, process.pid)
    finally:
        stop(process)


def settings_of(folder: Path) -> dict[str, str]:
    """Return the variables of a process that works on what is in ``folder``."""
    return {
        "GESTA_DATABASE_URL": f"sqlite:///{folder / 'gesta.db'}",
        "GESTA_STORE_URL": str(folder / "store"),
    }


def _spend(nanoseconds: float) -> None:
    begin = time.thread_time_ns()
    while time.thread_time_ns() - begin < nanoseconds:
        pass


def main(descriptor: str, core: str, *cost: str) -> None:
    """Serve on an inherited socket, on one core."""
    os.sched_setaffinity(0, {int(core)})
    if cost:
        Spin.cost = Cost(*map(float, cost))
        vars(session_start)["Recogniser"] = Spin
    config = stream_config(create_app(), log_level="warning", access_log=False)
    StreamServer(config).run([socket.socket(fileno=int(descriptor))])


if __name__ == "__main__":
    main(*sys.argv[1:])
