"""Training: from a request to a job, and in the job from demonstrations to a version."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version as installed
from typing import Any

from app.motion.errors import FitFailed
from app.motion.training import MIN_DEMONSTRATIONS, TrainingOptions, fit_model
from app.motion.trajectory import Demonstration
from app.motion.validation import cross_validate
from app.registry import demonstrations, jobs, models, versions
from app.registry.artifacts import dump_model, load_demonstration
from app.registry.holdings import demonstration_title, version_title
from app.registry.records import DemonstrationRecord, JobRecord
from app.service.errors import JobCancelled, NothingToTrain
from app.service.lab import Lab
from app.service.uploads import specification_of

KIND = "training"
DEFAULTS = TrainingOptions()
LIBRARIES = ("gesta", "numba", "numpy")

Json = dict[str, Any]
Progress = Callable[[int, int, str], None]
"""Told (done, total, message); raises JobCancelled where the job was asked to end."""
Stage = Callable[[Lab, JobRecord, Json, Progress], Json]
"""Does a part of a job; is given what the stages before it found, and returns what it finds."""


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
        models.lock(tx, model)
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


def fit(lab: Lab, job: JobRecord, _: Json, progress: Progress) -> Json:
    """Fit the model and store it: ``artifact``, its digest.

    Raises what the core, the registry and ``progress`` raise.
    """
    records, base = _demonstrations(lab, job), None
    if job.request["base"] is not None:
        with lab.database.reading() as tx:
            base = versions.get(tx, str(job.model), job.request["base"])
    known = set() if base is None else set(base.demonstrations)
    with lab.database.reading() as tx:
        specification = specification_of(models.get(tx, str(job.model)))
    fitted = fit_model(
        _shown(lab, records),
        specification,
        _options(job),
        base=None if base is None else lab.load(base.artifact_digest, version_title(base.model, base.number)),
        learned=[index for index, record in enumerate(records) if record.digest in known],
        progress=lambda done, _, message: progress(done, _total(records), message),
    )
    return {"artifact": lab.store.put(dump_model(fitted))}


def validate(lab: Lab, job: JobRecord, found: Json, progress: Progress) -> Json:
    """Cross-validate what was fitted: ``evaluation``. Raises as ``fit`` does."""
    records = _demonstrations(lab, job)
    total = _total(records)
    validation = cross_validate(
        lab.load(found["artifact"]),
        _shown(lab, records),
        _options(job),
        lambda: progress(total - 2, total, "cross-validating"),
    )
    return {"evaluation": None if validation is None else asdict(validation)}


def register(lab: Lab, job: JobRecord, found: Json, progress: Progress) -> Json:
    """Register the version and end the job, in one commit. Raises as ``fit`` does."""
    model, request, options = str(job.model), job.request, _options(job)
    records, fitted = _demonstrations(lab, job), lab.load(found["artifact"])
    progress(_total(records) - 1, _total(records), "storing the version")
    with lab.database.transaction() as tx:
        specification = specification_of(models.lock(tx, model))
        if jobs.get(tx, job.id).cancel_requested:
            raise JobCancelled
        record = versions.register(
            tx,
            model,
            artifact_digest=found["artifact"],
            actions=fitted.names,
            options={**asdict(options), **asdict(specification)},
            demonstrations=[record.digest for record in records],
            library_versions={name: installed(name) for name in LIBRARIES},
            seed=options.seed,
            base=request["base"],
            evaluation=found["evaluation"],
            job_id=job.id,
        )
        result = {"model": model, "version": record.number}
        jobs.succeed(tx, job.id, job.attempt, result)
    return result


STAGES: tuple[tuple[str, Stage], ...] = (("fit", fit), ("validate", validate), ("register", register))


def _demonstrations(lab: Lab, job: JobRecord) -> tuple[DemonstrationRecord, ...]:
    with lab.database.reading() as tx:
        return demonstrations.load(tx, str(job.model), job.request["demonstrations"])


def _shown(lab: Lab, records: Sequence[DemonstrationRecord]) -> list[Demonstration]:
    stored = [
        lab.store.get(record.digest, demonstration_title(record.model, record.id)) for record in records
    ]
    return [load_demonstration(data) for data in stored]


def _options(job: JobRecord) -> TrainingOptions:
    return TrainingOptions(**job.request["options"])


def _total(records: Sequence[DemonstrationRecord]) -> int:
    """Return of how many steps a training is told: one for each class, and two."""
    return len({record.action for record in records}) + 2


def _check_enough(model: str, records: Sequence[DemonstrationRecord]) -> None:
    if not records:
        raise NothingToTrain(model)
    for action, number in Counter(record.action for record in records).items():
        if number < MIN_DEMONSTRATIONS:
            raise FitFailed(action, f"has {number} demonstration, needs at least {MIN_DEMONSTRATIONS}")
