"""The comparison with hmmlearn compares like with like."""

from __future__ import annotations

import numpy as np

from app.motion.criterion import Criterion
from app.motion.model import Model
from app.motion.resampling import resample, stack
from app.motion.simulation import recording
from benchmarks.by_hmmlearn import PlainCriterion


def test_both_give_the_same(trained: Model) -> None:
    tracks = stack(resample(recording(3).trajectory, trained.features.rate), trained.features.objects)
    hand = np.ascontiguousarray(tracks[:, 0])
    objects = np.ascontiguousarray(tracks[:, 1:].swapaxes(0, 1))
    segments = np.array([[0, 30], [0, 5], [10, 70], [40, 90]])
    ours = Criterion(trained, 0.1)(hand, objects, segments)
    np.testing.assert_allclose(PlainCriterion(trained, 0.1)(hand, objects, segments), ours, rtol=1e-9)
