"""``gesta migrate``: the database of an older Gesta, or an empty one."""
# ruff: noqa: PLC0415 (`gesta --help` does not load them)

from __future__ import annotations

from app.commands.lab import settings


def migrate() -> None:
    """Bring the database to the newest revision; `serve` does it by itself on SQLite."""
    from app.registry.database import Database

    database = Database(settings().database_url)
    database.migrate()
    database.close()
