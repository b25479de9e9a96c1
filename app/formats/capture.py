"""A recording as its file gives it: named tracks in metres, right-handed, Z up, on one row of times.

The length unit and the up axis come from the file where its format fixes or states them; else the caller
declares them. Nothing is guessed: what neither says is refused by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from app.formats.errors import UndeclaredGeometry, Unreadable

if TYPE_CHECKING:  # a reader's process has no need of the compiler behind these
    from app.motion.trajectory import Floats, Indices

LengthUnit = Literal["m", "cm", "mm"]
UpAxis = Literal["z", "y"]

UNITS_PER_METRE: dict[LengthUnit, float] = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
UNIT_NAMES: dict[str, LengthUnit] = {
    "m": "m",
    "meter": "m",
    "meters": "m",
    "metre": "m",
    "metres": "m",
    "cm": "cm",
    "centimeters": "cm",
    "centimetres": "cm",
    "mm": "mm",
    "millimeters": "mm",
    "millimetres": "mm",
}
"""How files call the units."""

TOLERANCE = 0.1
"""Of a period: times that differ by less are the same, written with few digits."""


@dataclass(frozen=True)
class Declared:
    """What the caller says of a file; None: let the file say it."""

    length_unit: LengthUnit | None = None
    up_axis: UpAxis | None = None


@dataclass(frozen=True)
class Geometry:
    """What numbers mean, and their way to metres, right-handed, Z up (REP-103)."""

    length_unit: LengthUnit = "m"
    up_axis: UpAxis = "z"

    def to_metres(self, positions: Floats) -> Floats:
        """Return positions (…, 3) in metres, Z up; y-up (x, y, z) becomes (x, -z, y). Dropouts stay NaN."""
        metres = positions / UNITS_PER_METRE[self.length_unit]
        if self.up_axis == "y":
            metres = np.stack([metres[..., 0], 0.0 - metres[..., 2], metres[..., 1]], axis=-1)
        return metres


def resolve(
    title: str, declared: Declared, length_unit: LengthUnit | None = None, up_axis: UpAxis | None = None
) -> Geometry:
    """Return what holds for a file of the format ``title`` that says this of itself, or None.

    Raises UndeclaredGeometry.
    """
    unit = length_unit or declared.length_unit
    up = up_axis or declared.up_axis
    for name, said, told in (
        ("length_unit", length_unit, declared.length_unit),
        ("up_axis", up_axis, declared.up_axis),
    ):
        if said and told and said != told:
            detail = f"{name} is declared as {told!r}, but this {title} file says {said!r}: declare none"
            raise UndeclaredGeometry(name, detail)
    if unit is None:
        detail = f"this {title} file does not say its length unit: declare length_unit 'm', 'cm' or 'mm'"
        raise UndeclaredGeometry("length_unit", detail)
    if up is None:
        detail = f"this {title} file does not say which axis is up: declare up_axis 'z' or 'y'"
        raise UndeclaredGeometry("up_axis", detail)
    return Geometry(unit, up)


def unit_of(name: str, place: str) -> LengthUnit:
    """Return the unit that a file calls ``name``. Raises Unreadable."""
    unit = UNIT_NAMES.get(name.strip().casefold())
    if unit is None:
        raise Unreadable(place, f"the length unit {name!r} is none of m, cm and mm")
    return unit


@dataclass(frozen=True)
class Label:
    """An action from start_s to end_s [s], on the recording's times; end_s names the goal frame."""

    action: str
    start_s: float
    end_s: float


@dataclass(frozen=True, eq=False)
class Capture:
    """A recording of n frames.

    format: name of the file's format; times: (n,) strictly increasing [s]; frames: (n,) the numbers by which
    the file calls its frames, else from 0; tracks: name -> (n, 3) [m], right-handed, Z up, a frame NaN where
    the track is missing; rate: as the file says [Hz]; notes: what was noticed on the way; systems: track ->
    the coordinate system that it is in, where the format knows of several.
    Raises Unreadable.
    """

    format: str
    times: Floats
    frames: Indices
    tracks: Mapping[str, Floats]
    rate: float | None = None
    labels: tuple[Label, ...] = ()
    notes: tuple[str, ...] = ()
    systems: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        times = np.array(self.times, dtype=np.float64)
        frames = np.array(self.frames, dtype=np.int64)
        if not len(times):
            raise Unreadable("", "has no frames")
        if not self.tracks:
            raise Unreadable("", "has no positions")
        if len(bad := np.flatnonzero(~np.isfinite(times))):
            raise Unreadable(f"frame {frames[bad[0]]}", "has no time")
        if len(bad := np.flatnonzero(times[1:] <= times[:-1])):
            raise Unreadable(f"frame {frames[bad[0] + 1]}", "is not later than the frame before it")
        tracks = {name: _positions(name, track, frames) for name, track in self.tracks.items()}
        for array in (times, frames, *tracks.values()):
            array.setflags(write=False)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "frames", frames)
        object.__setattr__(self, "tracks", tracks)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def period(self) -> float:
        """From a frame to the next, as a rule [s]; 0 where there is one frame."""
        return float(np.median(np.diff(self.times))) if len(self) > 1 else 0.0


def timeline(frames: Indices, rate: float | None, column: Floats | None, first: int) -> Floats:
    """Return the times of frames [s] by their numbers, their rate [Hz] and a column of rounded times [s].

    frames: (n,); first: the number of the frame at time 0; column: (n,), it counts where it disagrees.
    Raises Unreadable.
    """
    if rate is None and column is None:
        raise Unreadable("", "has neither times nor a frame rate")
    if rate is None or not np.isfinite(rate) or rate <= 0:
        if column is None:
            raise Unreadable("", f"the frame rate {rate} is no positive number of Hz")
        return column
    counted = (frames - first) / rate
    if column is None:
        return counted
    offset = 0.0 if abs(column[0] - counted[0]) < TOLERANCE / rate else column[0] - counted[0]
    agrees = np.abs(counted + offset - column) < TOLERANCE / rate
    return counted + offset if agrees.all() else column


def said_and_found(what: str, said: float | None, found: int) -> tuple[str, ...]:
    """Return a note where a header's number of something differs from what the file has."""
    return () if said is None or said == found else (f"header says {said:g} {what}, file has {found}",)


def distinct(names: list[str]) -> list[str]:
    """Return the names, those that are there already with a number; the nameless are called ``*n``."""
    seen: set[str] = set()
    for index, name in enumerate(names):
        fresh = base = name.strip() or f"*{index + 1}"
        count = 1
        while fresh in seen:
            count += 1
            fresh = f"{base} ({count})"
        seen.add(fresh)
        names[index] = fresh
    return names


def _positions(name: str, track: Floats, frames: Indices) -> Floats:
    positions = np.array(track, dtype=np.float64, order="C")
    if positions.shape != (len(frames), 3):
        raise Unreadable(name, f"has shape {positions.shape}, needs ({len(frames)}, 3)")
    if len(bad := np.flatnonzero(np.isinf(positions).any(axis=1))):
        raise Unreadable(f"{name}, frame {frames[bad[0]]}", "is infinite")
    positions[np.isnan(positions).any(axis=1)] = np.nan
    return positions
