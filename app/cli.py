"""The command ``gesta``."""

from __future__ import annotations

import logging
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

import typer

from app.api.stream_server import StreamServer, stream_config
from app.demo import demo
from app.main import create_app, open_lab
from app.motion.warming import warm
from app.registry.database import Database
from app.service.worker import work
from app.settings import Settings

cli = typer.Typer(
    help="Gesta learns actions from demonstrations, recognises them in streams, re-enacts them.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

RESTART_S = 1.0
"""How long after its end a worker is started again [s]."""


@cli.command()
def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on (GESTA_HOST).")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on (GESTA_PORT).")] = None,
) -> None:
    """Serve the API; with the embedded worker also do the jobs."""
    given = {"host": host, "port": port}
    settings = Settings().model_copy(
        update={name: value for name, value in given.items() if value is not None}
    )
    listener = socket.create_server((settings.host, settings.port), backlog=2048)
    app = create_app(settings)
    config = stream_config(app, log_config=None, access_log=False)
    at, number, *_ = listener.getsockname()
    typer.echo(f"Gesta listens on http://{at}:{number}/v1 (documents: /v1/openapi.json)")
    for number in (signal.SIGTERM, signal.SIGINT):  # uvicorn raises them once more when it has stopped
        signal.signal(number, lambda *_: None)
    with _worker_beside(settings.job_worker == "embedded"):
        StreamServer(config).run([listener])


@cli.command()
def worker(
    embedded: Annotated[bool, typer.Option(hidden=True, help="Stop with the parent.")] = False,
) -> None:
    """Do the jobs: trainings and long recordings."""
    stopped, parent = threading.Event(), os.getppid()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopped.set())
    lab = open_lab(Settings())
    try:
        work(lab, lambda: stopped.is_set() or (embedded and os.getppid() != parent))
    finally:
        lab.close()


@cli.command()
def migrate() -> None:
    """Bring the database to the newest revision; `serve` does it by itself on SQLite."""
    database = Database(Settings().database_url)
    database.migrate()
    database.close()


@cli.command(name="warm")
def warm_up() -> None:
    """Compile what is compiled, so that nothing is when a server starts; for the build of an image."""
    warm()


cli.command()(demo)


@contextmanager
def _worker_beside(wanted: bool) -> Iterator[None]:
    """Keep a worker running in a process of its own; it is started again where it dies."""
    if not wanted:
        yield
        return
    leaving, turn = threading.Event(), threading.Lock()
    children: list[subprocess.Popen[bytes]] = []

    def keep() -> None:
        while True:
            with turn:
                if leaving.is_set():
                    return
                children[:] = [subprocess.Popen([sys.executable, "-m", "app.cli", "worker", "--embedded"])]
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


def main() -> None:
    """Run the command; its log goes to standard error."""
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s: %(message)s", level=logging.INFO)
    logging.getLogger("alembic").setLevel(logging.WARNING)
    cli()


if __name__ == "__main__":
    main()
