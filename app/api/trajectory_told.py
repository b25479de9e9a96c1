"""A trajectory as answers carry it: metres, Z up, null for a dropout."""

from __future__ import annotations

from typing import Self

from app.api.schemas import Answer
from app.motion.trajectory import Trajectory
from app.service.uploads import as_sent


class TrajectoryTold(Answer):
    """Timed positions in metres, Z up; `null` is a dropout."""

    t: list[float]
    hand: list[list[float] | None]
    objects: dict[str, list[list[float] | None]]

    @classmethod
    def of(cls, trajectory: Trajectory) -> Self:
        """Return what is told of a trajectory."""
        sent = as_sent(trajectory)
        return cls.model_validate({"t": sent.t, "hand": sent.hand, "objects": sent.objects})
