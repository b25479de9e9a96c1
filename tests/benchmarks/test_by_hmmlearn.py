"""The comparison with hmmlearn compares like with like."""

from __future__ import annotations

import numpy as np

from app.motion.model import Model
from app.motion.resampling import resample, stack
from app.motion.scoring import score_segments, states_of
from app.motion.simulation import recording
from benchmarks.by_hmmlearn import Ratios


def test_both_give_the_same_ratios(trained: Model) -> None:
    tracks = stack(resample(recording(3).trajectory, trained.features.rate), trained.features.objects)
    hand = np.ascontiguousarray(tracks[:, 0])
    objects = np.ascontiguousarray(tracks[:, 1:].swapaxes(0, 1))
    segments = np.array([[0, 30], [0, 5], [10, 70], [40, 90]])
    ours = score_segments(hand, objects, 0.1, segments, states_of(trained))
    np.testing.assert_allclose(Ratios(trained, hand, objects, 0.1)(segments), ours, rtol=1e-9)
