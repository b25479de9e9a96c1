"""The learned: feature specification, action models, and the model that holds them together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.motion.errors import UnknownAction
from app.motion.trajectory import Floats

N_INDEPENDENT = 4
"""All features of a frame are functions of three coordinates of the hand and of the time."""

N_OF_MOVEMENT, N_OF_ROLE = 6, 2
"""Features of a frame that tell of the movement, and of each role."""

PACE, PHASE = 4, 5
"""Columns of the hand's pace and of the phase."""

PACE_SPREAD, LENGTH_SPREAD = 0.3, 0.3
"""Least standard deviations of the logarithms of durations and of lengths: people differ by a third."""


N_COEFFICIENTS = 14
N_SHAPE = 3 * N_COEFFICIENTS
"""Numbers that tell the shape of a movement along each of the three aligned axes, and along all."""


@dataclass(frozen=True)
class FeatureSpecification:
    """What all action models of a model observe.

    Of the movement: its deviation (three) and the height over the table [m] as in ``features.encode``, the
    pace of the hand (``conditioning``), and the *phase*, the share of the movement's time that has gone by.
    Of each role: the distance of its object to the hand [m] and the pace of the object. objects: the roles;
    rate: the internal rate to which demonstrations and streams are resampled [Hz]; still: a hand slower than
    this is about as good as still, below it are tremor and noise [m/s].
    """

    objects: tuple[str, ...] = ()
    rate: float = 50.0
    still: float = 0.03

    @property
    def n_features(self) -> int:
        """Six of the movement, two of each role."""
        return N_OF_MOVEMENT + N_OF_ROLE * len(self.objects)


@dataclass(frozen=True, eq=False, repr=False)
class ActionModel:
    """The left-right Gaussian HMM of one action class (the paper's A_k).

    It starts in the first state, stays or goes on to the next, and ends in the last.
    means, variances: (n_states, n_features); stay: (n_states,) probability of staying in a
    state; weights: (n_states,) frames that each state explained in training, which is what training
    further goes by; durations: (n_demonstrations,) of the demonstrations [s]; starts, ways:
    (n_demonstrations, 3) where they start, and from there to the goal [m]; shapes: (n_demonstrations,
    N_SHAPE) as in ``shape.fit_shape`` [m]; repetition: how many neighbouring frames of a demonstration say
    what one independent frame would, at least 1.
    """

    action: str
    means: Floats
    variances: Floats
    stay: Floats
    weights: Floats
    durations: Floats
    starts: Floats
    ways: Floats
    shapes: Floats
    repetition: float

    @property
    def n_states(self) -> int:
        """Number of hidden states."""
        return len(self.means)

    @property
    def n_demonstrations(self) -> int:
        """Number of demonstrations that it was trained on."""
        return len(self.durations)

    @property
    def lengths(self) -> Floats:
        """(n_demonstrations,) from start to goal [m]."""
        lengths: Floats = np.linalg.norm(self.ways, axis=1)
        return lengths

    @property
    def tempo(self) -> tuple[float, float]:
        """Mean and standard deviation of the logarithm of durations in seconds."""
        return _log_normal(self.durations, PACE_SPREAD)

    @property
    def extent(self) -> tuple[float, float]:
        """Mean and standard deviation of the logarithm of lengths in metres."""
        return _log_normal(self.lengths, LENGTH_SPREAD)


@dataclass(frozen=True, eq=False)
class Background:
    """What any frame of any movement might look like: anywhere within ``width`` in each feature.

    width: (n_features,). It does not fall off: a movement that no class resembles is left to it, and it
    is the same whichever end points a frame is seen from.
    """

    width: Floats


@dataclass(frozen=True, eq=False)
class Familiarity:
    """How well classes explain demonstrations, in log-likelihood ratio to the background [nat per frame].

    typical: (n_classes,) what a class gets for its own; least: (n_classes,) what a movement must get to be
    of the class at all, learned from what the class gets for the demonstrations of all others.
    """

    typical: Floats
    least: Floats


@dataclass(frozen=True)
class Rest:
    """The pace that a hand has where an action begins or ends, and its spread: slower is rest."""

    pace: float
    spread: float


@dataclass(frozen=True, eq=False)
class Model:
    """Action models that share one feature specification, and what they are held against."""

    features: FeatureSpecification
    actions: tuple[ActionModel, ...]
    background: Background
    familiarity: Familiarity
    rest: Rest

    @property
    def names(self) -> tuple[str, ...]:
        """The action classes, in the order of all arrays over classes."""
        return tuple(model.action for model in self.actions)

    @property
    def evidence(self) -> float:
        """Share of the values of a segment's features that are independent evidence, 0..1."""
        weights = [model.n_demonstrations for model in self.actions]
        repetition = np.average([model.repetition for model in self.actions], weights=weights)
        return N_INDEPENDENT / self.features.n_features / float(repetition)

    def action(self, name: str) -> ActionModel:
        """Return the action model of a class; raises UnknownAction."""
        for model in self.actions:
            if model.action == name:
                return model
        raise UnknownAction(name, self.names)


def _log_normal(values: Floats, least_spread: float) -> tuple[float, float]:
    logs = np.log(values)
    spread = float(logs.std(ddof=1)) if len(logs) > 1 else 0.0
    return float(logs.mean()), max(spread, least_spread)
