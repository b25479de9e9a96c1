"""Which tracks are the hand and the objects.

``{"hand": "Hand top", "objects": {"object": ["Box back", "Box front"]}}``

Several tracks stand for their mean, which is missing where any of them is: a mean over those that are seen
would jump whenever one comes or goes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from app.formats.capture import Capture
from app.formats.errors import InvalidMapping, UnknownTrack
from app.motion.trajectory import Trajectory

Names = tuple[str, ...]
"""Of one track, or of several that are averaged."""

HAND, OBJECTS = "hand", "objects"


@dataclass(frozen=True)
class TrackMapping:
    """The tracks of the hand, and those of each object by its name."""

    hand: Names
    objects: Mapping[str, Names] = field(default_factory=dict)

    @classmethod
    def of(cls, value: object) -> TrackMapping:
        """Return the mapping that parsed JSON says. Raises InvalidMapping."""
        if not isinstance(value, dict) or not {HAND} <= value.keys() <= {HAND, OBJECTS}:
            raise InvalidMapping("", 'needs the form {"hand": TRACK, "objects": {NAME: TRACK or [TRACK, …]}}')
        objects = value.get(OBJECTS, {})
        if not isinstance(objects, dict):
            raise InvalidMapping(OBJECTS, "needs the form {NAME: TRACK or [TRACK, …]}")
        return cls(
            _names(HAND, value[HAND]),
            {name: _names(f"{OBJECTS}.{name}", tracks) for name, tracks in objects.items()},
        )

    def as_json(self) -> dict[str, Any]:
        """Return what ``of`` reads back."""
        return {HAND: list(self.hand), OBJECTS: {name: list(names) for name, names in self.objects.items()}}

    def fields(self) -> Iterator[tuple[str, Names]]:
        """Yield each place in the JSON and its tracks."""
        yield HAND, self.hand
        for name, names in self.objects.items():
            yield f"{OBJECTS}.{name}", names


def trajectory(capture: Capture, mapping: TrackMapping) -> Trajectory:
    """Return the hand and the objects of a recording.

    Raises UnknownTrack, InvalidMapping, and InvalidTrajectory where a position is too far to be in metres.
    """
    systems: dict[str, str] = {}
    for place, names in mapping.fields():
        for name in names:
            if name not in capture.tracks:
                raise UnknownTrack.named(place, name, capture.tracks)
            systems.setdefault(capture.systems.get(name, ""), name)
    if len(systems) > 1:
        told = ", ".join(f"{name!r} in {system!r}" for system, name in systems.items())
        raise InvalidMapping("", f"tracks are in different coordinate systems: {told}")

    def mean(names: Names) -> Any:
        return np.mean([capture.tracks[name] for name in names], axis=0)

    objects = {name: mean(names) for name, names in mapping.objects.items()}
    return Trajectory(capture.times, mean(mapping.hand), objects)


def _names(place: str, value: object) -> Names:
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise InvalidMapping(place, "needs the name of a track, or a list of such names")
    if len(set(names)) < len(names):
        raise InvalidMapping(place, "names a track twice")
    return tuple(names)
