"""Generation: a trajectory of a learned action, or of several, between the end points asked for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from app.motion.asked import Limits, Method, Step, Workspace
from app.motion.feasibility import Violation, leaves, sinks, stays_above
from app.motion.generation import GeneratedMotion, generate, generate_task
from app.registry import models
from app.registry.records import VersionRecord
from app.service.lab import Lab, Version


@dataclass(frozen=True)
class Manner:
    """How a trajectory shall be, whatever its end points are: at a rate [Hz], within limits and a box."""

    rate: float
    method: Method
    limits: Limits
    workspace: Workspace | None


@dataclass(frozen=True)
class Generated:
    """A movement, the version that made it, what it violates, and when its steps end [s]."""

    version: VersionRecord
    motion: GeneratedMotion
    violations: tuple[Violation, ...]
    ends: tuple[float, ...]


def generate_trajectory(
    lab: Lab, model: str, ref: str, start: Sequence[float], step: Step, manner: Manner
) -> Generated:
    """Return a movement from start to the step's goal [m]. Raises NotFound, UnknownAction, InvalidRequest."""
    version = lab.version(model, ref)
    motion = generate(
        version.model,
        step.action,
        start,
        step.goal,
        rate=manner.rate,
        duration=step.duration,
        method=manner.method,
        via=step.via,
        limits=manner.limits,
    )
    end = float(motion.times[-1])
    return _told(lab, version, motion, (step,), (end,), manner)


def generate_trajectory_of_task(
    lab: Lab, model: str, ref: str, start: Sequence[float], steps: Sequence[Step], manner: Manner
) -> Generated:
    """Return one movement through the goals of all steps. Raises NotFound, UnknownAction, InvalidRequest."""
    version = lab.version(model, ref)
    motion, ends = generate_task(
        version.model, start, steps, rate=manner.rate, method=manner.method, limits=manner.limits
    )
    return _told(lab, version, motion, steps, tuple(ends.tolist()), manner)


def _told(
    lab: Lab,
    version: Version,
    motion: GeneratedMotion,
    steps: Sequence[Step],
    ends: tuple[float, ...],
    manner: Manner,
) -> Generated:
    found = _violations(lab, version, motion, {step.action for step in steps}, manner.workspace)
    return Generated(version.record, motion, (*motion.violations, *found), ends)


def _violations(
    lab: Lab, version: Version, motion: GeneratedMotion, actions: Iterable[str], workspace: Workspace | None
) -> Iterator[Violation]:
    """Yield where a movement leaves the workspace or goes under the table.

    A table that the demonstrations of one of the actions go below is not one everywhere.
    """
    if workspace is not None:
        yield from leaves(workspace, motion.times, motion.positions)
    if all(stays_above(version.model.action(action)) for action in actions):
        with lab.database.reading() as tx:
            height = models.get(tx, version.record.model).table_height_m
        yield from sinks(height, motion.times, motion.positions)
