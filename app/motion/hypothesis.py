"""What a stream is in the middle of: provisional, before anything is decided."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from app.motion.decoding import Alternative
from app.motion.foresight import PHASES
from app.motion.trajectory import Floats

REST = "rest"
"""What a hand that does nothing is called among the actions of a hypothesis."""

GOAL_FLOOR = 0.05
"""Hands end within so much of what they go for [m]."""


@dataclass(frozen=True)
class Expected:
    """An action that may be under way: None for one of no class, ``rest`` for none.

    posterior: all of a hypothesis sum to 1; progress: share of its time gone by, None where it has none.
    """

    action: str | None
    posterior: float
    progress: float | None


@dataclass(frozen=True)
class Hypothesis:
    """What may be under way; provisional.

    start: frame where it has most likely begun; through: newest frame; actions: the likely first; goals:
    posterior of each candidate, summing to 1, empty without candidates.
    """

    start: int
    through: int
    actions: tuple[Expected, ...]
    goals: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Belief:
    """What all alternatives together say.

    classes: (n_classes,), unknown, rest: posteriors that sum to 1; progress: (n_classes,) 0..1; weights: (n,)
    of the (n, 3) goals [m] that movements under way may have, their spreads (n,) [m].
    """

    classes: Floats
    unknown: float
    rest: float
    progress: Floats
    weights: Floats
    goals: Floats
    spreads: Floats


def believe(alternatives: Sequence[Alternative], n_classes: int) -> Belief:
    """Return what alternatives, at least one, say together."""
    begun = [(each.base, each.outlook, each.unknown) for each in alternatives if each.outlook is not None]
    resting = [each.value for each in alternatives if each.outlook is None]
    shape = (len(begun), n_classes, len(PHASES))
    known = np.array([base + outlook.values for base, outlook, _ in begun]).reshape(shape)
    posteriors = _shares(np.concatenate([known.ravel(), [unknown for _, _, unknown in begun], resting]))
    of_known = posteriors[: known.size].reshape(shape)
    classes, gone = of_known.sum(axis=(0, 2)), of_known.sum(axis=0) @ PHASES
    nothing = [np.empty((0, 3))]
    return Belief(
        classes=classes,
        unknown=float(posteriors[known.size : known.size + len(begun)].sum()),
        rest=float(posteriors[known.size + len(begun) :].sum()),
        progress=np.divide(gone, classes, out=np.full_like(gone, 0.5), where=classes > 0),
        weights=of_known.ravel(),
        goals=np.concatenate([outlook.goals.reshape(-1, 3) for _, outlook, _ in begun] or nothing),
        spreads=np.array([outlook.spreads for _, outlook, _ in begun]).ravel(),
    )


def expected(belief: Belief, names: Sequence[str]) -> tuple[Expected, ...]:
    """Return the actions that may be under way, the likely first."""
    actions = [
        Expected(name, min(float(posterior), 1.0), float(progress))
        for name, posterior, progress in zip(names, belief.classes, belief.progress, strict=True)
    ]
    actions += [Expected(None, min(belief.unknown, 1.0), None), Expected(REST, min(belief.rest, 1.0), None)]
    return tuple(sorted(actions, key=lambda each: -each.posterior))


def likely_goals(belief: Belief, candidates: Mapping[str, Floats]) -> dict[str, float]:
    """Return the posterior of each candidate (3,) [m] to be where the movement under way goes."""
    likely = belief.weights > 0.0
    if not candidates or not likely.any():
        return {}
    off = np.array(list(candidates.values()))[:, None] - belief.goals[likely]
    square = GOAL_FLOOR**2 + belief.spreads[likely] ** 2
    densities = -0.5 * np.square(off).sum(axis=2) / square - 1.5 * np.log(square)
    posteriors = _shares(np.logaddexp.reduce(densities + np.log(belief.weights[likely]), axis=1))
    return dict(zip(candidates, posteriors.tolist(), strict=True))


def _shares(logs: Floats) -> Floats:
    """Return the shares of one of these logarithms of weights."""
    weights = np.exp(logs - logs.max())
    shares: Floats = weights / weights.sum()
    return shares
