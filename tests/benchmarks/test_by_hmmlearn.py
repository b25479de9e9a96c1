"""The comparison with hmmlearn compares like with like."""

from __future__ import annotations

import numpy as np
import pytest

from app.motion.conditioning import condition
from app.motion.criterion import Criterion
from app.motion.model import Model
from app.motion.resampling import resample, stack
from app.motion.simulation import recording
from app.motion.trajectory import Indices
from benchmarks.by_hmmlearn import PlainCriterion


@pytest.mark.parametrize("fillings", [np.array([[0]]), np.array([[1]]), np.array([[0], [1]])])
def test_both_give_the_same(trained: Model, fillings: Indices) -> None:
    positions = stack(resample(recording(3).trajectory, trained.features.rate), trained.features.objects)
    beside = positions[:, 1:] + np.array([0.05, 0.02, 0.0])
    tracks = condition(np.concatenate([positions, beside], axis=1), trained.features)
    segments = np.array([[0, 30], [0, 5], [10, 70], [40, 90]])
    ours = Criterion(trained, 0.1, fillings)(tracks, segments)
    theirs = PlainCriterion(trained, 0.1, fillings)(tracks, segments)
    np.testing.assert_allclose(theirs.criterion, ours.criterion, rtol=1e-9)
    np.testing.assert_allclose(theirs.ratio, ours.ratio, rtol=1e-9)
    np.testing.assert_array_equal(theirs.filling, ours.filling)
