"""What the numbers of an upload or a stream mean: as those of a file."""

from __future__ import annotations

from collections.abc import Mapping

from app.formats.capture import UNITS_PER_METRE, Geometry, LengthUnit, UpAxis

__all__ = ["UNITS_PER_METRE", "Geometry", "Goals", "LengthUnit", "UpAxis"]

Goals = Mapping[str, tuple[float, ...]]
"""Named places, each three coordinates."""
