"""Artifacts: models and demonstrations as canonical JSON, and back with everything checked.

A model's object has the fields of ``Model``, arrays as nested lists; a demonstration's has those of the
wire's trajectory, in metres with Z up. Both say their ``format`` and ``format_version``; what they hold
reads back bit for bit.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from app.motion.errors import InvalidTrajectory
from app.motion.model import ActionModel, FeatureSpecification, Model
from app.motion.trajectory import Demonstration, Floats, Scene, Trajectory
from app.registry import canonical
from app.registry.errors import ArtifactInvalid

MODEL = "gesta-model", 1
DEMONSTRATION = "gesta-demonstration", 1

Axis = Literal["states", "features", "demonstrations"]

AXES: dict[str, tuple[Axis, ...]] = {
    "means": ("states", "features"),
    "variances": ("states", "features"),
    "stay": ("states",),
    "weights": ("states",),
    "durations": ("demonstrations",),
}
"""The axes of an action model's arrays."""

POSITIVE = ("variances", "durations")
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
    trajectory = demonstration.trajectory
    fields = {
        "action": demonstration.action,
        "table_height_m": demonstration.scene.table_height,
        "t": trajectory.times.tolist(),
        "hand": _rows(trajectory.hand),
        "objects": {name: _rows(track) for name, track in trajectory.objects.items()},
    }
    return _dump(DEMONSTRATION, fields)


def load_demonstration(data: bytes) -> Demonstration:
    """Return the demonstration in an artifact. Raises ArtifactInvalid, naming the field."""
    fields = canonical.read(data, *DEMONSTRATION)
    canonical.check_keys(fields, {"action", "table_height_m", "t", "hand", "objects"}, "")
    objects = fields["objects"]
    if not isinstance(objects, dict):
        raise ArtifactInvalid("objects", "must be an object")
    times = [canonical.number(time, f"t[{at}]") for at, time in enumerate(_list(fields["t"], "t"))]
    tracks = {name: _track(rows, f"objects.{name}") for name, rows in objects.items()}
    try:
        trajectory = Trajectory(np.array(times), _track(fields["hand"], "hand"), tracks)
    except InvalidTrajectory as error:
        raise ArtifactInvalid("t" if error.field == "times" else error.field, str(error)) from error
    action = canonical.string(fields["action"], "action")
    return Demonstration(
        action, trajectory, Scene(canonical.number(fields["table_height_m"], "table_height_m"))
    )


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
    if features.rate <= 0:
        raise ArtifactInvalid("features.rate", "must be positive")
    if len(set(features.objects)) < len(features.objects):
        raise ArtifactInvalid("features.objects", "must differ")
    if not model.actions:
        raise ArtifactInvalid("actions", "must not be empty")
    if len(set(model.names)) < len(model.names):
        raise ArtifactInvalid("actions", "must be of different classes")
    for at, action in enumerate(model.actions):
        _check_action(action, features, f"actions[{at}]")
    for name in ("location", "scale"):
        _check_shape(getattr(model.background, name), (features.n_features,), f"background.{name}")
    if (model.background.scale <= 0).any():
        raise ArtifactInvalid("background.scale", "must be positive")


def _check_action(action: ActionModel, features: FeatureSpecification, place: str) -> None:
    sizes = {
        "states": max(1, np.shape(action.means)[0] if np.ndim(action.means) else 0),
        "features": features.n_features,
        "demonstrations": max(1, np.size(action.durations)),
    }
    for name, axes in AXES.items():
        _check_shape(getattr(action, name), tuple(sizes[axis] for axis in axes), f"{place}.{name}")
    for name in POSITIVE:
        if (getattr(action, name) <= 0).any():
            raise ArtifactInvalid(f"{place}.{name}", "must be positive")
    for name in NOT_NEGATIVE:
        if (getattr(action, name) < 0).any():
            raise ArtifactInvalid(f"{place}.{name}", "must not be negative")
    for name in PROBABILITIES:
        if (getattr(action, name) > 1).any():
            raise ArtifactInvalid(f"{place}.{name}", "must not be above 1")


def _check_shape(array: Floats, wanted: tuple[int, ...], place: str) -> None:
    if np.shape(array) != wanted:
        raise ArtifactInvalid(place, f"must have shape {wanted}, has {np.shape(array)}")
    if not np.isfinite(array).all():
        raise ArtifactInvalid(place, "must be finite")
