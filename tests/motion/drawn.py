"""Models and motion drawn at random."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.motion.conditioning import Tracks
from app.motion.model import N_SHAPE, ActionModel, Background, Familiarity, FeatureSpecification, Model, Rest
from app.motion.trajectory import Indices

TABLE = 0.7


def motion_of(rng: np.random.Generator, n_frames: int, n_objects: int = 1) -> Tracks:
    """Return a walk of about 2 cm a frame, with paces that it has nothing to do with."""
    hand = np.array([0.1, 0.2, TABLE]) + rng.normal(0.0, 0.02, (n_frames, 3)).cumsum(axis=0)
    objects = hand + rng.normal(0.0, 0.1, (n_objects, n_frames, 3))
    return Tracks(hand, rng.normal(0.0, 0.1, n_frames), objects, rng.normal(0.0, 0.1, (n_objects, n_frames)))


def model_of(rng: np.random.Generator, n_states: Sequence[int], n_objects: int = 1) -> Model:
    """Return a model with so many states in each of its classes."""
    specification = FeatureSpecification(tuple(f"object_{index}" for index in range(n_objects)))
    n_features = specification.n_features
    actions = tuple(
        ActionModel(
            action=f"action_{index}",
            means=rng.normal(0.0, 0.1, (n, n_features)),
            variances=rng.uniform(0.02, 0.1, (n, n_features)) ** 2,
            stay=rng.uniform(0.05, 0.95, n),
            weights=np.ones(n),
            durations=np.ones(rng.integers(2, 30)),
            starts=np.zeros((2, 3)),
            ways=np.eye(3)[:2],
            shapes=np.zeros((2, N_SHAPE)),
            repetition=1.0,
        )
        for index, n in enumerate(n_states)
    )
    background = Background(rng.uniform(0.5, 2.0, n_features))
    familiarity = Familiarity(np.ones(len(actions)), np.zeros(len(actions)))
    return Model(specification, actions, background, familiarity, Rest(0.0, 1.0))


def segments_of(rng: np.random.Generator, n_frames: int, n_segments: int) -> Indices:
    """Return (n_segments, 2) first and goal frames."""
    return np.sort([rng.choice(n_frames, 2, replace=False) for _ in range(n_segments)], axis=1)


def named(model: Model) -> Indices:
    """Return the one filling in which each object has the role of its own number."""
    return np.arange(len(model.features.objects))[None]
