"""The real server for tests: uvicorn in a process of its own, on a socket that the test has bound.

The socket listens before the process starts, so a request that comes too early waits in its backlog; once
the test has closed its own copy, nobody holds the socket but the server.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import httpx

from app.api.stream_server import StreamServer, stream_config
from app.main import create_app
from app.motion.model import Model
from app.registry import models, versions
from app.registry.artifacts import dump_model
from app.registry.database import Database
from app.registry.store import Store
from app.service.live import Limits

ROOT = Path(__file__).parents[1]
START_S = 60.0
STOP_S = 30.0


@dataclass(frozen=True)
class Server:
    """A running server, and the database and store that it works on."""

    url: str
    process: subprocess.Popen[bytes]
    database: Database
    store: Store
    log: Path

    @property
    def stream_url(self) -> str:
        """Where its WebSocket is."""
        return f"ws{self.url.removeprefix('http')}/v1/stream"

    def teach(self, model: Model, name: str = "table-top") -> str:
        """Register a trained model as the next version of a model, which is made if there is none."""
        digest = self.store.put(dump_model(model))
        with self.database.transaction() as tx:
            if name not in {record.name for record in models.page(tx, size=1000).records}:
                models.create(tx, name=name, objects=model.features.objects)
            versions.register(
                tx,
                name,
                artifact_digest=digest,
                actions=model.names,
                options={},
                demonstrations=[],
                library_versions={},
            )
        return name

    def terminate(self) -> None:
        """Ask it to stop, and return at once."""
        self.process.send_signal(signal.SIGTERM)

    def wait(self) -> int:
        """Wait until it has stopped; return its exit code."""
        return self.process.wait(STOP_S)


@contextmanager
def serving(
    folder: Path, limits: Limits | None = None, database_url: str | None = None, **settings: object
) -> Iterator[Server]:
    """Run a server on a database and a store in ``folder``; settings: of ``Settings``, by name.

    At the end it is stopped, and must have logged no traceback.
    """
    folder.mkdir(parents=True, exist_ok=True)
    database_url = database_url or f"sqlite:///{folder / 'gesta.db'}"
    given = {"database_url": database_url, "store_url": folder / "store", **settings}
    environment = {f"GESTA_{name.upper()}": str(value) for name, value in given.items()}
    log, database = folder / "server.log", Database(database_url)
    database.migrate()
    with socket.create_server(("127.0.0.1", 0)) as listener, log.open("ab") as output:
        url = f"http://127.0.0.1:{listener.getsockname()[1]}"
        command = [sys.executable, "-W", "error", "-m", "tests.serving", str(listener.fileno())]
        process = subprocess.Popen(
            [*command, json.dumps(asdict(limits or Limits()))],
            cwd=ROOT,
            env={**os.environ, **environment},
            pass_fds=[listener.fileno()],
            stdout=output,
            stderr=output,
        )
    server = Server(url, process, database, Store(folder / "store"), log)
    try:
        _await_ready(server)
        yield server
    finally:
        _stop(server)
    assert "Traceback" not in log.read_text(), log.read_text()


def _await_ready(server: Server) -> None:
    try:
        answer = httpx.get(f"{server.url}/readyz", timeout=START_S)
    except httpx.TransportError as error:
        raise RuntimeError(f"the server did not start: {server.log.read_text()}") from error
    assert answer.status_code == 200, answer.text


def _stop(server: Server) -> None:
    server.terminate()
    try:
        server.wait()
    except subprocess.TimeoutExpired:
        server.process.kill()
        server.process.wait()
        raise
    finally:
        server.database.close()


def main(descriptor: str, limits: str) -> None:
    """Serve on a socket inherited from the test."""
    app = create_app(limits=Limits(**json.loads(limits)))
    config = stream_config(app, log_level="warning", access_log=False)
    StreamServer(config).run([socket.socket(fileno=int(descriptor))])


if __name__ == "__main__":
    main(*sys.argv[1:])
