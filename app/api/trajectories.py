"""Generation: trajectories of a learned action between given end points."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from fastapi import APIRouter
from pydantic import ConfigDict, Field, FiniteFloat
from pydantic.config import JsonDict

from app.api.dependencies import LabOf
from app.api.schemas import Answer, Point, Request, refusals
from app.service.generation import Generated, generate_trajectory

router = APIRouter(prefix="/v1/models/{model}/versions/{ref}/actions/{action}", tags=["trajectories"])

EXAMPLE: JsonDict = {"start": [0.0, 0.0, 0.02], "goal": [0.1, 0.35, 0.04], "rate_hz": 100}


class Generation(Request):
    """Where to go from and to."""

    model_config = ConfigDict(json_schema_extra={"examples": [EXAMPLE]})

    start: Annotated[Point, Field(description="[m]")]
    goal: Annotated[Point, Field(description="[m]")]
    rate_hz: FiniteFloat = Field(100.0, description="Frames per second of the answer.")
    duration_s: FiniteFloat | None = Field(
        None, description="Default: the mean of the demonstrations; rounded up to whole periods."
    )
    method: Literal["default", "paper"] = Field(
        "default", description="`paper`: the paper's plain one, which does not rest at its ends."
    )
    frame_id: str | None = Field(None, max_length=200, description="Handed through to the answer.")


class Feasibility(Answer):
    """Whether a robot can run it as asked. No limits can be given yet, so nothing is violated."""

    feasible: bool
    duration_s: float
    violations: list[dict[str, float | str]]
    warnings: list[dict[str, str]]


class GeneratedTold(Answer):
    """A movement at a constant rate; it meets both end points exactly and, by the default method, at rest."""

    t: list[float] = Field(description="From 0 [s].")
    position: list[list[float]] = Field(description="[m]")
    velocity: list[list[float]] = Field(description="[m/s]")
    acceleration: list[list[float]] = Field(description="[m/s^2]")
    std: list[list[float]] = Field(description="Of demonstrated movements, along each axis [m].")
    model: str
    version: int
    action: str
    frame_id: str | None
    feasibility: Feasibility

    @classmethod
    def of(cls, generated: Generated, action: str, frame_id: str | None) -> Self:
        """Return what is told of a generated movement."""
        motion, version = generated.motion, generated.version
        duration = float(motion.times[-1])
        return cls(
            t=motion.times.tolist(),
            position=motion.positions.tolist(),
            velocity=motion.velocities.tolist(),
            acceleration=motion.accelerations.tolist(),
            std=motion.std.tolist(),
            model=version.model,
            version=version.number,
            action=action,
            frame_id=frame_id,
            feasibility=Feasibility(feasible=True, duration_s=duration, violations=[], warnings=[]),
        )


@router.post("/trajectories", summary="Generate a trajectory", responses=refusals(404, 503))
def generate(model: str, ref: str, action: str, body: Generation, lab: LabOf) -> GeneratedTold:
    """The shape is learned, the end points are yours: nobody needs to have demonstrated them."""
    generated = generate_trajectory(
        lab,
        model,
        ref,
        action,
        start=body.start,
        goal=body.goal,
        rate_hz=body.rate_hz,
        duration_s=body.duration_s,
        method=body.method,
    )
    return GeneratedTold.of(generated, action, body.frame_id)
