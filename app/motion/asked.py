"""What a generation can be asked for, beside its end points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from app.motion.errors import InvalidRequest

Method = Literal["default", "paper"]

MAX_VIA = 20
MAX_STEPS = 100
"""Points of a movement, and steps of a task, at most."""


@dataclass(frozen=True, eq=False)
class Via:
    """A point (3,) to pass near [m], at a fraction of the duration, with a standard deviation [m]."""

    position: ArrayLike
    fraction: float
    std: float


@dataclass(frozen=True, eq=False)
class Step:
    """One action of a task, to a goal (3,) [m]; duration [s] and via as in ``generate``."""

    action: str
    goal: ArrayLike
    duration: float | None = None
    via: Sequence[Via] = ()


@dataclass(frozen=True)
class Limits:
    """What a robot can do: the highest speed [m/s] and acceleration [m/s^2], None where any will do."""

    velocity: float | None = None
    acceleration: float | None = None

    def __post_init__(self) -> None:
        """Raise InvalidRequest for a limit that is not positive."""
        for name in ("velocity", "acceleration"):
            limit = getattr(self, name)
            if limit is not None and not 0.0 < limit < math.inf:
                raise InvalidRequest(f"limits.{name}", f"must be positive and finite, is {limit:g}")


ANY = Limits()


@dataclass(frozen=True, eq=False)
class Workspace:
    """The box that a hand must stay in; least, most: (3,) corners [m], the first below the second."""

    least: ArrayLike
    most: ArrayLike

    def __post_init__(self) -> None:
        """Raise InvalidRequest where a corner is not below the other."""
        if not np.less(self.least, self.most).all():
            raise InvalidRequest("workspace", "its min must be below its max along each axis")
