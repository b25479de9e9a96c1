"""What a format needs of a movement; ``app.motion.generation.GeneratedMotion`` is one."""

from __future__ import annotations

from typing import Protocol

from app.motion.trajectory import Floats


class Motion(Protocol):
    """A movement of n frames."""

    @property
    def times(self) -> Floats:
        """(n,) [s], strictly increasing from 0, by a nanosecond or more."""

    @property
    def positions(self) -> Floats:
        """(n, 3) [m]."""

    @property
    def velocities(self) -> Floats:
        """(n, 3) [m/s]."""

    @property
    def accelerations(self) -> Floats:
        """(n, 3) [m/s^2]."""

    @property
    def std(self) -> Floats:
        """(n, 3) standard deviation of the demonstrated movements along the world's axes [m]."""
