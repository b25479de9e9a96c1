"""Sessions: ``/v1/sessions``, also those that other clients feed."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import datetime
from typing import Annotated, Any, Self

from fastapi import APIRouter, Header, Path, Query
from pydantic import ConfigDict, Field
from pydantic.config import JsonDict
from starlette.responses import Response, StreamingResponse

from app.api.dependencies import LabOf, LiveOf
from app.api.schemas import (
    ActionName,
    Answer,
    GeometryTold,
    PageSize,
    PageToken,
    Request,
    SegmentTold,
    refusals,
)
from app.api.stream_events import EventStream, Provisional, listen
from app.api.trajectory_told import TrajectoryTold
from app.registry.records import SessionRecord, SessionState
from app.service import review, session_archive
from app.service.session_archive import SessionRecording

router = APIRouter(prefix="/v1/sessions", tags=["sessions"])

Seq = Annotated[int, Field(ge=0, lt=2**53)]

SESSION: JsonDict = {
    "id": "5e5510f0a4c34c2b8d0c4c3e9d3c7b1a",
    "name": "morning",
    "model": "table-top",
    "version": 3,
    "state": "active",
    "geometry": {"length_unit": "mm", "up_axis": "y"},
    "objects": ["cup", "saucer"],
    "rate_hz": 100.0,
    "scene": {"table_height_m": 0.0},
    "goals": {"shelf": [0.4, 0.2, 0.9]},
    "frames": 4120,
    "events": 9,
    "segments": 8,
    "frames_kept": True,
    "created_at": "2025-05-05T08:00:00Z",
    "last_seen_at": "2025-05-05T08:00:41Z",
}
SEGMENT: JsonDict = {
    "type": "segment",
    "event": 0,
    "segment": 0,
    "start_seq": 12,
    "end_seq": 97,
    "t_start": 0.12,
    "t_end": 0.97,
    "action": "grasp",
    "objects": {"object": "cup"},
    "log_likelihoods": {"grasp": 412.5, "retract": 130.25},
    "margin": 282.25,
    "novelty": 0.4,
    "model": "table-top",
    "version": 3,
}
RECORDING: JsonDict = {
    "session": "5e5510f0a4c34c2b8d0c4c3e9d3c7b1a",
    "model": "table-top",
    "version": 3,
    "geometry": {"length_unit": "m", "up_axis": "z"},
    "scene": {"table_height_m": 0.0},
    "trajectory": {
        "t": [0.0, 0.01],
        "hand": [[0.1, 0.2, 0.3], None],
        "objects": {"object": [[0.4, 0.2, 0.0], [0.4, 0.2, 0.0]]},
    },
}


class SceneTold(Answer):
    """What stands still."""

    table_height_m: float


class SessionTold(Answer):
    """A session; the counts are of what is durable."""

    model_config = ConfigDict(json_schema_extra={"examples": [SESSION]})

    id: str
    name: str | None
    model: str
    version: int
    state: SessionState = Field(description="`expired`: its process died and nobody came back in time.")
    geometry: GeometryTold = Field(description="Of the stream; answers are in metres, Z up.")
    objects: list[str]
    rate_hz: float | None = Field(description="None: the frames carried their times.")
    scene: SceneTold
    goals: dict[str, list[float]] = Field(description="Where movements may go [m].")
    frames: int
    events: int
    segments: int
    frames_kept: bool = Field(description="Whether the recording can still be had.")
    created_at: datetime
    last_seen_at: datetime

    @classmethod
    def of(cls, record: SessionRecord) -> Self:
        """Return what is told of a session."""
        return cls(
            id=record.id,
            name=record.name,
            model=record.model,
            version=record.version,
            state=record.state,
            geometry=GeometryTold.model_validate(record.geometry),
            objects=list(session_archive.objects_of(record)),
            rate_hz=record.start["rate_hz"],
            scene=SceneTold(table_height_m=record.start["table_height_m"]),
            goals=record.start.get("goals", {}),
            frames=record.n_frames,
            events=record.n_events,
            segments=record.n_segments,
            frames_kept=record.frames_kept,
            created_at=record.created_at,
            last_seen_at=record.last_seen_at,
        )


class SessionsTold(Answer):
    """A page of sessions, the newest first."""

    sessions: list[SessionTold]
    next_page_token: str | None


class SegmentEventTold(SegmentTold):
    """A `segment` event of the stream; the AsyncAPI document says what its fields are."""

    model_config = ConfigDict(json_schema_extra={"examples": [SEGMENT]}, extra="allow")

    event: int


class SegmentsTold(Answer):
    """Segments of a session, in order."""

    segments: list[SegmentEventTold]


class Review(Request):
    """What a segment shows, in the eyes of somebody who knows."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"action": "grasp"}]})

    action: ActionName
    start_seq: Seq | None = Field(None, description="Its first frame; default: the segment's own.")
    end_seq: Seq | None = Field(None, description="Its goal, the last frame; default: the segment's own.")


