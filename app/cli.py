"""The command ``gesta``.

Each command imports what it needs when it runs: a server loads nothing of the worker, the worker nothing of
the server, and neither waits for the other's libraries.
"""
# ruff: noqa: PLC0415

from __future__ import annotations

import logging
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from app.service.lab import Lab
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
    workers: Annotated[int | None, typer.Option(help="Server processes (GESTA_WORKERS).")] = None,
) -> None:
    """Serve the API; with the embedded worker also do the jobs."""
    settings = _settings(host=host, port=port, workers=workers)
    try:
        listener = socket.create_server((settings.host, settings.port), backlog=2048)
    except OSError as error:
        raise _refusal(f"{settings.host}:{settings.port}: {error.strerror}") from error
    at, number, *_ = listener.getsockname()
    run = _servers(settings, listener) if settings.workers > 1 else _server(settings, listener)
    typer.echo(f"Gesta listens on http://{at}:{number}/v1 (documents: /v1/openapi.json)")
    with _worker_beside(settings.job_worker == "embedded"):
        run()


@cli.command(hidden=True)
def serve_on(listener: int, line: int) -> None:
    """Serve on an open socket: one of the processes of `serve`, at the other end of its line."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # of a terminal that closes; the parent sees to it
    _server(_settings(), socket.socket(fileno=listener), socket.socket(fileno=line))()


@cli.command()
def worker(
    parent: Annotated[int | None, typer.Option(hidden=True, help="Stop with this process.")] = None,
) -> None:
    """Do the jobs: trainings and long recordings."""
    from app.service.lab import open_lab
    from app.service.worker import work

    stopped = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopped.set())
    settings = _settings()
    lab = open_lab(settings.database_url, settings.store_url)
    try:
        work(lab, lambda: stopped.is_set() or parent not in (None, os.getppid()))
    finally:
        lab.close()
    logging.shutdown()
    os._exit(0)  # a thread may still be at a kernel: its job is for others by now, nobody waits for it


@cli.command()
def migrate() -> None:
    """Bring the database to the newest revision; `serve` does it by itself on SQLite."""
    from app.registry.database import Database

    database = Database(_settings().database_url)
    database.migrate()
    database.close()


@cli.command()
def backup(file: Annotated[Path, typer.Argument(help="The tar to write.")]) -> None:
    """Write database, jobs, artifacts and demonstrations to a file, while all goes on."""
    from app.service.backups import back_up

    with _lab() as lab:
        kept = back_up(lab, file)
    typer.echo(f"{file}: {kept.n_artifacts} artifacts and demonstrations, and the database")
    _tell_lost(kept.lost)


@cli.command()
def restore(file: Annotated[Path, typer.Argument(help="The tar that `gesta backup` wrote.")]) -> None:
    """Fill an empty database and a store with a backup; nothing is changed by one that is not whole."""
    from app.service.backups import restore

    with _lab() as lab:
        kept = restore(lab.database, lab.store, file)
    typer.echo(f"{kept.n_artifacts} artifacts and demonstrations are in the store, the database is as it was")
    _tell_lost(kept.lost)


@cli.command()
def sweep(
    older_than: Annotated[str, typer.Option(help="ISO 8601 (P7D) or seconds.")] = "P1D",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would be done.")] = False,
) -> None:
    """Take out of the store what nothing names, and tell what is missing there or altered.

    What is taken away is set aside; a sweep that finds it there, as old, deletes it.
    """
    from app.service import upkeep

    age = _age(older_than)
    with _lab() as lab:
        swept = upkeep.sweep(lab, age, dry_run=dry_run)
        lost = tuple(upkeep.lost(lab))
    done = "would be " if dry_run else ""
    for what, items in (("set aside", swept.set_aside), ("deleted", swept.deleted)):
        typer.echo(f"{len(items)} objects {done}{what}, {sum(item.size for item in items)} bytes")
    _tell_lost(lost)


@cli.command(name="warm")
def warm_up() -> None:
    """Compile what is compiled, so that nothing is when a server starts; for the build of an image."""
    from app.motion.warming import warm

    warm()


@cli.command()
def demo(
    folder: Annotated[Path, typer.Option(help="Where database, models and picture go.")] = Path("demo"),
    speed: Annotated[float, typer.Option(min=0.1, hidden=True, help="Of the stream; 1: real time.")] = 1.0,
) -> None:
    """Show the whole line: demonstrations, training, live recognition, a new movement. Under a minute."""
    from app.demo import demo

    demo(folder, speed)


def _server(
    settings: Settings, listener: socket.socket, line: socket.socket | None = None
) -> Callable[[], None]:
    """Return what serves in this process until it is told to stop."""
    from app.api.stream_server import StreamServer, stream_config
    from app.main import create_app

    config = stream_config(create_app(settings), log_config=None, access_log=False)
    server = StreamServer(config, line)
    for number in (signal.SIGTERM, signal.SIGINT):  # uvicorn raises them once more when it has stopped
        signal.signal(number, server.handle_exit)
    return lambda: server.run([listener])


def _servers(settings: Settings, listener: socket.socket) -> Callable[[], None]:
    """Return what keeps several processes serving until it is told to stop."""
    from app.api.supervisor import supervise

    command = [sys.executable, "-m", "app.cli", "serve-on"]
    return lambda: supervise(listener, settings.workers, command)


@cli.command()
def segment(
    paths: Annotated[list[Path], typer.Argument(help="Recordings (.json, .csv), or directories of them.")],
    model: Annotated[str, typer.Option(help="Whose actions are to be found.")],
    version: Annotated[
        str | None, typer.Option(help="A number, an alias or `latest`; default: production, else the latest.")
    ] = None,
    url: Annotated[str, typer.Option(help="Where the server is.")] = "http://127.0.0.1:8000",
    output: Annotated[
        Path | None, typer.Option(help="File to write: a table if .csv, else JSON lines; default: to stdout.")
    ] = None,
    unit: Annotated[Literal["m", "cm", "mm"], typer.Option(help="Of the positions in .csv files.")] = "m",
    up: Annotated[Literal["z", "y"], typer.Option(help="Axis that is up in .csv files.")] = "z",
) -> None:
    """Find the actions in recordings: a job each, over every worker. The same again does nothing twice."""
    from app.segment import segment

    segment(paths, model, version, url, output, {"length_unit": unit, "up_axis": up})


def _settings(**given: str | int | None) -> Settings:
    """Return the settings of the environment under those given; one that is none is told by its variable."""
    from pydantic import ValidationError

    from app.registry.database import Database
    from app.registry.errors import InvalidUrl
    from app.registry.store import Store
    from app.settings import Settings

    try:
        settings = Settings.model_validate(
            {name: value for name, value in given.items() if value is not None}
        )
    except ValidationError as error:
        first = error.errors()[0]
        raise _refusal(f"GESTA_{str(first['loc'][0]).upper()}: {first['msg']}") from error
    try:
        Database(settings.database_url).close()
    except InvalidUrl as error:
        raise _refusal(f"GESTA_DATABASE_URL: {error}") from error
    try:
        Store(settings.store_url)
    except InvalidUrl as error:
        raise _refusal(f"GESTA_STORE_URL: {error}") from error
    return settings


@contextmanager
def _lab() -> Iterator[Lab]:
    """Give the lab as it is, not migrated; what goes wrong with it, or with a file, is told."""
    from app.registry.database import Database
    from app.registry.errors import DatabaseUnavailable, RegistryError, StoreUnavailable
    from app.registry.store import Store
    from app.service.lab import Lab

    settings = _settings()
    lab = Lab(Database(settings.database_url), Store(settings.store_url))
    try:
        yield lab
    except (DatabaseUnavailable, StoreUnavailable) as error:
        raise _refusal(f"{error}: {error.reason}") from error
    except (RegistryError, OSError) as error:
        raise _refusal(str(error)) from error
    finally:
        lab.close()


def _age(told: str) -> timedelta:
    from pydantic import TypeAdapter, ValidationError

    try:
        return timedelta(seconds=float(told))
    except ValueError:
        pass
    try:
        return TypeAdapter(timedelta).validate_python(told)
    except ValidationError as error:
        raise _refusal(f"--older-than: {error.errors()[0]['msg']}") from error


def _tell_lost(lost: Sequence[str]) -> None:
    """Tell what is missing or altered, and end with 1 if anything is."""
    for each in lost:
        typer.echo(each, err=True)
    if lost:
        raise typer.Exit(1)


def _refusal(message: str) -> typer.Exit:
    typer.echo(message, err=True)
    return typer.Exit(2)


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


def main() -> None:
    """Run the command; its log goes to standard error."""
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s: %(message)s", level=logging.INFO)
    for library in ("alembic", "dbos"):
        logging.getLogger(library).setLevel(logging.WARNING)
    cli()


if __name__ == "__main__":
    main()
