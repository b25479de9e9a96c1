"""What requests and answers are made of. Unknown fields in requests are refused."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from fastapi import Header
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, model_validator

from app.motion.trajectory import FARTHEST_M, Scene
from app.service.geometry import Geometry
from app.service.uploads import SentSegment, SentTrajectory

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$")]
"""Of a model or an alias."""
ActionName = Annotated[str, Field(pattern=r"^[^\W_][\w .-]{0,98}$", description="An action class.")]
ObjectName = Annotated[str, Field(min_length=1, max_length=64)]
Point = Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]
Track = Annotated[list[Point | None], Field(min_length=1)]
Height = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M, allow_inf_nan=False)]
PageSize = Annotated[int, Field(ge=1, le=500, description="Records in this page at most.")]
PageToken = Annotated[str | None, Field(max_length=1000, description="`next_page_token` of the page before.")]
IdempotencyKey = Annotated[str | None, Header(max_length=200, description="The same key gives the same job.")]


class Request(BaseModel):
    """The root of all request bodies."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Answer(BaseModel):
    """The root of all answers."""

    model_config = ConfigDict(frozen=True)


class GeometrySent(Request):
    """How the numbers of an upload are meant; with y up, (x, y, z) becomes (x, -z, y)."""

    length_unit: Literal["m", "cm", "mm"]
    up_axis: Literal["z", "y"]

    def read(self) -> Geometry:
        """Return it as the service knows it."""
        return Geometry(self.length_unit, self.up_axis)


class SceneSent(Request):
    """What stands still."""

    table_height_m: Height

    def read(self) -> Scene:
        """Return it as the core knows it."""
        return Scene(self.table_height_m)


class Upload(Request):
    """The root of what carries motion: how its numbers are meant."""

    geometry: GeometrySent
    scene: SceneSent | None = Field(None, description="Default: that of the model.")

    def ground(self) -> tuple[Geometry, Scene | None]:
        """Return geometry and scene as service and core know them."""
        return self.geometry.read(), None if self.scene is None else self.scene.read()


class TrajectorySent(Request):
    """Timed positions; `null` in place of a position is a dropout. Either `t` or `rate_hz`."""

    t: Annotated[list[FiniteFloat], Field(min_length=1)] | None = Field(
        None, description="Strictly increasing [s]."
    )
    rate_hz: float | None = Field(None, gt=0, le=100_000, allow_inf_nan=False)
    hand: Track
    objects: dict[ObjectName, Track] = Field({}, max_length=64)

    @model_validator(mode="after")
    def _has_times(self) -> Self:
        if (self.t is None) == (self.rate_hz is None):
            raise ValueError("needs either `t` or `rate_hz`")
        if self.t is not None and len(self.t) != len(self.hand):
            raise ValueError(f"`t` has {len(self.t)} frames, `hand` has {len(self.hand)}")
        return self

    def read(self) -> SentTrajectory:
        """Return it as the service knows it."""
        return SentTrajectory(hand=self.hand, t=self.t, rate_hz=self.rate_hz, objects=self.objects)


class SegmentSent(Request):
    """A label; frame `end_s` is the goal."""

    action: ActionName
    start_s: FiniteFloat
    end_s: FiniteFloat

    def read(self) -> SentSegment:
        """Return it as the service knows it."""
        return SentSegment(self.action, self.start_s, self.end_s)


class RecordingSent(Request):
    """A long trajectory with its labels."""

    trajectory: TrajectorySent
    segments: list[SegmentSent] = Field(min_length=1)

    def labels(self) -> list[SentSegment]:
        """Return the labels as the service knows them."""
        return [segment.read() for segment in self.segments]


class GeometryTold(Answer):
    """The geometry as it was understood, or that of the answer."""

    length_unit: Literal["m", "cm", "mm"] = "m"
    up_axis: Literal["z", "y"] = "z"

    @classmethod
    def of(cls, geometry: Geometry) -> Self:
        """Return what is told of a geometry."""
        return cls(length_unit=geometry.length_unit, up_axis=geometry.up_axis)


class SegmentTold(Answer):
    """A segment, as a `segment` event of the stream tells it; `action` null: none that the model knows."""

    segment: int
    start_seq: int
    end_seq: int
    t_start: float
    t_end: float
    action: str | None
    objects: dict[str, str] = Field(description="Which object fills which role.")
    log_likelihoods: dict[str, float | None]
    margin: float | None
    novelty: float | None = Field(description="Larger: more unlike everything trained [nat per frame].")
    model: str
    version: int


class Problem(Answer):
    """An error (RFC 9457)."""

    type: str = "about:blank"
    title: str
    status: int
    detail: str
    code: str = Field(description="Stable, snake_case.")
    errors: list[dict[str, str]] = Field(description="Places: JSON pointer, code and detail of each.")
    request_id: str


def refusals(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return what OpenAPI says of the errors of an endpoint."""
    content = {"application/problem+json": {"schema": Problem.model_json_schema()}}
    return {status: {"description": TITLES[status], "content": content} for status in (*statuses, 422)}


TITLES = {
    400: "Malformed",
    403: "Forbidden",
    404: "Not found",
    406: "No such form",
    409: "Conflict",
    410: "Gone",
    412: "Precondition failed",
    413: "Too large",
    415: "Unsupported media type",
    422: "Refused content",
    503: "Not now",
}
