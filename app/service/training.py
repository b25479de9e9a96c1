"""Training: from a request to a job, and in the job from demonstrations to a version."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version as installed
from typing import Any

from app.motion.errors import FitFailed
from app.motion.training import MIN_DEMONSTRATIONS, TrainingOptions, fit_model
from app.motion.validation import cross_validate
from app.registry import demonstrations, jobs, models, versions
from app.registry.artifacts import dump_model, load_demonstration
from app.registry.records import DemonstrationRecord, JobRecord
from app.service.errors import NothingToTrain
from app.service.lab import Lab
from app.service.uploads import specification_of

KIND = "training"
DEFAULTS = TrainingOptions()
LIBRARIES = ("gesta", "numba", "numpy")

Progress = Callable[[int, int, str], None]
"""Told (done, total, message); raises JobCancelled where the job was asked to end."""


def request_training(
    lab: Lab,
    model: str,
    *,
    options: Mapping[str, Any],
    demonstration_ids: Sequence[str] | None,
    base: str | None,
    idempotency_key: str | None,
) -> JobRecord:
    """Queue the training of a model's next version; what it is trained on is settled now.

    options: those of TrainingOptions that differ from the default; demonstration_ids: None for all. Raises
    NotFound, NothingToTrain, FitFailed for a class with too few demonstrations, KeyReused.
    """
    TrainingOptions(**options)
    with lab.database.transaction() as tx:
        records = demonstrations.load(tx, model, demonstration_ids)
        _check_enough(model, records)
        request = {
            "options": dict(options),
            "demonstrations": [record.id for record in records],
            "base": None if base is None else versions.get(tx, model, base).number,
        }
        job, _ = jobs.create(
            tx, kind=KIND, request=request, model=model, idempotency_key=idempotency_key, scope=model
        )
        return job


def run_training(lab: Lab, job: JobRecord, progress: Progress) -> dict[str, Any]:
    """Train, store and register; return the job's result. Running it again gives the same version.

    Raises what the core, the registry and ``progress`` raise.
    """
    model, request = str(job.model), job.request
    with lab.database.reading() as tx:
        specification = specification_of(models.get(tx, model))
        records = demonstrations.load(tx, model, request["demonstrations"])
        base = None if request["base"] is None else versions.get(tx, model, request["base"])
    options = TrainingOptions(**request["options"])
    shown = [load_demonstration(lab.store.get(record.digest)) for record in records]
    known = set() if base is None else set(base.demonstrations)
    total = len({record.action for record in records}) + 2
    fitted = fit_model(
        shown,
        specification,
        options,
        base=None if base is None else lab.load(base.artifact_digest),
        learned=[index for index, record in enumerate(records) if record.digest in known],
        progress=lambda done, _, message: progress(done, total, message),
    )
    found = cross_validate(fitted, shown, options, lambda: progress(total - 2, total, "cross-validating"))
    progress(total - 1, total, "storing the version")
    digest = lab.store.put(dump_model(fitted))
    with lab.database.transaction() as tx:
        record = versions.register(
            tx,
            model,
            artifact_digest=digest,
            actions=fitted.names,
            options={**asdict(options), **asdict(specification)},
            demonstrations=[record.digest for record in records],
            library_versions={name: installed(name) for name in LIBRARIES},
            seed=options.seed,
            base=request["base"],
            evaluation=None if found is None else asdict(found),
            job_id=job.id,
        )
    return {"model": model, "version": record.number}


def _check_enough(model: str, records: Sequence[DemonstrationRecord]) -> None:
    if not records:
        raise NothingToTrain(model)
    for action, number in Counter(record.action for record in records).items():
        if number < MIN_DEMONSTRATIONS:
            raise FitFailed(action, f"has {number} demonstration, needs at least {MIN_DEMONSTRATIONS}")
