"""``gesta backup`` and ``gesta restore``: all that a server knows, in a file."""
# ruff: noqa: PLC0415 (`gesta --help` does not load them)

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.commands.lab import opened_lab, tell_lost


def backup(file: Annotated[Path, typer.Argument(help="The tar to write.")]) -> None:
    """Write database, jobs, artifacts and demonstrations to a file, while all goes on."""
    from app.service.backups import back_up

    with opened_lab() as lab:
        kept = back_up(lab, file)
    typer.echo(f"{file}: {kept.n_artifacts} artifacts and demonstrations, and the database")
    tell_lost(kept.lost)


def restore(file: Annotated[Path, typer.Argument(help="The tar that `gesta backup` wrote.")]) -> None:
    """Fill an empty database and a store with a backup; nothing is changed by one that is not whole."""
    from app.service.backups import restore

    with opened_lab() as lab:
        kept = restore(lab.database, lab.store, file)
    typer.echo(f"{kept.n_artifacts} artifacts and demonstrations are in the store, the database is as it was")
    tell_lost(kept.lost)
