"""``gesta serve``: the API on a socket, by one process or several, and the worker beside it."""
# ruff: noqa: PLC0415 (the parent of several servers loads none of what they load)

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from app.commands.lab import refusal, settings

if TYPE_CHECKING:
    from app.settings import Settings

RESTART_S = 1.0
"""How long after its end a worker is started again [s]."""


def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on (GESTA_HOST).")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on (GESTA_PORT).")] = None,
    workers: Annotated[int | None, typer.Option(help="Server processes (GESTA_WORKERS).")] = None,
) -> None:
    """Serve the API; with the embedded worker also do the jobs."""
    chosen = settings(host=host, port=port, workers=workers)
    try:
        listener = socket.create_server((chosen.host, chosen.port), backlog=2048)
    except OSError as error:
        raise refusal(f"{chosen.host}:{chosen.port}: {error.strerror}") from error
    at, number, *_ = listener.getsockname()
    run = _servers(chosen, listener) if chosen.workers > 1 else _server(chosen, listener)
    typer.echo(f"Gesta listens on http://{at}:{number}/v1 (documents: /v1/openapi.json)")
    with _worker_beside(chosen.job_worker == "embedded"):
        run()


def serve_on(listener: int, line: int) -> None:
    """Serve on an open socket: one of the processes of `serve`, at the other end of its line."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # of a terminal that closes; the parent sees to it
    _server(settings(), socket.socket(fileno=listener), socket.socket(fileno=line))()


def _server(
    chosen: Settings, listener: socket.socket, line: socket.socket | None = None
) -> Callable[[], None]:
    """Return what serves in this process until it is told to stop."""
    from app.api.stream_server import StreamServer, stream_config
    from app.main import create_app

    config = stream_config(create_app(chosen), log_config=None, access_log=False)
    server = StreamServer(config, line)
    for number in (signal.SIGTERM, signal.SIGINT):  # uvicorn raises them once more when it has stopped
        signal.signal(number, server.handle_exit)
    return lambda: server.run([listener])


def _servers(chosen: Settings, listener: socket.socket) -> Callable[[], None]:
    """Return what keeps several processes serving until it is told to stop."""
    from app.api.supervisor import supervise

    command = [sys.executable, "-m", "app.cli", "serve-on"]
    return lambda: supervise(listener, chosen.workers, command)


@contextmanager
def _worker_beside(wanted: bool) -> Iterator[None]:
    """Keep a worker running in a process of its own; it is started again where it dies."""
    if not wanted:
        yield
        return
    parent = str(os.getpid())
    leaving, turn = threading.Event(), threading.Lock()
    children: list[subprocess.Popen[bytes]] = []

    def keep() -> None:
        while True:
            with turn:
                if leaving.is_set():
                    return
                command = [sys.executable, "-m", "app.cli", "worker", "--parent", parent]
                children[:] = [subprocess.Popen(command)]  # noqa: S603 (nothing of it comes from outside)
            children[0].wait()
            leaving.wait(RESTART_S)

    keeper = threading.Thread(target=keep)
    keeper.start()
    try:
        yield
    finally:
        with turn:
            leaving.set()
            for child in children:
                child.terminate()
        keeper.join()
