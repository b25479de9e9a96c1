"""Artifacts: models, demonstrations and recordings as canonical JSON, and back with everything checked.

A model's object has the fields of ``Model``, arrays as nested lists; the others have those of the wire's
trajectory, in metres with Z up. All say their ``format`` and ``format_version``; what they hold
reads back bit for bit.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from app.motion.errors import InvalidSegment, InvalidTrajectory
from app.motion.model import N_SHAPE, ActionModel, FeatureSpecification, Model
from app.motion.trajectory import Demonstration, Floats, Recording, Scene, Segment, Trajectory
from app.registry import canonical
from app.registry.errors import ArtifactInvalid

MODEL = "gesta-model", 3
DEMONSTRATION = "gesta-demonstration", 1
RECORDING = "gesta-recording", 1

MOTION_FIELDS = ("table_height_m", "t", "hand", "objects")

Axis = Literal["states", "features", "demonstrations", "space", "shape"]

AXES: dict[str, tuple[Axis, ...]] = {
    "means": ("states", "features"),
    "variances": ("states", "features"),
    "stay": ("states",),
    "weights": ("states",),
    "durations": ("demonstrations",),
    "starts": ("demonstrations", "space"),
    "ways": ("demonstrations", "space"),
    "shapes": ("demonstrations", "shape"),
}
"""The axes of an action model's arrays."""

MAX_RATE, MAX_DURATION, MAX_DISTANCE = 1000.0, 600.0, 1000.0
"""What a model may hold: of the memory of a stream [Hz], [s], and of the world [m]."""

POSITIVE = ("variances", "durations")
PLACES = ("starts", "ways", "shapes")
PROBABILITIES = ("stay",)
NOT_NEGATIVE = ("weights", "stay")


def dump_model(model: Model) -> bytes:
    """Return a model as an artifact. Raises ArtifactInvalid for one that ``load_model`` would refuse."""
    _check(model)
    return _dump(MODEL, canonical.plain(model))


def load_model(data: bytes) -> Model:
    """Return the model in an artifact. Raises ArtifactInvalid, naming the field."""
    model: Model = canonical.build(Model, canonical.read(data, *MODEL))
    _check(model)
    return model


def dump_demonstration(demonstration: Demonstration) -> bytes:
    """Return a demonstration as an artifact; a dropout is null."""
    motion = _plain_motion(demonstration.trajectory, demonstration.scene)
    return _dump(DEMONSTRATION, {"action": demonstration.action, **motion})


def load_demonstration(data: bytes) -> Demonstration:
    """Return the demonstration in an artifact. Raises ArtifactInvalid, naming the field."""
    fields = canonical.read(data, *DEMONSTRATION)
    canonical.check_keys(fields, {"action", *MOTION_FIELDS}, "")
    return Demonstration(canonical.string(fields["action"], "action"), *_motion(fields))


def dump_recording(recording: Recording) -> bytes:
    """Return a recording with its labels as an artifact; a dropout is null."""
    segments = [{"start": s.start, "end": s.end, "action": s.action} for s in recording.segments]
    return _dump(RECORDING, {"segments": segments, **_plain_motion(recording.trajectory, recording.scene)})


def load_recording(data: bytes) -> Recording:
    """Return the recording in an artifact. Raises ArtifactInvalid, naming the field."""
    fields = canonical.read(data, *RECORDING)
    canonical.check_keys(fields, {"segments", *MOTION_FIELDS}, "")
    trajectory, scene = _motion(fields)
    labels = [
        _segment(label, f"segments[{at}]") for at, label in enumerate(_list(fields["segments"], "segments"))
    ]
    try:
        return Recording(trajectory, tuple(labels), scene)
    except InvalidSegment as error:
        raise ArtifactInvalid(f"segments[{error.index}]", str(error)) from error


def _segment(label: Any, place: str) -> Segment:
    canonical.check_keys(label, {"start", "end", "action"}, place)
    start, end = (canonical.number(label[name], f"{place}.{name}") for name in ("start", "end"))
    action = None if label["action"] is None else canonical.string(label["action"], f"{place}.action")
    return Segment(int(start), int(end), action)


def _plain_motion(trajectory: Trajectory, scene: Scene) -> dict[str, Any]:
    return {
        "table_height_m": scene.table_height,
        "t": trajectory.times.tolist(),
        "hand": _rows(trajectory.hand),
        "objects": {name: _rows(track) for name, track in trajectory.objects.items()},
    }


