"""Compiled kernels, made ready before the first frame comes."""

from __future__ import annotations

import numpy as np

from app.motion.model import FeatureSpecification
from app.motion.recogniser import recognise
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Demonstration, Trajectory


def warm() -> None:
    """Compile every kernel, or load it from the cache, by recognising a made-up movement."""
    fraction = np.linspace(0.0, 1.0, 60)[:, None]
    line = np.array([0.3, 0.0, 0.0]) * fraction
    motion = Trajectory(np.arange(60) / 100.0, line, {"object": line[::-1]})
    specification = FeatureSpecification(("object",))
    model = fit_model([Demonstration("reach", motion)] * 2, specification, TrainingOptions(n_states=2))
    recognise(model, motion)
