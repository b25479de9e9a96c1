"""The lab: the database, the store and the versions in memory, which all use cases work with."""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from dataclasses import dataclass

from app.motion.model import Model
from app.registry import versions
from app.registry.artifacts import load_model
from app.registry.database import Database
from app.registry.errors import NotFound
from app.registry.holdings import version_title
from app.registry.records import VersionRecord
from app.registry.store import Store

DEFAULT_ALIAS = "production"
"""The alias that stands for a model where no version is named; without it the latest does."""

KEPT = 32
"""Models kept in memory, those used last."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Version:
    """A model version ready for use."""

    record: VersionRecord
    model: Model


class Lab:
    """What the use cases work with; safe to use from many threads."""

    def __init__(self, database: Database, store: Store) -> None:
        self.database = database
        self.store = store
        self._models: OrderedDict[str, Model] = OrderedDict()
        self._lock = threading.Lock()

    def version(self, model: str, ref: str | None = None) -> Version:
        """Return a version by number, alias or ``latest``; None: ``production``, else the latest.

        Raises NotFound, ArtifactMissing, ArtifactAltered, ArtifactInvalid.
        """
        record = self._record(model, ref)
        return Version(record, self.load(record.artifact_digest, version_title(model, record.number)))

    def load(self, digest: str, of: str = "") -> Model:
        """Return the model of an artifact; of: what it is, for errors to name it.

        Raises ArtifactMissing, ArtifactAltered, ArtifactInvalid.
        """
        with self._lock:
            if digest in self._models:
                self._models.move_to_end(digest)
                return self._models[digest]
        loaded = load_model(self.store.get(digest, of))
        with self._lock:
            self._models[digest] = loaded
            while len(self._models) > KEPT:
                self._models.popitem(last=False)
        return loaded

    def health(self) -> dict[str, str]:
        """Return ``ok``, or the kind of what is wrong, for database and store."""
        found = {}
        for name, ping in (("database", self.database.ping), ("store", self.store.ping)):
            try:
                ping()
            except Exception as error:
                log.warning("%s is not ready: %s", name, error)
                found[name] = type(error).__name__
            else:
                found[name] = "ok"
        return found

    def close(self) -> None:
        """Let the database go."""
        self.database.close()

    def _record(self, model: str, ref: str | None) -> VersionRecord:
        with self.database.reading() as tx:
            if ref is not None:
                return versions.get(tx, model, ref)
            try:
                return versions.get(tx, model, DEFAULT_ALIAS)
            except NotFound:
                return versions.get(tx, model, "latest")


def open_lab(database_url: str, store_url: str) -> Lab:
    """Return the lab of a store and a database, which is migrated where it is embedded. Raises InvalidUrl."""
    database = Database(database_url)
    if database.embedded:
        database.migrate()
    return Lab(database, Store(store_url))
