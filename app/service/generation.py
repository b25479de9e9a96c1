"""Generation: a trajectory of a learned action between the end points asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.motion.generation import GeneratedMotion, Method, generate
from app.registry.records import VersionRecord
from app.service.lab import Lab


@dataclass(frozen=True)
class Generated:
    """A movement and the version that made it."""

    version: VersionRecord
    motion: GeneratedMotion


def generate_trajectory(
    lab: Lab,
    model: str,
    ref: str,
    action: str,
    *,
    start: Sequence[float],
    goal: Sequence[float],
    rate_hz: float,
    duration_s: float | None,
    method: Method,
) -> Generated:
    """Return a movement from start to goal [m]. Raises NotFound, UnknownAction, InvalidRequest."""
    version = lab.version(model, ref)
    motion = generate(version.model, action, start, goal, rate=rate_hz, duration=duration_s, method=method)
    return Generated(version.record, motion)
