"""Movements to write down, without a model to generate them."""

from __future__ import annotations

import numpy as np

from app.motion.generation import GeneratedMotion
from app.motion.shape import MINIMUM_JERK


def minimum_jerk(n_frames: int = 50, rate: float = 100.0, seed: int = 0) -> GeneratedMotion:
    """Return a movement at rest at both ends, between two points drawn at random."""
    rng = np.random.default_rng(seed)
    start, way, spread = rng.normal(0.0, 0.3, (3, 3))
    phase, seconds = np.linspace(0.0, 1.0, n_frames), (n_frames - 1) / rate
    position, velocity, acceleration = (
        np.outer(MINIMUM_JERK.deriv(order)(phase) / seconds**order, way) for order in range(3)
    )
    return GeneratedMotion(
        times=np.arange(n_frames) / rate,
        positions=start + position,
        velocities=velocity,
        accelerations=acceleration,
        std=np.outer(phase * (1.0 - phase), np.abs(spread)),
    )