def _motion(fields: dict[str, Any]) -> tuple[Trajectory, Scene]:
    objects = fields["objects"]
    if not isinstance(objects, dict):
        raise ArtifactInvalid("objects", "must be an object")
    times = [canonical.number(time, f"t[{at}]") for at, time in enumerate(_list(fields["t"], "t"))]
    tracks = {name: _track(rows, f"objects.{name}") for name, rows in objects.items()}
    height = canonical.number(fields["table_height_m"], "table_height_m")
    try:
        return Trajectory(np.array(times), _track(fields["hand"], "hand"), tracks), Scene(height)
    except InvalidTrajectory as error:
        names = {"times": "t", "table_height": "table_height_m"}
        raise ArtifactInvalid(names.get(error.field, error.field), str(error)) from error


def _dump(format_: tuple[str, int], fields: dict[str, Any]) -> bytes:
    name, version = format_
    return canonical.write({"format": name, "format_version": version, **fields})


def _rows(track: Floats) -> list[list[float] | None]:
    return [None if np.isnan(position[0]) else position.tolist() for position in track]


def _track(rows: Any, place: str) -> Floats:
    track = np.full((len(_list(rows, place)), 3), np.nan)
    for at, row in enumerate(rows):
        if row is None:
            continue
        if len(_list(row, f"{place}[{at}]")) != 3:
            raise ArtifactInvalid(f"{place}[{at}]", "must be three coordinates")
        track[at] = [canonical.number(value, f"{place}[{at}]") for value in row]
    return track


def _list(value: Any, place: str) -> list[Any]:
    if not isinstance(value, list):
        raise ArtifactInvalid(place, "must be a list")
    return value


def _check(model: Model) -> None:
    """Raise ArtifactInvalid unless the parts of a model fit together."""
    features = model.features
    if not 0 < features.rate <= MAX_RATE:
        raise ArtifactInvalid("features.rate", f"must be positive and at most {MAX_RATE:g} Hz")
    if not 0 < features.still < np.inf:
        raise ArtifactInvalid("features.still", "must be positive and finite")
    if len(set(features.objects)) < len(features.objects):
        raise ArtifactInvalid("features.objects", "must differ")
    if not model.actions:
        raise ArtifactInvalid("actions", "must not be empty")
    if len(set(model.names)) < len(model.names):
        raise ArtifactInvalid("actions", "must be of different classes")
    for at, action in enumerate(model.actions):
        _check_action(action, features, f"actions[{at}]")
    for name in ("typical", "least"):
        _check_shape(getattr(model.familiarity, name), (len(model.actions),), f"familiarity.{name}")
    if not (np.isfinite(model.rest.pace) and 0 < model.rest.spread < np.inf):
        raise ArtifactInvalid("rest", "must be a finite pace, and a spread that is positive and finite")
    _check_shape(model.background.width, (features.n_features,), "background.width")
    if (model.background.width <= 0).any():
        raise ArtifactInvalid("background.width", "must be positive")


def _check_action(action: ActionModel, features: FeatureSpecification, place: str) -> None:
    sizes = {
        "states": max(1, np.shape(action.means)[0] if np.ndim(action.means) else 0),
        "features": features.n_features,
        "demonstrations": max(1, np.size(action.durations)),
        "space": 3,
        "shape": N_SHAPE,
    }
    for name, axes in AXES.items():
        _check_shape(getattr(action, name), tuple(sizes[axis] for axis in axes), f"{place}.{name}")
    if (action.durations > MAX_DURATION).any():
        raise ArtifactInvalid(f"{place}.durations", f"must be at most {MAX_DURATION:g} s")
    for name in POSITIVE:
        if (getattr(action, name) <= 0).any():
            raise ArtifactInvalid(f"{place}.{name}", "must be positive")
    for name in PLACES:
        if (np.abs(getattr(action, name)) > MAX_DISTANCE).any():
            raise ArtifactInvalid(f"{place}.{name}", f"must be at most {MAX_DISTANCE:g} m")
    if (action.lengths <= 0).any():
        raise ArtifactInvalid(f"{place}.ways", "must not be zero")
    for name in NOT_NEGATIVE:
        if (getattr(action, name) < 0).any():
            raise ArtifactInvalid(f"{place}.{name}", "must not be negative")
    for name in PROBABILITIES:
        if (getattr(action, name) > 1).any():
            raise ArtifactInvalid(f"{place}.{name}", "must not be above 1")
    if action.repetition < 1:
        raise ArtifactInvalid(f"{place}.repetition", "must not be below 1")


def _check_shape(array: Floats, wanted: tuple[int, ...], place: str) -> None:
    if np.shape(array) != wanted:
        raise ArtifactInvalid(place, f"must have shape {wanted}, has {np.shape(array)}")
    if not np.isfinite(array).all():
        raise ArtifactInvalid(place, "must be finite")
