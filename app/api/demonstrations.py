"""Demonstrations: ``/v1/models/{model}/demonstrations``."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Self

from fastapi import APIRouter
from pydantic import ConfigDict, Field, model_validator
from pydantic.config import JsonDict, JsonValue

from app.api.dependencies import LabOf
from app.api.schemas import (
    ActionName,
    Answer,
    GeometryTold,
    PageSize,
    PageToken,
    RecordingSent,
    Request,
    TrajectorySent,
    Upload,
    refusals,
)
from app.api.trajectory_told import TrajectoryTold
from app.registry.records import DemonstrationRecord
from app.service import models, uploads

router = APIRouter(prefix="/v1/models/{model}/demonstrations", tags=["demonstrations"])


def _reach(lift: float) -> JsonDict:
    """Return a small grasp for the example: half a second, lifted a little on its way [m]."""
    share = [step / 24 for step in range(25)]
    hand: list[JsonValue] = [[0.0, round(0.36 * s, 4), round(0.02 + lift * s * (1 - s), 4)] for s in share]
    motion: JsonDict = {"rate_hz": 50, "hand": hand, "objects": {"object": [[0.0, 0.36, 0.0]] * 25}}
    return {"action": "grasp", "trajectory": motion}


EXAMPLE: JsonDict = {
    "geometry": {"length_unit": "m", "up_axis": "z"},
    "demonstrations": [_reach(0.1), _reach(0.14)],
}


FORM: JsonDict = {
    "type": "object",
    "description": "A labelled motion-capture file, in any format that `/v1/captures` looks into.",
    "required": ["file", "mapping"],
    "properties": {
        "file": {"type": "string", "format": "binary"},
        "mapping": {
            "type": "string",
            "description": 'JSON: `{"hand": TRACK, "objects": {ROLE: TRACK or [TRACK, …]}}`.',
        },
        "segments": {
            "type": "string",
            "format": "binary",
            "description": "JSON or CSV: action, start and end, by seconds or frames; default: those in it.",
        },
        "actions": {
            "type": "string",
            "description": "JSON: `{LABEL: ACTION}`; labels of other names are left out.",
        },
        "length_unit": {"type": "string", "enum": ["m", "cm", "mm"]},
        "up_axis": {"type": "string", "enum": ["z", "y"]},
        "table_height_m": {"type": "number"},
    },
}
"""What a form tells; ``captures.upload`` takes it."""


class DemonstrationSent(Request):
    """A trajectory of exactly one action; its last frame is the goal."""

    action: ActionName
    trajectory: TrajectorySent


class DemonstrationsSent(Upload):
    """Either presegmented demonstrations or a labelled recording."""

    model_config = ConfigDict(json_schema_extra={"examples": [EXAMPLE]})

    demonstrations: list[DemonstrationSent] | None = Field(None, min_length=1)
    recording: RecordingSent | None = None

    @model_validator(mode="after")
    def _has_one(self) -> Self:
        if (self.demonstrations is None) == (self.recording is None):
            raise ValueError("needs either `demonstrations` or `recording`")
        return self


class Uploaded(Answer):
    """What became of an upload: all of it is kept."""

    created: list[str]
    duplicates: list[str] = Field(description="Demonstrations that the model had before.")
    geometry: GeometryTold


class DemonstrationTold(Answer):
    """A demonstration."""

    id: str
    action: str
    n_frames: int
    duration_s: float
    objects: list[str]
    table_height_m: float
    digest: str
    created_at: datetime


class DemonstrationWithTrajectory(DemonstrationTold):
    """A demonstration with its trajectory, in metres, Z up."""

    geometry: GeometryTold = GeometryTold()
    trajectory: TrajectoryTold


class DemonstrationsTold(Answer):
    """A page of demonstrations, and the number of all by action class."""

    demonstrations: list[DemonstrationTold]
    actions: dict[str, int]
    next_page_token: str | None


@router.post(
    "",
    status_code=201,
    summary="Upload demonstrations",
    responses=refusals(400, 404, 413),
    openapi_extra={"requestBody": {"content": {"multipart/form-data": {"schema": FORM}}}},
)
def upload(model: str, body: DemonstrationsSent, lab: LabOf) -> Uploaded:
    """All or nothing; what the model has already is told, not stored again."""
    geometry, scene = body.ground()
    if body.recording is not None:
        trajectory, labels = body.recording.trajectory.read(), body.recording.labels()
        added = uploads.add_recording(lab, model, trajectory, labels, geometry, scene)
    else:
        sent = [(shown.action, shown.trajectory.read()) for shown in body.demonstrations or ()]
        added = uploads.add_demonstrations(lab, model, sent, geometry, scene)
    return Uploaded(
        created=list(added.created), duplicates=list(added.duplicates), geometry=GeometryTold.of(geometry)
    )


@router.get("", summary="List demonstrations in order of arrival", responses=refusals(404))
def listing(
    model: str,
    lab: LabOf,
    action: str | None = None,
    page_size: PageSize = 50,
    page_token: PageToken = None,
) -> DemonstrationsTold:
    """All of them, or those of one action class."""
    page, actions = models.demonstrations_of(lab, model, size=page_size, after=page_token, action=action)
    told = [DemonstrationTold(**_fields(record)) for record in page.records]
    return DemonstrationsTold(demonstrations=told, actions=actions, next_page_token=page.next_token)


@router.get("/{demonstration}", summary="Look a demonstration up", responses=refusals(404))
def get(model: str, demonstration: str, lab: LabOf) -> DemonstrationWithTrajectory:
    """With its trajectory."""
    record, found = models.demonstration(lab, model, demonstration)
    trajectory = TrajectoryTold.of(found.trajectory)
    return DemonstrationWithTrajectory(**_fields(record), trajectory=trajectory)


@router.delete("/{demonstration}", status_code=204, summary="Delete a demonstration", responses=refusals(404))
def delete(model: str, demonstration: str, lab: LabOf) -> None:
    """Versions that were made of it stay as they are."""
    models.delete_demonstration(lab, model, demonstration)


def _fields(record: DemonstrationRecord) -> dict[str, Any]:
    return {
        "id": record.id,
        "action": record.action,
        "n_frames": record.n_frames,
        "duration_s": record.duration_s,
        "objects": list(record.objects),
        "table_height_m": record.table_height_m,
        "digest": record.digest,
        "created_at": record.created_at,
    }
