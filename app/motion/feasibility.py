"""What stands against a generated movement: what it violates, and what is to be known about it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.motion.asked import Workspace
from app.motion.model import ActionModel
from app.motion.trajectory import Floats

CLEARANCE = 1e-6
"""Nearer than this to a bound is not beyond it [m]."""

FAR_LENGTH, FAR_RISE = 1.5, 0.5
"""A movement is far from all demonstrated ones if its length is by this factor outside theirs, or the angle
at which it rises by so much [rad]; a start or goal, if it is further outside theirs than they are long."""


MISSED = 3.0
"""A point is missed if the movement passes it at over so many of the standard deviations asked for."""


@dataclass(frozen=True)
class Violation:
    """Where a movement is beyond a bound the most: what kind of bound, when [s], its value and the limit."""

    kind: str
    time: float
    value: float
    limit: float


@dataclass(frozen=True)
class Notice:
    """What is to be known about a movement: a stable code, and in words."""

    code: str
    detail: str


def leaves(workspace: Workspace, times: Floats, positions: Floats) -> Iterator[Violation]:
    """Yield where a movement, (n,) [s] and (n, 3) [m], is furthest outside each side of a workspace."""
    least, most = np.asarray(workspace.least), np.asarray(workspace.most)
    for axis, name in enumerate("xyz"):
        for side, sign, limit in (("min", -1.0, least[axis]), ("max", 1.0, most[axis])):
            yield from _beyond(f"workspace_{side}_{name}", times, positions[:, axis], limit, sign)


def sinks(table_height: float, times: Floats, positions: Floats) -> Iterator[Violation]:
    """Yield where a movement is furthest below the table, at a height [m]."""
    yield from _beyond("table", times, positions[:, 2], table_height, -1.0)


def rests(times: Floats, velocities: Floats) -> Iterator[Violation]:
    """Yield each end at which a movement, its velocities (n, 3) [m/s], does not rest."""
    for name, at in (("start", 0), ("goal", -1)):
        if (speed := float(np.linalg.norm(velocities[at]))) > 0.0:
            yield Violation(f"moves_at_{name}", float(times[at]), speed, 0.0)


def passes(times: Floats, positions: Floats, points: Floats, stds: Floats) -> Iterator[Violation]:
    """Yield the points (m, 3) that a movement misses by over MISSED times their std (m,) [m].

    times: (m,) when it should pass them [s]; positions: (m, 3) where it is then [m].
    """
    distances = np.linalg.norm(positions - points, axis=1)
    for time, distance, most in zip(times, distances, MISSED * stds, strict=True):
        if distance > most + CLEARANCE:
            yield Violation("via", float(time), float(distance), float(most))


def _beyond(kind: str, times: Floats, values: Floats, limit: float, sign: float) -> Iterator[Violation]:
    at = int(np.argmax(sign * values))
    if sign * (values[at] - limit) > CLEARANCE:
        yield Violation(kind, float(times[at]), float(values[at]), float(limit))


def stays_above(action: ActionModel) -> bool:
    """Return whether the demonstrations keep above the height that was said to be the table's."""
    heights = action.means[:, 3]
    return bool(heights.min() >= 0.0)


def remoteness(action: ActionModel, start: Floats, way: Floats) -> Iterator[Notice]:
    """Yield how a movement from a start along a way, (3,) [m], is far from everything demonstrated."""
    lengths = action.lengths
    ends = (("start", action.starts, start), ("goal", action.starts + action.ways, start + way))
    for name, shown, point in ends:
        nearest = np.clip(point, shown.min(axis=0), shown.max(axis=0))
        if (outside := float(np.linalg.norm(point - nearest))) > lengths.mean():
            yield Notice(f"{name}_far", f"the {name} lies {outside:.2g} m from all that were demonstrated")
    length, ways = float(np.linalg.norm(way)), np.vstack([action.ways, way])
    for factor, than in ((length / lengths.max(), "longest"), (lengths.min() / length, "shortest")):
        if factor > FAR_LENGTH:
            of = lengths.max() if than == "longest" else lengths.min()
            detail = f"{length:.2g} m are {factor:.2g} times beyond the {than} demonstrated, {of:.2g} m"
            yield Notice("length_far", detail)
    *rises, rise = np.arctan2(ways[:, 2], np.hypot(ways[:, 0], ways[:, 1]))
    if (steeper := max(rise - max(rises), min(rises) - rise)) > FAR_RISE:
        detail = (
            f"it rises at {np.degrees(rise):.0f} degrees, {np.degrees(steeper):.0f} beyond all demonstrated"
        )
        yield Notice("rise_far", detail)
