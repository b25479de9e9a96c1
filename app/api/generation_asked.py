"""What a generation can ask for."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field, FiniteFloat
from pydantic.config import JsonDict

from app.api.schemas import ActionName, Point, Request
from app.motion.asked import MAX_STEPS, MAX_VIA, Limits, Step, Via, Workspace
from app.motion.trajectory import FARTHEST_M
from app.service.exports import WORLD
from app.service.generation import Manner

EXAMPLE: JsonDict = {"start": [0.0, 0.0, 0.02], "goal": [0.1, 0.35, 0.04], "rate_hz": 100}
EXAMPLE_OF_A_TASK: JsonDict = {
    "start": [0.0, 0.0, 0.02],
    "steps": [
        {"action": "grasp", "goal": [0.1, 0.35, 0.04]},
        {"action": "displace", "goal": [0.3, 0.2, 0.04]},
    ],
    "limits": {"velocity_m_s": 0.5, "acceleration_m_s2": 2.0},
}

Positive = Annotated[FiniteFloat, Field(gt=0)]


class ViaSent(Request):
    """A point to pass near."""

    position: Annotated[Point, Field(description="[m]")]
    fraction: FiniteFloat = Field(gt=0, lt=1, description="Of the duration of the movement.")
    std_m: FiniteFloat = Field(gt=0, lt=FARTHEST_M, description="How near: missed at over three of these.")


class LimitsSent(Request):
    """What the robot can do; they win over `duration_s`."""

    velocity_m_s: Positive | None = None
    acceleration_m_s2: Positive | None = None


class WorkspaceSent(Request):
    """The box that the hand should stay in."""

    min: Annotated[Point, Field(description="[m]")]
    max: Annotated[Point, Field(description="[m]")]


class StepSent(Request):
    """One movement."""

    goal: Annotated[Point, Field(description="[m]")]
    duration_s: FiniteFloat | None = Field(
        None,
        description="Default: what the demonstrations took for such a length; rounded up to whole periods.",
    )
    via: list[ViaSent] = Field([], max_length=MAX_VIA)

    def step(self, action: str) -> Step:
        """Return it as the core knows it."""
        via = [Via(each.position, each.fraction, each.std_m) for each in self.via]
        return Step(action, self.goal, self.duration_s, via)


class NamedStepSent(StepSent):
    """One action of a task, from where the one before ended."""

    action: ActionName


class MannerSent(Request):
    """How the trajectory shall be."""

    start: Annotated[Point, Field(description="[m]")]
    rate_hz: FiniteFloat = Field(100.0, description="Frames per second of the answer.")
    method: Literal["default", "paper"] = Field(
        "default", description="`paper`: the paper's plain one, which does not rest at its ends."
    )
    limits: LimitsSent = LimitsSent()
    workspace: WorkspaceSent | None = None
    frame_id: str | None = Field(
        None, max_length=200, description=f"Coordinate frame, handed through; `{WORLD}` in ROS messages."
    )
    orientation: list[FiniteFloat] | None = Field(
        None, min_length=4, max_length=4, description="Of the hand in ROS messages: x, y, z, w, constant."
    )

    def manner(self) -> Manner:
        """Return it as the service knows it."""
        limits = Limits(self.limits.velocity_m_s, self.limits.acceleration_m_s2)
        workspace = None if self.workspace is None else Workspace(self.workspace.min, self.workspace.max)
        return Manner(self.rate_hz, self.method, limits, workspace)


class Generation(StepSent, MannerSent):
    """Where to go from and to, and how."""

    model_config = ConfigDict(json_schema_extra={"examples": [EXAMPLE]})


class TaskSent(MannerSent):
    """Actions that follow each other, each from where the one before ended."""

    model_config = ConfigDict(json_schema_extra={"examples": [EXAMPLE_OF_A_TASK]})

    steps: list[NamedStepSent] = Field(min_length=1, max_length=MAX_STEPS)
