"""Versions, trained or imported, and the aliases that name them."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Response
from pydantic import ConfigDict, Field
from starlette.requests import Request as HttpRequest

from app.api.dependencies import LabOf
from app.api.jobs import JobTold
from app.api.schemas import Answer, IdempotencyKey, Name, PageSize, PageToken, Request, refusals
from app.registry.records import VersionRecord
from app.service import models, training, versions

router = APIRouter(prefix="/v1/models/{model}", tags=["versions"])

Ref = Annotated[str, Field(description="A number, an alias or `latest`.")]
ARTIFACT = "application/vnd.gesta.model+json"


class OptionsSent(Request):
    """How to train; what is not named is chosen from the demonstrations."""

    n_states: int | None = Field(None, ge=2, le=64, description="Of every class; default: chosen for each.")
    deviation_floor: float = Field(
        training.DEFAULTS.deviation_floor,
        gt=0,
        le=1,
        allow_inf_nan=False,
        alias="deviation_floor_m",
        description="Least standard deviation of a state in the deviation from the straight line [m].",
    )
    seed: int = Field(0, ge=0, lt=2**63, description="Of the folds that choose the number of states.")


class Training(Request):
    """What to train on and how; by default on all demonstrations of the model."""

    model_config = ConfigDict(json_schema_extra={"examples": [{}]})

    options: OptionsSent = OptionsSent()
    demonstrations: list[str] | None = Field(None, min_length=1, description="Ids; default: all.")
    base: int | str | None = Field(
        None,
        description="A version to go on from: classes with the same demonstrations keep their action model.",
    )


class VersionTold(Answer):
    """A model version: immutable."""

    model: str
    version: int
    actions: list[str]
    aliases: list[str]
    options: dict[str, Any]
    seed: int | None
    demonstrations: list[str] = Field(description="Digests of what it was trained on.")
    base: int | None
    library_versions: dict[str, str]
    evaluation: dict[str, Any] | None = Field(
        description="Cross-validated class accuracy on its own demonstrations."
    )
    digest: str
    job_id: str | None
    created_at: datetime


class VersionWithLineage(VersionTold):
    """A version and those it goes back to, the nearest first."""

    lineage: list[int]


class VersionsTold(Answer):
    """A page of versions, the newest first."""

    versions: list[VersionTold]
    next_page_token: str | None


class AliasSent(Request):
    """The version that an alias is to name."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"version": 1}]})

    version: int = Field(ge=1, lt=2**31)


class AliasTold(Answer):
    """An alias and the version it names."""

    alias: str
    version: int
    updated_at: datetime


class AliasChangeTold(Answer):
    """One move of an alias; `version` null: it was deleted, `previous` null: it was new."""

    version: int | None
    previous: int | None
    by: str | None
    at: datetime


class AliasHistory(Answer):
    """A page of the moves of an alias, the newest first."""

    history: list[AliasChangeTold]
    next_page_token: str | None


async def _body(request: HttpRequest) -> bytes:
    return await request.body()


@router.post("/versions", status_code=202, summary="Train a version", responses=refusals(404, 409))
def train(
    model: str,
    body: Training,
    lab: LabOf,
    response: Response,
    idempotency_key: IdempotencyKey = None,
) -> JobTold:
    """Queues a job; its `result` is `{model, version}`. The same `Idempotency-Key` gives the same job."""
    job = training.request_training(
        lab,
        model,
        options=body.options.model_dump(exclude_unset=True),
        demonstration_ids=body.demonstrations,
        base=None if body.base is None else str(body.base),
        idempotency_key=idempotency_key,
    )
    response.headers["Location"] = f"/v1/jobs/{job.id}"
    return JobTold.of(job)


@router.get("/versions", summary="List versions, the newest first", responses=refusals(404))
def listing(model: str, lab: LabOf, page_size: PageSize = 50, page_token: PageToken = None) -> VersionsTold:
    """Versions, page by page."""
    page = versions.page(lab, model, size=page_size, after=page_token)
    told = [VersionTold(**_fields(record)) for record in page.records]
    return VersionsTold(versions=told, next_page_token=page.next_token)


@router.post(
    "/versions:import",
    status_code=201,
    summary="Import an artifact",
    responses=refusals(404),
    openapi_extra={"requestBody": {"content": {ARTIFACT: {"schema": {"type": "object"}}}, "required": True}},
)
def take_in(
    model: str, body: Annotated[bytes, Depends(_body)], lab: LabOf, response: Response
) -> VersionTold:
    """The file that `artifact` gave, of this server or another, becomes the next version."""
    record = versions.take_in(lab, model, body)
    response.headers["ETag"] = record.etag
    response.headers["Location"] = f"/v1/models/{model}/versions/{record.number}"
    return VersionTold(**_fields(record))


@router.get("/versions/{ref}", summary="Look a version up", responses=refusals(404))
def get(model: str, ref: Ref, lab: LabOf, response: Response) -> VersionWithLineage:
    """By number, by alias, or `latest`; the ETag is the digest of the artifact."""
    record, lineage = versions.get(lab, model, ref)
    response.headers["ETag"] = record.etag
    return VersionWithLineage(**_fields(record), lineage=list(lineage))


@router.get(
    "/versions/{ref}/artifact",
    summary="Download the artifact",
    response_class=Response,
    responses={200: {"content": {ARTIFACT: {}}}, **refusals(404, 503)},
)
def artifact(model: str, ref: Ref, lab: LabOf) -> Response:
    """The portable file: JSON, described in `docs/artifact.md`."""
    record, data = versions.export(lab, model, ref)
    name = f"{model}-{record.number}.json"
    headers = {"ETag": record.etag, "Content-Disposition": f'attachment; filename="{name}"'}
    return Response(data, media_type=ARTIFACT, headers=headers)


@router.put("/aliases/{alias}", summary="Promote a version", responses=refusals(404))
def promote(model: str, alias: Name, body: AliasSent, lab: LabOf) -> AliasTold:
    """Let an alias name a version; atomic. Running sessions keep theirs."""
    record = models.promote(lab, model, alias, body.version)
    return AliasTold(alias=record.alias, version=record.version, updated_at=record.updated_at)


@router.delete("/aliases/{alias}", status_code=204, summary="Delete an alias", responses=refusals(404))
def delete_alias(model: str, alias: str, lab: LabOf) -> None:
    """Its history stays."""
    models.delete_alias(lab, model, alias)


@router.get("/aliases/{alias}/history", summary="Who was it when", responses=refusals(404))
def history(
    model: str, alias: str, lab: LabOf, page_size: PageSize = 50, page_token: PageToken = None
) -> AliasHistory:
    """The moves of an alias, the newest first, also of a deleted one."""
    page = models.alias_history(lab, model, alias, size=page_size, after=page_token)
    moves = [
        AliasChangeTold(version=move.version, previous=move.previous, by=move.by, at=move.at)
        for move in page.records
    ]
    return AliasHistory(history=moves, next_page_token=page.next_token)


def _fields(record: VersionRecord) -> dict[str, Any]:
    return {
        "model": record.model,
        "version": record.number,
        "actions": list(record.actions),
        "aliases": list(record.aliases),
        "options": record.options,
        "seed": record.seed,
        "demonstrations": list(record.demonstrations),
        "base": record.base,
        "library_versions": record.library_versions,
        "evaluation": record.evaluation,
        "digest": record.artifact_digest,
        "job_id": record.job_id,
        "created_at": record.created_at,
    }
