"""The learned: feature specification, action models, and the model that holds them together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.motion.errors import UnknownAction
from app.motion.trajectory import Floats


@dataclass(frozen=True)
class FeatureSpecification:
    """What all action models of a model observe.

    objects: the roles whose distance to the hand is a feature; rate: the internal rate to which
    demonstrations and streams are resampled [Hz].
    """

    objects: tuple[str, ...] = ()
    rate: float = 50.0

    @property
    def n_features(self) -> int:
        """Three deviations, the height over the table, one distance per object."""
        return 4 + len(self.objects)


@dataclass(frozen=True, eq=False)
class ActionModel:
    """The left-right Gaussian HMM of one action class (the paper's A_k).

    It starts in the first state, stays or goes on to the next, and ends in the last.
    means, variances: (n_states, n_features) [m], [m^2]; stay: (n_states,) probability of staying in a
    state; weights: (n_states,) frames that each state explained in training, which is what training
    further goes by; durations: (n_demonstrations,) of the demonstrations [s].
    """

    action: str
    means: Floats
    variances: Floats
    stay: Floats
    weights: Floats
    durations: Floats

    @property
    def n_states(self) -> int:
        """Number of hidden states."""
        return len(self.means)


@dataclass(frozen=True, eq=False)
class Background:
    """What any frame of any movement might look like: a Cauchy density around all demonstrations.

    location, scale: (n_features,) [m]. Its heavy tails leave a movement that no class resembles to it; a
    Gaussian would find such a movement even less likely than the classes do.
    """

    location: Floats
    scale: Floats


@dataclass(frozen=True, eq=False)
class Model:
    """Action models that share one feature specification, and the background they are held against."""

    features: FeatureSpecification
    actions: tuple[ActionModel, ...]
    background: Background

    @property
    def names(self) -> tuple[str, ...]:
        """The action classes, in the order of all arrays over classes."""
        return tuple(model.action for model in self.actions)

    @property
    def longest(self) -> float:
        """Duration of the longest demonstration [s]."""
        return float(max(np.max(model.durations) for model in self.actions))

    def action(self, name: str) -> ActionModel:
        """Return the action model of a class; raises UnknownAction."""
        for model in self.actions:
            if model.action == name:
                return model
        raise UnknownAction(name, self.names)
