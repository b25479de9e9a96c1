"""The messages a client sends over the stream. Unknown fields are refused, so that typing errors are seen."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal, NoReturn

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, TypeAdapter, ValidationError

from app.api.stream_server import NOT_UTF8
from app.service.frames import Frames, Layout, from_binary, from_columns
from app.service.geometry import Geometry
from app.service.session_errors import MessageMalformed
from app.service.session_start import Ticket, Wish

FRAME_FIELDS = frozenset({"type", "first_seq", "t", "hand", "objects"})

Id = Annotated[str, Field(max_length=200)] | int
Name = Annotated[str, Field(min_length=1, max_length=64)]
"""Of an object or a goal."""
Place = Annotated[tuple[FiniteFloat, ...], Field(min_length=3, max_length=3)]


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class GeometryOfStart(_Message):
    """How the numbers of the stream are meant."""

    length_unit: Literal["m", "cm", "mm"]
    up_axis: Literal["z", "y"]


class SceneOfStart(_Message):
    """What stands still."""

    table_height_m: float = Field(ge=-100.0, le=100.0, allow_inf_nan=False)


class Options(_Message):
    """What the client wants to hear beside the durable events."""

    hypotheses: bool = True
    hypotheses_hz: float = Field(10.0, gt=0.0, le=100.0, allow_inf_nan=False)


class Resume(_Message):
    """Which session goes on, and the last durable event that the client has (-1: none)."""

    session_id: str = Field(max_length=200)
    token: str = Field(max_length=200)
    last_event: int = Field(ge=-1)


class Start(_Message):
    """The first message."""

    type: Literal["start"]
    model: str = Field(max_length=200)
    version: str | int | None = None
    geometry: GeometryOfStart
    rate_hz: float | None = Field(None, gt=0.0, le=100_000.0, allow_inf_nan=False)
    objects: tuple[Name, ...] | None = Field(None, max_length=32)
    scene: SceneOfStart | None = None
    goals: dict[Name, Place] = Field({}, max_length=32)
    name: str | None = Field(None, max_length=200)
    encoding: Literal["json", "f32", "f64"] = "json"
    options: Options = Options()
    resume: Resume | None = None

    def wish(self) -> Wish:
        """Return what the session is asked to be."""
        return Wish(
            model=self.model,
            version=None if self.version is None else str(self.version),
            geometry=Geometry(self.geometry.length_unit, self.geometry.up_axis),
            rate_hz=self.rate_hz,
            objects=self.objects,
            table_height=None if self.scene is None else self.scene.table_height_m,
            goals=self.goals,
            name=self.name,
            encoding=self.encoding,
        )

    def ticket(self, resume: Resume) -> Ticket:
        """Return what a client comes back with."""
        return Ticket(resume.session_id, resume.token, resume.last_event, self.wish())


class Flush(_Message):
    """Answer when all that was received has been processed."""

    type: Literal["flush"]
    id: Id


class End(_Message):
    """No more frames."""

    type: Literal["end"]
    last_seq: int | None = Field(None, ge=-1)


class Ping(_Message):
    """Answer at once."""

    type: Literal["ping"]
    id: Id


Control = Flush | End | Ping
_CONTROL: dict[str, TypeAdapter[Control]] = {
    "flush": TypeAdapter(Flush),
    "end": TypeAdapter(End),
    "ping": TypeAdapter(Ping),
}


def read_start(message: str | bytes) -> Start:
    """Read the first message. Raises MessageMalformed; anything but a start is refused."""
    parsed = None if isinstance(message, bytes) else _parse(message)
    if parsed is None or parsed["type"] != "start":
        kind = "a binary message" if parsed is None else f"`{parsed['type']}`"
        raise MessageMalformed("start_expected", f"the first message must be `start`, got {kind}")
    try:
        return Start.model_validate_json(message)
    except ValidationError as error:
        _refuse(error)


def read(message: str | bytes, layout: Layout) -> Frames | Control:
    """Read any later message. Raises MessageMalformed."""
    if isinstance(message, bytes):
        return from_binary(layout, message)
    parsed = _parse(message)
    kind = parsed["type"]
    if kind == "frames":
        if unknown := parsed.keys() - FRAME_FIELDS:
            raise MessageMalformed("malformed", f"`{min(unknown)[:60]}`: unknown field of `frames`")
        first_seq, times, hand = (parsed.get(field) for field in ("first_seq", "t", "hand"))
        return from_columns(layout, first_seq, times, hand, parsed.get("objects", {}))
    if kind == "start":
        raise MessageMalformed("already_started", "the stream has been started")
    if kind not in _CONTROL:
        raise MessageMalformed("unknown_type", f"no message has the type {str(kind)[:40]!r}")
    try:
        return _CONTROL[kind].validate_json(message)
    except ValidationError as error:
        _refuse(error)


def _parse(message: str) -> dict[str, Any]:
    try:
        parsed = json.loads(message)
    except (ValueError, RecursionError) as error:
        detail = "not UTF-8" if message == NOT_UTF8 else f"not JSON: {error}"
        raise MessageMalformed("malformed", detail) from error
    if not isinstance(parsed, dict) or not isinstance(parsed.get("type"), str):
        raise MessageMalformed("malformed", "a message is a JSON object with a `type`")
    return parsed


def _refuse(error: ValidationError) -> NoReturn:
    first = error.errors(include_url=False, include_context=False)[0]
    field = ".".join(str(part) for part in first["loc"])[:60]
    raise MessageMalformed("malformed", f"`{field}`: {first['msg']}") from error
