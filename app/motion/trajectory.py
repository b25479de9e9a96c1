"""Value types of motion: trajectory, scene, segment, demonstration, recording.

Arrays are float64, C-contiguous and read-only. A dropout is a frame whose position is NaN in all three
coordinates; it is data, and nothing fills it in.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from app.motion.errors import InvalidSegment, InvalidTrajectory

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

FARTHEST_M = 100.0
"""A position farther out than this is in a wrong unit [m]."""

_TOO_FAR = f"lies over {FARTHEST_M:g} m away: a wrong length unit?"


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Timed positions of one hand and of named objects.

    times: (n_frames,) strictly increasing [s]; hand: (n_frames, 3) [m]; objects: name -> (n_frames, 3) [m].
    Raises InvalidTrajectory, which names the field and the frame.
    """

    times: Floats
    hand: Floats
    objects: Mapping[str, Floats] = field(default_factory=dict)

    def __post_init__(self) -> None:
        times = _floats("times", self.times)
        if times.ndim != 1 or len(times) == 0:
            raise InvalidTrajectory("times", None, f"needs one time per frame, has shape {times.shape}")
        if len(bad := np.flatnonzero(~np.isfinite(times))):
            raise InvalidTrajectory("times", int(bad[0]), "is not a finite number of seconds", "non_finite")
        if len(bad := np.flatnonzero(times[1:] <= times[:-1])):
            raise InvalidTrajectory(
                "times", int(bad[0]) + 1, "must be later than the frame before it", "times_not_increasing"
            )
        objects = {
            name: _positions(f"objects.{name}", track, len(times)) for name, track in self.objects.items()
        }
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "hand", _positions("hand", self.hand, len(times)))
        object.__setattr__(self, "objects", objects)

    def __len__(self) -> int:
        return len(self.times)

    def part(self, start: int, stop: int) -> Trajectory:
        """Return frames ``start..stop-1`` as a trajectory of their own."""
        objects = {name: track[start:stop] for name, track in self.objects.items()}
        return Trajectory(self.times[start:stop], self.hand[start:stop], objects)


@dataclass(frozen=True)
class Scene:
    """What stands still: the height of the table top, table_height [m].

    Raises InvalidTrajectory.
    """

    table_height: float = 0.0

    def __post_init__(self) -> None:
        if not np.isfinite(self.table_height):
            raise InvalidTrajectory("table_height", None, "is not a finite number of metres")
        if abs(self.table_height) > FARTHEST_M:
            raise InvalidTrajectory("table_height", None, _TOO_FAR)


@dataclass(frozen=True)
class Segment:
    """Frames ``[start, end)``; frame ``end`` is the goal. ``action`` None: unknown."""

    start: int
    end: int
    action: str | None = None


@dataclass(frozen=True, eq=False)
class Demonstration:
    """A trajectory of exactly one action; its last frame is the goal."""

    action: str
    trajectory: Trajectory
    scene: Scene = Scene()


@dataclass(frozen=True, eq=False)
class Recording:
    """A long trajectory with its labelled segments, in order and free of overlap.

    Raises InvalidSegment.
    """

    trajectory: Trajectory
    segments: tuple[Segment, ...] = ()
    scene: Scene = Scene()

    def __post_init__(self) -> None:
        free_from, n_frames = 0, len(self.trajectory)
        for index, segment in enumerate(self.segments):
            if not free_from <= segment.start < segment.end <= n_frames:
                raise InvalidSegment(
                    index,
                    f"[{segment.start}, {segment.end}) must start before its end, lie within the "
                    f"{n_frames} frames and not overlap the segment before it",
                )
            free_from = segment.end

    def demonstrations(self) -> tuple[Demonstration, ...]:
        """Return one demonstration per labelled segment, its goal frame included."""
        return tuple(
            Demonstration(segment.action, self.trajectory.part(segment.start, segment.end + 1), self.scene)
            for segment in self.segments
            if segment.action is not None
        )


@njit(cache=True, nogil=True)
def is_sound(rows: Floats, after: float) -> bool:
    """Return whether frames can follow one of time ``after`` [s] as a ``Trajectory`` would have them.

    rows: (n_frames, 1 + 3 n_tracks) times [s] and positions [m].
    """
    for frame in range(len(rows)):
        if not after < rows[frame, 0] < np.inf:
            return False
        after = rows[frame, 0]
        for track in range(1, rows.shape[1], 3):
            n_missing = 0
            for axis in range(3):
                n_missing += np.isnan(rows[frame, track + axis])
                if abs(rows[frame, track + axis]) > FARTHEST_M:
                    return False
            if n_missing not in (0, 3):
                return False
    return True


def _floats(name: str, values: ArrayLike) -> Floats:
    try:
        given: NDArray[Any] = np.asarray(values)
        if given.dtype.kind not in "biufO":
            raise TypeError(f"holds {given.dtype}")
        array = np.array(given, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise InvalidTrajectory(name, None, "must be numbers in a regular array") from error
    array.setflags(write=False)
    return array


def _positions(name: str, values: ArrayLike, n_frames: int) -> Floats:
    positions = _floats(name, values)
    if positions.shape != (n_frames, 3):
        raise InvalidTrajectory(name, None, f"needs shape ({n_frames}, 3), has {positions.shape}")
    missing = np.isnan(positions)
    whole = missing.all(axis=1) | ~missing.any(axis=1)
    if len(bad := np.flatnonzero(~whole | np.isinf(positions).any(axis=1))):
        raise InvalidTrajectory(
            name, int(bad[0]), "needs three finite coordinates, or none for a dropout", "non_finite"
        )
    if len(bad := np.flatnonzero((np.abs(positions) > FARTHEST_M).any(axis=1))):
        raise InvalidTrajectory(name, int(bad[0]), _TOO_FAR, "wrong_unit")
    return positions
