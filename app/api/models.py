"""Models: ``/v1/models``."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Self

from fastapi import APIRouter, Header, Response
from pydantic import ConfigDict, Field, model_validator

from app.api.dependencies import LabOf
from app.api.schemas import Answer, Height, Name, ObjectName, PageSize, PageToken, Request, refusals
from app.registry.records import ModelChanges, ModelRecord
from app.service import models

router = APIRouter(prefix="/v1/models", tags=["models"])

IfMatch = Annotated[str | None, Header(description="Act only if this is still the model's ETag.")]
RESERVED = frozenset({"t", "hand"})


class FeaturesSent(Request):
    """Options of the features; `rate`: the internal rate to which all motion is resampled [Hz]."""

    rate: float | None = Field(None, ge=10, le=1000, allow_inf_nan=False, alias="rate_hz")


class NewModel(Request):
    """A model to be created."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"name": "table-top", "objects": ["object"]}]})

    name: Name
    objects: list[ObjectName] = Field(
        max_length=16, description="The roles: objects whose distance to the hand is a feature."
    )
    table_height_m: Height = 0.0
    description: str | None = Field(None, max_length=2000)
    features: FeaturesSent = FeaturesSent()

    @model_validator(mode="after")
    def _roles_differ(self) -> Self:
        if len(set(self.objects)) < len(self.objects) or RESERVED & set(self.objects):
            raise ValueError("`objects` need names of their own, other than `t` and `hand`")
        return self


class ModelChangesSent(Request):
    """What can be changed of a model; what is not named stays."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"description": "The lab's table."}]})

    description: str | None = Field(None, max_length=2000)
    table_height_m: Height = 0.0

    def read(self) -> ModelChanges:
        """Return the fields that were sent."""
        changes = ModelChanges()
        if "description" in self.model_fields_set:
            changes["description"] = self.description
        if "table_height_m" in self.model_fields_set:
            changes["table_height_m"] = self.table_height_m
        return changes


class FeaturesTold(Answer):
    """Options of the features that differ from the default."""

    rate_hz: float | None = None


class ModelTold(Answer):
    """A model."""

    name: str
    objects: list[str]
    table_height_m: float
    description: str | None
    features: FeaturesTold
    created_at: datetime
    updated_at: datetime

    @classmethod
    def of(cls, record: ModelRecord) -> Self:
        """Return what is told of a model."""
        return cls(**_fields(record))


class ModelWithActions(ModelTold):
    """A model and the number of demonstrations of each action class."""

    actions: dict[str, int]


class ModelsTold(Answer):
    """A page of models."""

    models: list[ModelTold]
    next_page_token: str | None


@router.post("", status_code=201, summary="Create a model", responses=refusals(409))
def create(body: NewModel, lab: LabOf, response: Response) -> ModelTold:
    """A model is a named set of action models that share one feature specification."""
    record = models.create(
        lab,
        name=body.name,
        objects=body.objects,
        table_height_m=body.table_height_m,
        description=body.description,
        features=body.features.model_dump(exclude_none=True),
    )
    response.headers["ETag"] = record.etag
    response.headers["Location"] = f"/v1/models/{record.name}"
    return ModelTold.of(record)


@router.get("", summary="List the models by name", responses=refusals())
def listing(lab: LabOf, page_size: PageSize = 50, page_token: PageToken = None) -> ModelsTold:
    """Models by name, page by page."""
    page = models.page(lab, size=page_size, after=page_token)
    return ModelsTold(
        models=[ModelTold.of(record) for record in page.records], next_page_token=page.next_token
    )


@router.get("/{model}", summary="Look a model up", responses=refusals(404))
def get(model: str, lab: LabOf, response: Response) -> ModelWithActions:
    """A model, with the number of demonstrations of each of its action classes."""
    record, actions = models.get(lab, model)
    response.headers["ETag"] = record.etag
    return ModelWithActions(**_fields(record), actions=actions)


@router.patch("/{model}", summary="Change a model", responses=refusals(404, 412))
def update(
    model: str, body: ModelChangesSent, lab: LabOf, response: Response, if_match: IfMatch = None
) -> ModelTold:
    """Description and table height can change; versions that were trained before stay as they are."""
    record = models.update(lab, model, body.read(), if_match)
    response.headers["ETag"] = record.etag
    return ModelTold.of(record)


@router.delete("/{model}", status_code=204, summary="Delete a model", responses=refusals(404, 412))
def delete(model: str, lab: LabOf, if_match: IfMatch = None) -> None:
    """With its demonstrations, versions and aliases; jobs and sessions stay on record."""
    models.delete(lab, model, if_match)


def _fields(record: ModelRecord) -> dict[str, object]:
    return {
        "name": record.name,
        "objects": list(record.objects),
        "table_height_m": record.table_height_m,
        "description": record.description,
        "features": {"rate_hz": record.features.get("rate")},
        "created_at": record.created_at,
        "updated_at": record.updated_at,
    }
