"""Models, their demonstrations and their aliases: each use case one transaction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from app.motion.trajectory import Demonstration
from app.registry import aliases, demonstrations, jobs, models
from app.registry.artifacts import load_demonstration
from app.registry.holdings import demonstration_title
from app.registry.records import (
    AliasChange,
    AliasRecord,
    DemonstrationRecord,
    ModelChanges,
    ModelRecord,
    Page,
)
from app.service.lab import Lab


def create(
    lab: Lab,
    *,
    name: str,
    objects: Sequence[str],
    table_height_m: float,
    description: str | None,
    features: Mapping[str, Any],
) -> ModelRecord:
    """Create a model without versions. Raises AlreadyExists, InvalidName."""
    with lab.database.transaction() as tx:
        return models.create(
            tx,
            name=name,
            objects=objects,
            table_height_m=table_height_m,
            description=description,
            features=features,
        )


def get(lab: Lab, name: str) -> tuple[ModelRecord, dict[str, int]]:
    """Return a model and how many demonstrations each of its classes has. Raises NotFound."""
    with lab.database.reading() as tx:
        return models.get(tx, name), demonstrations.counts(tx, name)


def page(lab: Lab, *, size: int, after: str | None) -> Page[ModelRecord]:
    """List the models by name. Raises InvalidPageToken."""
    with lab.database.reading() as tx:
        return models.page(tx, size=size, after=after)


def update(lab: Lab, name: str, changes: ModelChanges, if_match: str | None) -> ModelRecord:
    """Change a model. Raises NotFound, PreconditionFailed."""
    with lab.database.transaction() as tx:
        return models.update(tx, name, changes, if_match=if_match)


def delete(lab: Lab, name: str, if_match: str | None) -> None:
    """Delete a model with all that belongs to it; its jobs are cancelled, its idempotency keys forgotten.

    Raises NotFound, PreconditionFailed.
    """
    with lab.database.transaction() as tx:
        models.delete(tx, name, if_match=if_match)
        jobs.release(tx, name)


def demonstrations_of(
    lab: Lab, model: str, *, size: int, after: str | None, action: str | None
) -> tuple[Page[DemonstrationRecord], dict[str, int]]:
    """List demonstrations in order of arrival, and count all by class. Raises NotFound, InvalidPageToken."""
    with lab.database.reading() as tx:
        listed = demonstrations.page(tx, model, size=size, after=after, action=action)
        return listed, demonstrations.counts(tx, model)


def demonstration(lab: Lab, model: str, id_: str) -> tuple[DemonstrationRecord, Demonstration]:
    """Return a demonstration with its trajectory. Raises NotFound, ArtifactMissing, ArtifactAltered."""
    with lab.database.reading() as tx:
        record = demonstrations.get(tx, model, id_)
    return record, load_demonstration(lab.store.get(record.digest, demonstration_title(model, id_)))


def delete_demonstration(lab: Lab, model: str, id_: str) -> None:
    """Delete a demonstration; versions made of it stay as they are. Raises NotFound."""
    with lab.database.transaction() as tx:
        demonstrations.delete(tx, model, id_)


def promote(lab: Lab, model: str, alias: str, version: int) -> AliasRecord:
    """Let an alias name a version. Raises NotFound, InvalidName."""
    with lab.database.transaction() as tx:
        return aliases.put(tx, model, alias, version)


def delete_alias(lab: Lab, model: str, alias: str) -> None:
    """Delete an alias; its history stays. Raises NotFound."""
    with lab.database.transaction() as tx:
        aliases.delete(tx, model, alias)


def alias_history(lab: Lab, model: str, alias: str, *, size: int, after: str | None) -> Page[AliasChange]:
    """List the moves of an alias, newest first. Raises NotFound, InvalidPageToken."""
    with lab.database.reading() as tx:
        return aliases.history(tx, model, alias, size=size, after=after)
