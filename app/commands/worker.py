"""``gesta worker``: trainings, and recordings that are long."""
# ruff: noqa: PLC0415 (`gesta --help` does not load them)

from __future__ import annotations

import logging
import os
import signal
import threading
from typing import Annotated

import typer

from app.commands.lab import settings


def worker(
    parent: Annotated[int | None, typer.Option(hidden=True, help="Stop with this process.")] = None,
) -> None:
    """Do the jobs: trainings and long recordings."""
    from app.service.lab import open_lab
    from app.service.worker import work

    stopped = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopped.set())
    chosen = settings()
    lab = open_lab(chosen.database_url, chosen.store_url)
    try:
        work(lab, lambda: stopped.is_set() or parent not in (None, os.getppid()))
    finally:
        lab.close()
    logging.shutdown()
    os._exit(0)  # a thread may still be at a kernel: its job is for others by now, nobody waits for it
