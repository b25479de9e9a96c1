"""Upkeep of the store: what nothing names is swept away, what is named and not whole is told by name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from app.registry import holdings
from app.registry.errors import ArtifactAltered, ArtifactMissing
from app.registry.store import Held
from app.service.lab import Lab


@dataclass(frozen=True)
class Swept:
    """What a sweep set aside, and what it deleted for good: that which an earlier one had set aside."""

    set_aside: tuple[Held, ...]
    deleted: tuple[Held, ...]


def sweep(lab: Lab, older_than: timedelta, *, dry_run: bool = False) -> Swept:
    """Set aside what no row names and is older, delete what was aside so long, clear broken-off writes.

    Safe while the lab is at work. What is put there is named a moment later, so nothing young is touched, nor
    what was put since the oldest unfinished job began. What was named in between is brought back by the next
    sweep, and found all the time. dry_run: only say what would be done. Raises Unavailable.
    """
    before = datetime.now(UTC) - older_than
    held = list(lab.store.listing())
    with lab.database.reading() as tx:
        named, at_work_since = holdings.named(tx), holdings.at_work_since(tx)
    if at_work_since is not None:
        before = min(before, at_work_since)
    orphans = [item for item in held if item.digest not in named and item.since < before]
    swept = Swept(
        tuple(item for item in orphans if not item.aside), tuple(item for item in orphans if item.aside)
    )
    if not dry_run:
        for item in held:
            if item.aside and item.digest in named:
                lab.store.bring_back(item.digest)
        for item in swept.deleted:
            lab.store.discard(item.digest)
        for item in swept.set_aside:
            lab.store.set_aside(item.digest)
        lab.store.clear(before)
    return swept


def lost(lab: Lab) -> Iterator[str]:
    """Yield what is named and missing or altered, by name; every artifact is read. Raises Unavailable."""
    with lab.database.reading() as tx:
        named = holdings.named(tx)
    for digest, title in named.items():
        try:
            lab.store.get(digest, title)
        except (ArtifactMissing, ArtifactAltered) as error:
            yield str(error)
