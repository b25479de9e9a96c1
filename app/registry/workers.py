"""Workers: who does jobs, and a number of each that counts up for as long as it lives.

Whoever watches the number by a clock of its own sees who is dead; no two clocks are ever compared.
"""

from __future__ import annotations

from uuid import uuid4

import sqlalchemy as sa
from sqlalchemy.orm import Session

from app.registry import tables

table = tables.workers


def join(tx: Session) -> str:
    """Let a new worker in and return its id, which none had before."""
    id_ = uuid4().hex
    tx.execute(sa.insert(table).values(id=id_, beats=0, started_at=tables.now()))
    return id_


def beat(tx: Session, id_: str) -> None:
    """Show that a worker lives; one that was taken for dead is let in again."""
    counted = sa.update(table).where(table.c.id == id_).values(beats=table.c.beats + 1).returning(table.c.id)
    if tx.execute(counted).one_or_none() is None:
        tx.execute(sa.insert(table).values(id=id_, beats=0, started_at=tables.now()))


def leave(tx: Session, id_: str) -> None:
    """Take a worker out: what it has not ended is for others."""
    tx.execute(sa.delete(table).where(table.c.id == id_))


def bury(tx: Session, id_: str, beats: int) -> bool:
    """Take a dead worker out, unless it has gone on from these beats; return whether it was there."""
    still = sa.delete(table).where(table.c.id == id_, table.c.beats == beats).returning(table.c.id)
    return tx.execute(still).one_or_none() is not None


def beats(tx: Session) -> dict[str, int]:
    """Return the beats of every worker by its id."""
    return {row.id: row.beats for row in tx.execute(sa.select(table.c.id, table.c.beats))}
