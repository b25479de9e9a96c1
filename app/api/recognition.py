"""Whole recordings through the recogniser: segmentations and evaluations."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header
from pydantic import ConfigDict
from pydantic.config import JsonDict
from starlette.responses import JSONResponse

from app.api.dependencies import LabOf
from app.api.jobs import JobTold
from app.api.schemas import (
    Answer,
    GeometryTold,
    IdempotencyKey,
    RecordingSent,
    SegmentTold,
    TrajectorySent,
    Upload,
    refusals,
)
from app.registry.records import JobRecord
from app.service import recognition
from app.service.geometry import Geometry

router = APIRouter(prefix="/v1/models/{model}/versions/{ref}", tags=["recognition"])

STILL: JsonDict = {
    "rate_hz": 50,
    "hand": [[0.0, 0.0, 0.02]] * 25,
    "objects": {"object": [[0.0, 0.36, 0.0]] * 25},
}
METRES: JsonDict = {"length_unit": "m", "up_axis": "z"}


class Segmentation(Upload):
    """A recording to find the actions in."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"geometry": METRES, "trajectory": STILL}]})

    trajectory: TrajectorySent


class Evaluation(Upload):
    """A labelled recording to measure a version on."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "geometry": METRES,
                    "recording": {
                        "trajectory": STILL,
                        "segments": [{"action": "grasp", "start_s": 0.0, "end_s": 0.4}],
                    },
                }
            ]
        }
    )

    recording: RecordingSent


class SegmentsTold(Answer):
    """The segments of a recording, in order."""

    segments: list[SegmentTold]
    geometry: GeometryTold


class MeasuresTold(Answer):
    """Shares lie in 0..1; null where there is nothing to share out."""

    n_true: int
    n_found: int
    delineated: float | None
    classified_of_delineated: float | None
    f1_50: float | None
    f1_75: float | None
    frame_accuracy: float | None


class EvaluationTold(MeasuresTold):
    """The measures over all classes and of each; `confusion`: true (rows) by found, extra and missed last."""

    model: str
    version: int
    n_extra: int
    action_in_rest: float | None
    median_boundary_error_ms: float | None
    per_class: dict[str, MeasuresTold]
    confusion: list[list[int]]
    geometry: GeometryTold


QUEUED: dict[int | str, dict[str, Any]] = {
    202: {
        "model": JobTold,
        "description": "A long recording, or `Prefer: respond-async`: a job, whose `result` is the answer.",
    }
}
RESPOND_ASYNC = "respond-async"

Prefer = Annotated[
    list[str] | None,
    Header(description=f"`{RESPOND_ASYNC}`: a job, however short the recording is (RFC 7240)."),
]


@router.post(
    "/segmentations",
    summary="Find the actions in a recording",
    response_model=SegmentsTold,
    responses=QUEUED | refusals(400, 404, 409, 413, 503),
)
def segmentation(
    model: str,
    ref: str,
    body: Segmentation,
    lab: LabOf,
    prefer: Prefer = None,
    idempotency_key: IdempotencyKey = None,
) -> JSONResponse:
    """What a stream of the same frames gives, bit for bit."""
    geometry, scene = body.ground()
    asked = recognition.ask_segmentation(lab, model, ref, body.trajectory.read(), geometry, scene)
    found = recognition.answer(lab, asked, later=_later(prefer), idempotency_key=idempotency_key)
    return _answer(found, SegmentsTold, geometry)


@router.post(
    "/evaluations",
    summary="Measure a version on a labelled recording",
    response_model=EvaluationTold,
    responses=QUEUED | refusals(400, 404, 409, 413, 503),
)
def evaluation(
    model: str,
    ref: str,
    body: Evaluation,
    lab: LabOf,
    prefer: Prefer = None,
    idempotency_key: IdempotencyKey = None,
) -> JSONResponse:
    """Segments found against the labels: boundaries, segments, frames and classes."""
    geometry, scene = body.ground()
    recording = body.recording
    asked = recognition.ask_evaluation(
        lab, model, ref, recording.trajectory.read(), recording.labels(), geometry, scene
    )
    found = recognition.answer(lab, asked, later=_later(prefer), idempotency_key=idempotency_key)
    return _answer(found, EvaluationTold, geometry)


def _later(prefer: list[str] | None) -> bool:
    """Whether ``respond-async`` is among the preferences; those that are unknown are to be ignored."""
    preferences = ",".join(prefer or ()).split(",")
    return RESPOND_ASYNC in {each.partition(";")[0].strip().lower() for each in preferences}


def _answer(found: dict[str, Any] | JobRecord, kind: type[Answer], geometry: Geometry) -> JSONResponse:
    if isinstance(found, JobRecord):
        told = JobTold.of(found)
        return JSONResponse(told.model_dump(mode="json"), 202, {"Location": f"/v1/jobs/{told.id}"})
    result = kind.model_validate({**found, "geometry": GeometryTold.of(geometry)})
    return JSONResponse(result.model_dump(mode="json"))
