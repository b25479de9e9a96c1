"""``gesta sweep``: what nothing names leaves the store, in two steps."""
# ruff: noqa: PLC0415 (`gesta --help` does not load them)

from __future__ import annotations

from datetime import timedelta
from typing import Annotated

import typer

from app.commands.lab import opened_lab, refusal, tell_lost


def sweep(
    older_than: Annotated[str, typer.Option(help="ISO 8601 (P7D) or seconds.")] = "P1D",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would be done.")] = False,
) -> None:
    """Take out of the store what nothing names, and tell what is missing there or altered.

    What is taken away is set aside; a sweep that finds it there, as old, deletes it.
    """
    from app.service import upkeep

    age = _age(older_than)
    with opened_lab() as lab:
        swept = upkeep.sweep(lab, age, dry_run=dry_run)
        lost = tuple(upkeep.lost(lab))
    done = "would be " if dry_run else ""
    for what, items in (("set aside", swept.set_aside), ("deleted", swept.deleted)):
        typer.echo(f"{len(items)} objects {done}{what}, {sum(item.size for item in items)} bytes")
    tell_lost(lost)


def _age(told: str) -> timedelta:
    from pydantic import TypeAdapter, ValidationError

    try:
        return timedelta(seconds=float(told))
    except ValueError:
        pass
    try:
        return TypeAdapter(timedelta).validate_python(told)
    except ValidationError as error:
        raise refusal(f"--older-than: {error.errors()[0]['msg']}") from error
