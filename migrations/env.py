"""Where alembic runs the revisions: on the connection that ``Database.migrate`` hands over.

Write a new revision with ``alembic -x database=URL revision --autogenerate -m WHY`` (URL: of a database that
is at the newest one).
"""

from __future__ import annotations

from typing import Any, Literal

from alembic import context
from sqlalchemy import Connection, TypeDecorator

from app.registry.database import Database
from app.registry.tables import metadata


def spell(kind: str, item: Any, _context: object) -> str | Literal[False]:
    """Spell the types of the registry as what the database knows, so that revisions stand alone."""
    return f"sa.{item.impl!r}" if kind == "type" and isinstance(item, TypeDecorator) else False


def run(connection: Connection) -> None:
    """Run the revisions within the transaction of the connection."""
    context.configure(connection=connection, target_metadata=metadata, render_item=spell)
    with context.begin_transaction():
        context.run_migrations()


given = context.config.attributes.get("connection")
if given is not None:
    run(given)
else:
    database = Database(context.get_x_argument(as_dictionary=True)["database"])
    with database.engine.begin() as opened:
        run(opened)
    database.close()