class Learned(Answer):
    """What became of a reviewed segment: a demonstration, or one that the model had before."""

    created: list[str]
    duplicates: list[str]
    model: str


class RecordingTold(Answer):
    """The frames of a session; `trajectory`, `geometry` and `scene` are fit for an upload."""

    model_config = ConfigDict(json_schema_extra={"examples": [RECORDING]})

    session: str
    model: str
    version: int
    geometry: GeometryTold
    scene: SceneTold
    trajectory: TrajectoryTold


@router.get("", summary="List sessions, the newest first", responses=refusals())
def listing(
    lab: LabOf,
    state: SessionState | None = None,
    name: Annotated[str | None, Query(max_length=200)] = None,
    page_size: PageSize = 50,
    page_token: PageToken = None,
) -> SessionsTold:
    """All of them, or those in one state or of one name."""
    page = session_archive.page(lab, size=page_size, after=page_token, state=state, name=name)
    return SessionsTold(
        sessions=[SessionTold.of(record) for record in page.records], next_page_token=page.next_token
    )


@router.get("/{session}", summary="Look a session up", responses=refusals(404))
def get(session: str, lab: LabOf) -> SessionTold:
    """What it is, and how far it has come."""
    return SessionTold.of(session_archive.get(lab, session))


@router.delete("/{session}", summary="End a session", responses=refusals(404, 503))
async def end(session: str, live: LiveOf) -> SessionTold:
    """What is open is decided, and `ended` becomes its last event; one that has ended stays so."""
    return SessionTold.of(await live.end(session))


@router.get(
    "/{session}/segments",
    summary="The segments recognised in a session",
    response_model=SegmentsTold,
    responses=refusals(404),
)
def segments(
    session: str,
    lab: LabOf,
    after: Annotated[int, Query(ge=-1, lt=2**53, description="A segment number.")] = -1,
) -> Response:
    """Those after number `after`, as far as they are decided."""
    texts = [stored.text for stored in session_archive.segments(lab, session, after)]
    return Response(f'{{"segments":[{",".join(texts)}]}}', media_type="application/json")


@router.post(
    "/{session}/segments/{segment}:learn",
    status_code=201,
    summary="Learn from a segment",
    responses=refusals(400, 404, 409, 410),
)
def learn(session: str, segment: Annotated[int, Path(ge=0, lt=2**53)], body: Review, lab: LabOf) -> Learned:
    """Reviewed, it becomes a demonstration of the session's model, while the session lives or after it.

    Its objects are those that filled the roles. Kept once by content, as uploads are. 409: a frame is not
    durable yet; 410: the frames are no longer kept.
    """
    model, added = review.learn_segment(lab, session, segment, body.action, body.start_seq, body.end_seq)
    return Learned(created=list(added.created), duplicates=list(added.duplicates), model=model)


@router.get(
    "/{session}/recording",
    summary="The frames of a session",
    response_model=RecordingTold,
    responses=refusals(404, 410),
)
def recording(session: str, lab: LabOf) -> StreamingResponse:
    """In metres, Z up, as far as they are durable; 410 once they are no longer kept."""
    found = session_archive.recording(lab, session)
    return StreamingResponse(_told(found), media_type="application/json")


@router.get(
    "/{session}/events",
    summary="Listen to a session",
    response_class=EventStream,
    responses={204: {"description": "The session has ended and has no further events."}, **refusals(404)},
)
def events(
    session: str,
    lab: LabOf,
    live: LiveOf,
    include: Annotated[str, Query(pattern=r"^((frames|hypotheses)(,(frames|hypotheses))?)?$")] = "",
    last_event_id: Annotated[int, Header(ge=-1, lt=2**53)] = -1,
) -> Response:
    """Server-sent events named like the messages of the stream, which are their data.

    The durable ones (`segment`, `gap`, `ended`) have their number as `id`, so that a listener that comes
    back with `Last-Event-ID` misses none. `include=frames,hypotheses` adds `frame` (`seq`, `t`, `hand`,
    `objects` in metres, Z up) and `hypothesis`, the latest of each at most 20 times a second, without id;
    only from the process that the session lives in.
    """
    record = session_archive.get(lab, session)
    if record.state != "active" and last_event_id >= record.n_events - 1:
        return Response(status_code=204)
    wanted: set[Provisional] = {kind for kind in ("frames", "hypotheses") if kind in include.split(",")}
    headers = {"Cache-Control": "no-cache", "X-Accel-Buffering": "no"}
    return EventStream(listen(live, session, last_event_id, wanted), headers=headers)


def _told(found: SessionRecording) -> Iterator[str]:
    record = found.record
    fields: dict[str, Any] = {
        "session": record.id,
        "model": record.model,
        "version": record.version,
        "geometry": GeometryTold().model_dump(),
        "scene": {"table_height_m": record.start["table_height_m"]},
    }
    yield json.dumps(fields)[:-1] + ', "trajectory":'
    yield from found.trajectory()
    yield "}"
