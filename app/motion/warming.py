"""Compiled kernels, made ready before the first frame comes."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numba.core.event import Listener, install_listener

from app.motion.model import N_SHAPE, ActionModel, Background, Familiarity, FeatureSpecification, Model, Rest
from app.motion.recogniser import Recogniser
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Demonstration, Trajectory, is_sound
from app.motion.validation import cross_validate

N_STATES = 4
N_SHOWN = 3
"""Demonstrations without which none could be left out."""

log = logging.getLogger(__name__)


def warm() -> None:
    """Compile every kernel, or load it from the cache: those of recognition, of training, of generation."""
    _recognise()
    features, options = FeatureSpecification(("object",)), TrainingOptions()
    shown = [Demonstration("reach", _motion())] * N_SHOWN
    model = fit_model(shown, features, options)
    fit_model(shown, features, options, base=model, learned=[0])
    cross_validate(model, shown, options)


def warm_recognition() -> None:
    """Make ready what a server needs: the kernels of recognition and generation; say if that takes long."""
    with install_listener("numba:compile", _Told()):
        _recognise()


def _recognise() -> None:
    motion = _motion()
    is_sound(np.column_stack([motion.times, motion.hand]), -1.0)
    recogniser = Recogniser(_model())
    recogniser.push(motion)
    recogniser.hypothesis()
    recogniser.finish()


def _motion() -> Trajectory:
    """Return a made-up movement along a line."""
    fraction = np.linspace(0.0, 1.0, 60)[:, None]
    line = np.array([0.3, 0.0, 0.0]) * fraction
    return Trajectory(np.arange(60) / 100.0, line, {"object": line[::-1]})


def _model() -> Model:
    """Return a made-up model, for which nothing was trained."""
    features = FeatureSpecification(("object",))
    of_states = (N_STATES, features.n_features)
    action = ActionModel(
        "reach",
        means=np.zeros(of_states),
        variances=np.ones(of_states),
        stay=np.full(N_STATES, 0.9),
        weights=np.ones(N_STATES),
        durations=np.full(N_SHOWN, 0.6),
        starts=np.zeros((N_SHOWN, 3)),
        ways=np.full((N_SHOWN, 3), [0.3, 0.0, 0.0]),
        shapes=np.zeros((N_SHOWN, N_SHAPE)),
        repetition=1.0,
    )
    background = Background(np.full(features.n_features, 10.0))
    return Model(features, (action,), background, Familiarity(np.ones(1), np.zeros(1)), Rest(-3.0, 0.5))


class _Told(Listener):
    """Says once that kernels are being compiled: it takes long, and `gesta warm` saves it."""

    def __init__(self) -> None:
        self._said = False

    def on_start(self, _event: Any) -> None:
        if not self._said:
            log.warning("compiling kernels that are not in the cache; `gesta warm` does it beforehand")
        self._said = True

    def on_end(self, _event: Any) -> None:
        """Say nothing more."""
