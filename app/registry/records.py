"""What the registry hands out: frozen records, free of the database. Times are aware, in UTC."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Generic, Literal, TypedDict, TypeVar

Json = dict[str, Any]
JobState = Literal["queued", "running", "succeeded", "failed", "cancelled"]
SessionState = Literal["active", "ended", "expired"]

Record = TypeVar("Record")


@dataclass(frozen=True)
class Page(Generic[Record]):
    """Part of a listing; ``next_token`` asks for the part after it, None at the end."""

    records: tuple[Record, ...]
    next_token: str | None


@dataclass(frozen=True)
class ModelRecord:
    """A model: its roles, the height of its table [m], free settings of its features."""

    name: str
    objects: tuple[str, ...]
    table_height_m: float
    description: str | None
    features: Json
    etag: str
    created_at: datetime
    updated_at: datetime


class ModelChanges(TypedDict, total=False):
    """What can be changed of a model; table height [m]."""

    description: str | None
    table_height_m: float


@dataclass(frozen=True)
class NewDemonstration:
    """A demonstration whose payload is in the store under ``digest``; duration [s], table height [m]."""

    action: str
    digest: str
    n_frames: int
    duration_s: float
    objects: tuple[str, ...]
    table_height_m: float
    meta: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class DemonstrationRecord:
    """A demonstration of a model; its trajectory is in the store under ``digest``."""

    id: str
    model: str
    action: str
    digest: str
    n_frames: int
    duration_s: float
    objects: tuple[str, ...]
    table_height_m: float
    meta: Json
    created_at: datetime


@dataclass(frozen=True)
class Added:
    """What became of uploaded demonstrations: ids of the new, and of those that were there before."""

    created: tuple[str, ...]
    duplicates: tuple[str, ...]


@dataclass(frozen=True)
class VersionRecord:
    """A model version: what it is (artifact), what it knows (actions), what it was made of.

    base: the version it went on from; job_id: the job that made it; aliases: those that name it now.
    """

    model: str
    number: int
    artifact_digest: str
    actions: tuple[str, ...]
    options: Json
    seed: int | None
    demonstrations: tuple[str, ...]
    base: int | None
    library_versions: Json
    evaluation: Json | None
    job_id: str | None
    created_at: datetime
    aliases: tuple[str, ...] = ()

    @property
    def etag(self) -> str:
        """The digest of the artifact, as an entity tag."""
        return f'"{self.artifact_digest}"'


@dataclass(frozen=True)
class AliasRecord:
    """A movable name for a version."""

    model: str
    alias: str
    version: int
    updated_at: datetime


@dataclass(frozen=True)
class AliasChange:
    """One move of an alias; ``version`` None: it was deleted, ``previous`` None: it was new."""

    model: str
    alias: str
    version: int | None
    previous: int | None
    by: str | None
    at: datetime


@dataclass(frozen=True)
class JobRecord:
    """Work that outlasts its request; ``done`` of ``total`` steps, ``error`` is a problem object.

    attempt: counts who has taken it on; worker: the one who did so last, None once it was laid down.
    """

    id: str
    kind: str
    model: str | None
    request: Json
    state: JobState
    done: int
    total: int
    message: str
    result: Json | None
    error: Json | None
    cancel_requested: bool
    attempt: int
    worker: str | None
    created_at: datetime
    updated_at: datetime

    @property
    def finished(self) -> bool:
        """Whether nothing will change any more."""
        return self.state not in ("queued", "running")


@dataclass(frozen=True)
class SessionRecord:
    """A recognition session; the counts are of what is durable, ``start`` is what its client asked for.

    epoch: counts the processes that have taken it on; only the last of them may write to it.
    """

    id: str
    name: str | None
    model: str
    version: int
    token_hash: str
    state: SessionState
    geometry: Json
    channels: tuple[str, ...]
    start: Json
    n_frames: int
    n_events: int
    n_segments: int
    frames_kept: bool
    created_at: datetime
    last_seen_at: datetime
    artifact_digest: str | None
    epoch: int


@dataclass(frozen=True)
class Checkpoint:
    """What a session's recogniser is in the midst of after so many frames, which gave so many events."""

    n_frames: int
    n_events: int
    n_segments: int
    state: bytes


@dataclass(frozen=True)
class StoredEvent:
    """A durable event of a session: its number, its type, its message as JSON text."""

    event: int
    type: str
    text: str


@dataclass(frozen=True)
class Chunk:
    """Frames of a session from ``first_seq`` on: rows of little-endian float64, one value per channel."""

    first_seq: int
    n_frames: int
    rows: bytes
