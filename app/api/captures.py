"""Motion-capture files: looked into, and uploaded as demonstrations."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from fastapi import APIRouter, File, Form, Request, UploadFile
from fastapi.exceptions import RequestValidationError
from fastapi.params import Depends as Dependency
from fastapi.routing import APIRoute
from pydantic import Field
from starlette.datastructures import Headers
from starlette.routing import Match
from starlette.types import Scope

from app.api.demonstrations import Uploaded
from app.api.dependencies import LabOf
from app.api.schemas import Answer, GeometryTold, Height, SceneSent, SegmentSent, refusals
from app.service import captures
from app.service.captures import Captured, SentFile, SentLabels, declared

FORM = "multipart/form-data"


class FormRoute(APIRoute):
    """A route for forms alone; another may have the same path for JSON."""

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """Return no match where something else than a form is sent."""
        kind = Headers(scope=scope).get("content-type", "") if scope["type"] == "http" else ""
        return super().matches(scope) if kind.startswith(FORM) else (Match.NONE, {})


router = APIRouter(prefix="/v1", tags=["captures"])
forms = APIRouter(prefix="/v1/models/{model}/demonstrations", route_class=FormRoute)


def _takes(*names: str) -> Dependency:
    """Return what refuses a form with other fields than these."""

    async def check(request: Request) -> None:
        unknown = [name for name in await request.form() if name not in names]
        if unknown:
            raise RequestValidationError(
                [
                    {"loc": ("body", name), "type": "extra_forbidden", "msg": "there is no such field"}
                    for name in unknown
                ]
            )

    return Dependency(check)


FILE = ("file", "length_unit", "up_axis")

Unit = Annotated[
    Literal["m", "cm", "mm"] | None, Form(description="Of the file's numbers, where its format has none.")
]
Up = Annotated[Literal["z", "y"] | None, Form(description="The axis that is up, where the format has none.")]


class CaptureTold(Answer):
    """What is in a motion-capture file: named tracks in metres, Z up."""

    format: str
    rate_hz: float | None
    t: list[float]
    tracks: dict[str, list[list[float] | None]] = Field(description="`null` where a track is missing.")
    labels: list[SegmentSent]
    proposal: dict[str, Any] | None = Field(description="A `mapping` that the names suggest.")
    reasons: list[str] = Field(description="Why that mapping.")
    notes: list[str] = Field(description="What was noticed on reading.")

    @classmethod
    def of(cls, captured: Captured) -> Self:
        """Return what is told of a file."""
        labels = [
            SegmentSent(action=label.action, start_s=label.start_s, end_s=label.end_s)
            for label in captured.labels
        ]
        return cls(
            format=captured.format,
            rate_hz=captured.rate,
            t=captured.times,
            tracks=captured.tracks,
            labels=labels,
            proposal=captured.proposal,
            reasons=captured.reasons,
            notes=captured.notes,
        )


@router.post(
    "/captures",
    summary="Look into a motion-capture file",
    responses=refusals(400, 413, 503),
    dependencies=[_takes(*FILE)],
)
def look(file: UploadFile, length_unit: Unit = None, up_axis: Up = None) -> CaptureTold:
    """C3D, QTM TSV, Vicon Nexus and Motive CSV, TRC, BVH, MCAP, ROS bags, plain CSV, NPZ. Nothing is kept."""
    return CaptureTold.of(captures.look(_sent(file, length_unit, up_axis)))


@forms.post(
    "",
    status_code=201,
    include_in_schema=False,
    dependencies=[_takes(*FILE, "mapping", "segments", "actions", "table_height_m")],
)
def upload(
    model: str,
    file: UploadFile,
    mapping: Annotated[str, Form()],
    lab: LabOf,
    segments: Annotated[UploadFile | None, File()] = None,
    actions: Annotated[str | None, Form()] = None,
    length_unit: Unit = None,
    up_axis: Up = None,
    table_height_m: Annotated[Height | None, Form()] = None,
) -> Uploaded:
    """A labelled motion-capture file, all or nothing; told of in OpenAPI beside the JSON of the same path."""
    scene = None if table_height_m is None else SceneSent(table_height_m=table_height_m).read()
    labels = None if segments is None else segments.file.read()
    shown = SentLabels(mapping, labels, actions)
    added = captures.add(lab, model, _sent(file, length_unit, up_axis), shown, scene)
    return Uploaded(created=list(added.created), duplicates=list(added.duplicates), geometry=GeometryTold())


def _sent(file: UploadFile, length_unit: Unit, up_axis: Up) -> SentFile:
    return SentFile(file.file.read(), file.filename or "", declared(length_unit, up_axis))
