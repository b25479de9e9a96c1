"""What the commands of a server and of its data work on: the settings, and the lab that they name."""
# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from app.service.lab import Lab
    from app.settings import Settings


def settings(**given: str | int | None) -> Settings:
    """Return the settings of the environment under those given; one that is none is told by its variable."""
    from pydantic import ValidationError

    from app.registry.database import Database
    from app.registry.errors import InvalidUrl
    from app.registry.store import Store
    from app.settings import Settings

    try:
        chosen = Settings.model_validate({name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        first = error.errors()[0]
        raise refusal(f"GESTA_{str(first['loc'][0]).upper()}: {first['msg']}") from error
    try:
        Database(chosen.database_url).close()
    except InvalidUrl as error:
        raise refusal(f"GESTA_DATABASE_URL: {error}") from error
    try:
        Store(chosen.store_url)
    except InvalidUrl as error:
        raise refusal(f"GESTA_STORE_URL: {error}") from error
    return chosen


@contextmanager
def opened_lab() -> Iterator[Lab]:
    """Give the lab as it is, not migrated; what goes wrong with it, or with a file, is told."""
    from app.registry.database import Database
    from app.registry.errors import DatabaseUnavailable, RegistryError, StoreUnavailable
    from app.registry.store import Store
    from app.service.lab import Lab

    chosen = settings()
    lab = Lab(Database(chosen.database_url), Store(chosen.store_url))
    try:
        yield lab
    except (DatabaseUnavailable, StoreUnavailable) as error:
        raise refusal(f"{error}: {error.reason}") from error
    except (RegistryError, OSError) as error:
        raise refusal(str(error)) from error
    finally:
        lab.close()


def tell_lost(lost: Sequence[str]) -> None:
    """Tell what is missing or altered, and end with 1 if anything is."""
    for each in lost:
        typer.echo(each, err=True)
    if lost:
        raise typer.Exit(1)


def refusal(message: str) -> typer.Exit:
    """Tell what is wrong with what was given, and return the end of the command: 2."""
    typer.echo(message, err=True)
    return typer.Exit(2)
