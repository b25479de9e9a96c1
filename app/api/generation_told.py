"""What is told of a generated movement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

from pydantic import Field

from app.api.schemas import Answer
from app.motion.asked import Step
from app.service.generation import Generated


class ViolationTold(Answer):
    """Where the movement is furthest beyond a bound."""

    kind: str = Field(
        description="`workspace_min_x` … `workspace_max_z`, `table`, `via`, `moves_at_start` or `_goal`."
    )
    t: float = Field(description="When [s].")
    value: float = Field(description="What it is there [m], [m/s].")
    limit: float = Field(description="What it may be.")


class WarningTold(Answer):
    """What is to be known about the movement."""

    code: str = Field(
        description="`start_far`, `goal_far`, `length_far`, `rise_far`: unlike everything demonstrated. "
        "`mean_shape`: the shape is the mean of the demonstrations. `slowed`: by the limits."
    )
    detail: str


class Feasibility(Answer):
    """Whether a robot can run it as asked: limits always hold, everything else is named."""

    feasible: bool = Field(description="Nothing is violated.")
    duration_s: float
    violations: list[ViolationTold]
    warnings: list[WarningTold]


class Told(Answer):
    """A movement at a constant rate; it meets its end points exactly and, by the default method, at rest."""

    t: list[float] = Field(description="From 0 [s].")
    position: list[list[float]] = Field(description="[m]")
    velocity: list[list[float]] = Field(description="[m/s]")
    acceleration: list[list[float]] = Field(description="[m/s^2]")
    std: list[list[float]] = Field(description="Of demonstrated movements, along each axis [m].")
    model: str
    version: int
    frame_id: str | None
    feasibility: Feasibility

    @classmethod
    def of(cls, generated: Generated, frame_id: str | None, **further: Any) -> Self:
        """Return what is told of a generated movement."""
        motion, version = generated.motion, generated.version
        violations = [
            ViolationTold(kind=each.kind, t=each.time, value=each.value, limit=each.limit)
            for each in generated.violations
        ]
        return cls(
            t=motion.times.tolist(),
            position=motion.positions.tolist(),
            velocity=motion.velocities.tolist(),
            acceleration=motion.accelerations.tolist(),
            std=motion.std.tolist(),
            model=version.model,
            version=version.number,
            frame_id=frame_id,
            feasibility=Feasibility(
                feasible=not violations,
                duration_s=float(motion.times[-1]),
                violations=violations,
                warnings=[WarningTold(code=each.code, detail=each.detail) for each in motion.notices],
            ),
            **further,
        )


class GeneratedTold(Told):
    """A movement of one action."""

    action: str


class StepTold(Answer):
    """A part of a task, from one rest to the next."""

    action: str
    goal: list[float]
    t_start: float
    t_end: float

    @classmethod
    def all_of(cls, steps: Sequence[Step], ends: Sequence[float]) -> list[Self]:
        """Return what is told of steps that end at these times [s]."""
        return [
            cls(action=step.action, goal=step.goal, t_start=begin, t_end=end)
            for step, begin, end in zip(steps, (0.0, *ends), ends, strict=False)
        ]


class TaskTold(Told):
    """One continuous movement through all steps."""

    steps: list[StepTold]
