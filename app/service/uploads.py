"""Uploads become trajectories, demonstrations and recordings, or are refused whole, place by place.

What arrives are the parsed fields of API.md's *trajectory*; what leaves is in metres, Z up.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from app.motion.errors import InvalidSegment, InvalidTrajectory, RoleMissing, UnusableDemonstration
from app.motion.hypothesis import REST
from app.motion.model import FeatureSpecification
from app.motion.training import check_demonstration
from app.motion.trajectory import Demonstration, Floats, Recording, Scene, Segment, Trajectory
from app.registry import demonstrations, models
from app.registry.artifacts import dump_demonstration, dump_recording
from app.registry.records import Added, ModelRecord
from app.service.errors import ContentRefused, Issue
from app.service.geometry import Geometry
from app.service.lab import Lab

Position = Sequence[float]
Result = TypeVar("Result")

MAX_ISSUES = 20
"""Places that a refusal names."""


@dataclass(frozen=True)
class SentTrajectory:
    """A trajectory as sent: ``t`` [s] or ``rate_hz`` [Hz]; positions in the declared unit, None a dropout."""

    hand: Sequence[Position | None]
    t: Sequence[float] | None = None
    rate_hz: float | None = None
    objects: Mapping[str, Sequence[Position | None]] = field(default_factory=dict)


@dataclass(frozen=True)
class SentSegment:
    """A label as sent: an action from start_s to end_s [s], which names the goal frame."""

    action: str
    start_s: float
    end_s: float


def read_trajectory(sent: SentTrajectory, geometry: Geometry, pointer: str = "") -> Trajectory:
    """Return a trajectory in metres, Z up. Raises ContentRefused, which names the field and the frame."""
    tracks = {"hand": sent.hand, **{f"objects.{name}": track for name, track in sent.objects.items()}}
    n_frames = len(sent.hand)
    for name, track in tracks.items():
        if len(track) != n_frames:
            detail = f"has {len(track)} frames, hand has {n_frames}"
            raise ContentRefused([Issue(_place(pointer, name, None), "wrong_length", detail)])
    times = np.asarray(sent.t, float) if sent.rate_hz is None else np.arange(n_frames) / sent.rate_hz
    moved = {name: geometry.to_metres(_positions(track)) for name, track in tracks.items()}
    objects = {name: moved[f"objects.{name}"] for name in sent.objects}
    try:
        return Trajectory(times, moved["hand"], objects)
    except InvalidTrajectory as error:
        place = _place(pointer, "t" if error.field == "times" else error.field, error.frame)
        raise ContentRefused([Issue(place, error.code, error.detail)]) from error


def as_sent(trajectory: Trajectory) -> SentTrajectory:
    """Return a trajectory as it would be sent in metres, Z up; inverts ``read_trajectory``."""
    return SentTrajectory(
        hand=rows_of(trajectory.hand),
        t=trajectory.times.tolist(),
        objects={name: rows_of(track) for name, track in trajectory.objects.items()},
    )


def read_recording(
    sent: SentTrajectory, labels: Sequence[SentSegment], geometry: Geometry, scene: Scene
) -> Recording:
    """Return a labelled recording, every label at the frames nearest to its times.

    Raises ContentRefused.
    """
    trajectory = read_trajectory(sent, geometry, "/recording/trajectory")
    segments, places = [], []
    begin, finish = trajectory.times[[0, -1]].tolist()
    slack = _half_period(trajectory)
    for index, label in sorted(enumerate(labels), key=lambda pair: pair[1].start_s):
        places.append(f"/recording/segments/{index}")
        if not begin - slack <= label.start_s < label.end_s <= finish + slack:
            detail = f"must start before its end and lie within {begin:g} to {finish:g} s"
            raise ContentRefused([Issue(places[-1], "invalid_segment", detail)])
        start, end = (_nearest(trajectory.times, time) for time in (label.start_s, label.end_s))
        segments.append(Segment(start, end, label.action))
    try:
        return Recording(trajectory, tuple(segments), scene)
    except InvalidSegment as error:
        raise ContentRefused([Issue(places[error.index], "invalid_segment", str(error))]) from error


def add_demonstrations(
    lab: Lab, model: str, sent: Sequence[tuple[str, SentTrajectory]], geometry: Geometry, scene: Scene | None
) -> Added:
    """Add (action, trajectory) pairs, all or none. Raises NotFound, ContentRefused."""
    specification, chosen = ground(lab, model, scene)
    pointers = [f"/demonstrations/{index}" for index in range(len(sent))]

    def read(index: int) -> Demonstration:
        action, trajectory = sent[index]
        return Demonstration(
            action, read_trajectory(trajectory, geometry, f"{pointers[index]}/trajectory"), chosen
        )

    found = _all(read, range(len(sent)))
    return keep(lab, model, found, specification, pointers)


def add_recording(
    lab: Lab,
    model: str,
    sent: SentTrajectory,
    labels: Sequence[SentSegment],
    geometry: Geometry,
    scene: Scene | None,
) -> Added:
    """Add the labelled segments of a recording, all or none, and keep the recording they are from.

    Raises NotFound, ContentRefused.
    """
    specification, chosen = ground(lab, model, scene)
    ordered = sorted(range(len(labels)), key=lambda index: labels[index].start_s)
    recording = read_recording(sent, labels, geometry, chosen)
    pointers = [f"/recording/segments/{index}" for index in ordered]
    return keep_recording(lab, model, recording, specification, pointers)


def specification_of(model: ModelRecord) -> FeatureSpecification:
    """Return what the action models of a model observe."""
    return FeatureSpecification(model.objects, **model.features)


def keep_recording(
    lab: Lab,
    model: str,
    recording: Recording,
    specification: FeatureSpecification,
    pointers: Sequence[str],
) -> Added:
    """Keep the demonstrations of a labelled recording, and the recording: see ``keep``."""
    meta = {"recording": lab.store.put(dump_recording(recording))}
    return keep(lab, model, recording.demonstrations(), specification, pointers, meta)


def keep(
    lab: Lab,
    model: str,
    found: Sequence[Demonstration],
    specification: FeatureSpecification,
    pointers: Sequence[str],
    meta: Mapping[str, Any] | None = None,
) -> Added:
    """Check all demonstrations, then store them, then acknowledge them in one transaction.

    pointers: the place of each in the request. Raises NotFound, ContentRefused.
    """

    def check(index: int) -> None:
        if found[index].action == REST:
            detail = f"{REST!r} is what a hypothesis calls no action; name the class otherwise"
            raise ContentRefused([Issue(f"{pointers[index]}/action", "reserved_name", detail)])
        try:
            check_demonstration(index, found[index], specification)
        except (RoleMissing, UnusableDemonstration) as error:
            code = "role_missing" if isinstance(error, RoleMissing) else "unusable_demonstration"
            raise ContentRefused([Issue(pointers[index], code, str(error))]) from error

    _all(check, range(len(found)))
    kept = [(item, lab.store.put(dump_demonstration(item))) for item in found]
    with lab.database.transaction() as tx:
        return demonstrations.add(tx, model, [demonstrations.describe(*item, meta) for item in kept])


def ground(lab: Lab, model: str, scene: Scene | None) -> tuple[FeatureSpecification, Scene]:
    """Return what a model observes, and the scene or that of the model. Raises NotFound."""
    with lab.database.reading() as tx:
        record = models.get(tx, model)
    return specification_of(record), scene or Scene(record.table_height_m)


def _all(step: Callable[[int], Result], indices: Iterable[int]) -> list[Result]:
    """Return what the step makes of each; what any of them refuses is refused together."""
    results: list[Result] = []
    issues: list[Issue] = []
    for index in indices:
        try:
            results.append(step(index))
        except ContentRefused as error:
            issues += error.issues
    if issues:
        raise ContentRefused(issues[:MAX_ISSUES])
    return results


def _positions(track: Sequence[Position | None]) -> Floats:
    dropout = [np.nan] * 3
    rows = [dropout if position is None else position for position in track]
    return np.array(rows, dtype=np.float64).reshape(len(rows), 3)


def rows_of(track: Floats) -> list[Position | None]:
    """Return positions (n, 3) as they are sent; a dropout is None."""
    return [None if np.isnan(position[0]) else position.tolist() for position in track]


def _place(pointer: str, name: str, frame: int | None) -> str:
    steps = [step.replace("~", "~0").replace("/", "~1") for step in name.split(".", 1)]
    return "/".join([pointer, *steps, *([] if frame is None else [str(frame)])])


def _nearest(times: Floats, time: float) -> int:
    return int(np.abs(times - time).argmin())


def _half_period(trajectory: Trajectory) -> float:
    return float(np.median(np.diff(trajectory.times))) / 2 if len(trajectory) > 1 else 0.0
