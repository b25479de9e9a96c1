"""What the numbers of an upload or a stream mean, and their way to metres, right-handed, Z up (REP-103)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.motion.trajectory import Floats

LengthUnit = Literal["m", "cm", "mm"]
UpAxis = Literal["z", "y"]

Goals = Mapping[str, tuple[float, ...]]
"""Named places, each three coordinates."""

UNITS_PER_METRE: dict[LengthUnit, float] = {"m": 1.0, "cm": 100.0, "mm": 1000.0}


@dataclass(frozen=True)
class Geometry:
    """Declared by whoever sends positions; nothing is guessed."""

    length_unit: LengthUnit = "m"
    up_axis: UpAxis = "z"


def to_metres(positions: Floats, geometry: Geometry) -> Floats:
    """Return positions in metres, Z up; y-up (x, y, z) becomes (x, -z, y). Dropouts stay NaN.

    positions: (n, 3) in the declared unit.
    """
    metres = positions / UNITS_PER_METRE[geometry.length_unit]
    if geometry.up_axis == "y":
        metres = np.column_stack([metres[:, 0], 0.0 - metres[:, 2], metres[:, 1]])
    return metres
