"""What the server answers, as types; what each field means is told by ``/v1/openapi.json``."""

from __future__ import annotations

from typing import Any, Literal, TypedDict

Position = list[float]
Track = list[Position | None]


class Geometry(TypedDict):
    """What numbers mean."""

    length_unit: Literal["m", "cm", "mm"]
    up_axis: Literal["z", "y"]


class Scene(TypedDict):
    """What stands still."""

    table_height_m: float


class Features(TypedDict):
    """How motion is observed."""

    rate_hz: float | None


class Trajectory(TypedDict):
    """Timed positions [s], [m]; None is a dropout."""

    t: list[float]
    hand: Track
    objects: dict[str, Track]


class Model(TypedDict):
    """A model."""

    name: str
    objects: list[str]
    table_height_m: float
    description: str | None
    features: Features
    created_at: str
    updated_at: str


class ModelWithActions(Model):
    """A model, and how many demonstrations each of its classes has."""

    actions: dict[str, int]


class Uploaded(TypedDict):
    """What became of an upload."""

    created: list[str]
    duplicates: list[str]
    geometry: Geometry


class Demonstration(TypedDict):
    """A demonstration."""

    id: str
    action: str
    n_frames: int
    duration_s: float
    objects: list[str]
    table_height_m: float
    digest: str
    created_at: str
    geometry: Geometry
    trajectory: Trajectory


class Progress(TypedDict):
    """How far a job is."""

    done: int
    total: int
    message: str


class Job(TypedDict):
    """A job."""

    id: str
    kind: str
    model: str | None
    state: Literal["queued", "running", "succeeded", "failed", "cancelled"]
    progress: Progress
    result: dict[str, Any] | None
    error: dict[str, Any] | None
    created_at: str
    updated_at: str


class Version(TypedDict):
    """A version."""

    model: str
    version: int
    actions: list[str]
    aliases: list[str]
    options: dict[str, Any]
    seed: int | None
    demonstrations: list[str]
    base: int | None
    library_versions: dict[str, str]
    evaluation: dict[str, Any] | None
    digest: str
    job_id: str | None
    created_at: str
    lineage: list[int]


class Alias(TypedDict):
    """An alias."""

    alias: str
    version: int
    updated_at: str


class Violation(TypedDict):
    """Where a movement is beyond a bound."""

    kind: str
    t: float
    value: float
    limit: float


class Notice(TypedDict):
    """What is to be known about a movement."""

    code: str
    detail: str


class Feasibility(TypedDict):
    """What stands against a movement."""

    feasible: bool
    duration_s: float
    violations: list[Violation]
    warnings: list[Notice]


class Movement(TypedDict):
    """A generated movement."""

    t: list[float]
    position: list[Position]
    velocity: list[Position]
    acceleration: list[Position]
    std: list[Position]
    model: str
    version: int
    frame_id: str | None
    feasibility: Feasibility


class Generated(Movement):
    """A movement of one action."""

    action: str


class Step(TypedDict):
    """A part of a task."""

    action: str
    goal: Position
    t_start: float
    t_end: float


class Task(Movement):
    """One movement through several actions."""

    steps: list[Step]


class Segment(TypedDict):
    """A segment."""

    segment: int
    start_seq: int
    end_seq: int
    t_start: float
    t_end: float
    action: str | None
    objects: dict[str, str]
    log_likelihoods: dict[str, float | None]
    margin: float | None
    novelty: float | None
    model: str
    version: int


class SegmentEvent(Segment):
    """A segment of a session, and the number of its event."""

    event: int


class SegmentEvents(TypedDict):
    """The segments of a session."""

    segments: list[SegmentEvent]


class Session(TypedDict):
    """A session."""

    id: str
    name: str | None
    model: str
    version: int
    state: Literal["active", "ended", "expired"]
    geometry: Geometry
    objects: list[str]
    rate_hz: float | None
    scene: Scene
    goals: dict[str, Position]
    frames: int
    events: int
    segments: int
    frames_kept: bool
    created_at: str
    last_seen_at: str


class Learned(TypedDict):
    """What became of a segment that is learned."""

    created: list[str]
    duplicates: list[str]
    model: str


class Recording(TypedDict):
    """The frames of a session."""

    session: str
    model: str
    version: int
    geometry: Geometry
    scene: Scene
    trajectory: Trajectory


class Empty(TypedDict):
    """An answer without content."""
