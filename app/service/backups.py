"""Backup and restore: database, job engine and store in one file, taken while all of them are at work.

The databases are copied first, then what they name in the store: objects never change, and a sweep keeps what
it takes away for longer than a backup takes.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version as installed
from pathlib import Path

from dbos import DBOS

from app.registry import backup_postgresql, backup_sqlite, holdings, revisions
from app.registry.backup_file import BackupReader, BackupWriter, reading, writing
from app.registry.database import Database
from app.registry.errors import ArtifactAltered, ArtifactMissing, BackupInvalid
from app.registry.store import Store
from app.service.lab import Lab

STORE = "store/"


@dataclass(frozen=True)
class Kept:
    """What is in a backup: how many artifacts and demonstrations, and by name those that were lost before."""

    n_artifacts: int
    lost: tuple[str, ...]


def back_up(lab: Lab, path: Path) -> Kept:
    """Write a backup to a file, which replaces one that is there when it is whole.

    Raises Unavailable, OSError.
    """
    made_at = datetime.now(UTC)
    kind = backup_sqlite if lab.database.embedded else backup_postgresql
    with writing(path) as backup:
        with kind.copy_out(lab.database, backup) as (tx, told):
            revision, named = revisions.current(tx), holdings.named(tx)
            at_work_since = holdings.at_work_since(tx)
        if at_work_since is not None:
            named |= _in_the_making(lab, named, at_work_since)
        kept = _add_artifacts(lab, backup, named)
        backup.seal(
            {
                "gesta": installed("gesta"),
                "made_at": made_at.isoformat(),
                "database": kind.KIND,
                "revision": revision,
                "lost": kept.lost,
                **told,
            }
        )
    return kept


def restore(database: Database, store: Store, path: Path) -> Kept:
    """Fill an empty database, its job engine and the store with a backup; of the databases all or nothing.

    Raises BackupInvalid, NotEmpty, Unavailable, OSError.
    """
    kind = backup_sqlite if database.embedded else backup_postgresql
    with reading(path) as backup:
        manifest = backup.manifest
        if manifest["database"] != kind.KIND:
            raise BackupInvalid(str(path), f"is of a {manifest['database']} database, this is {kind.KIND}")
        if not revisions.known(manifest["revision"]):
            raise BackupInvalid(str(path), f"was made by a newer Gesta, {manifest['gesta']}")
        kind.check_empty(database)
        n_artifacts = _put_artifacts(store, backup)
        if not database.embedded:
            DBOS.migrate(database.engine_url)
        kind.copy_in(database, backup)
    return Kept(n_artifacts, tuple(manifest["lost"]))


def _in_the_making(lab: Lab, named: dict[str, str], since: datetime) -> dict[str, str]:
    """Return what unfinished jobs may have put there that only the job engine names yet."""
    young = (item.digest for item in lab.store.listing() if item.since >= since)
    return {digest: "what a job has made so far" for digest in young if digest not in named}


def _add_artifacts(lab: Lab, backup: BackupWriter, named: dict[str, str]) -> Kept:
    lost, n_artifacts = list[str](), 0
    for digest, title in named.items():
        try:
            data = lab.store.get(digest, title)
        except (ArtifactMissing, ArtifactAltered) as error:
            lost.append(str(error))
        else:
            backup.add(f"{STORE}{digest}", data)
            n_artifacts += 1
    return Kept(n_artifacts, tuple(lost))


def _put_artifacts(store: Store, backup: BackupReader) -> int:
    names = list(backup.names(STORE))
    for name in names:
        store.put(b"".join(backup.blocks(name)))
    return len(names)
