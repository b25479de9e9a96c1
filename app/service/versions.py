"""Versions: listed, exported, imported."""

from __future__ import annotations

from app.motion.hypothesis import REST
from app.registry import models, versions
from app.registry.artifacts import load_model
from app.registry.errors import ArtifactInvalid
from app.registry.holdings import version_title
from app.registry.records import Page, VersionRecord
from app.service.lab import Lab
from app.service.uploads import specification_of


def get(lab: Lab, model: str, ref: str) -> tuple[VersionRecord, tuple[int, ...]]:
    """Return a version and its lineage: its base, that one's base and so on. Raises NotFound."""
    with lab.database.reading() as tx:
        record = versions.get(tx, model, ref)
        return record, versions.lineage(tx, model, record.number)


def page(lab: Lab, model: str, *, size: int, after: str | None) -> Page[VersionRecord]:
    """List the versions of a model, newest first. Raises NotFound, InvalidPageToken."""
    with lab.database.reading() as tx:
        return versions.page(tx, model, size=size, after=after)


def export(lab: Lab, model: str, ref: str) -> tuple[VersionRecord, bytes]:
    """Return a version's artifact as it was stored. Raises NotFound, ArtifactMissing, ArtifactAltered."""
    record, _ = get(lab, model, ref)
    return record, lab.store.get(record.artifact_digest, version_title(model, record.number))


def take_in(lab: Lab, model: str, artifact: bytes) -> VersionRecord:
    """Register an exported artifact as the next version. Raises NotFound, ArtifactInvalid."""
    loaded = load_model(artifact)
    with lab.database.reading() as tx:
        wanted = specification_of(models.get(tx, model)).objects
    if loaded.features.objects != wanted:
        detail = f"must be {list(wanted)}, the roles of model {model!r}"
        raise ArtifactInvalid("features.objects", detail)
    if REST in loaded.names:
        detail = f"must not be {REST!r}: so a hypothesis calls no action"
        raise ArtifactInvalid(f"actions[{loaded.names.index(REST)}].action", detail)
    digest = lab.store.put(artifact)
    with lab.database.transaction() as tx:
        return versions.register(
            tx,
            model,
            artifact_digest=digest,
            actions=loaded.names,
            options={},
            demonstrations=[],
            library_versions={},
        )
