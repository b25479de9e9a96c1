"""The conditions of the comparison: the same motion, sensed otherwise, with its labels where they belong."""

from __future__ import annotations

import numpy as np
import pytest

from app.motion.simulation import RATE, recording
from benchmarks.conditions import COLUMNS, JITTER, N_LONG, at_rate, jittered


@pytest.mark.parametrize("rate", [60.0, 120.0, 240.0])
def test_another_rate_is_the_same_motion(rate: float) -> None:
    simulated = recording(5)
    sampled = at_rate(simulated, rate)
    motion = sampled.trajectory
    np.testing.assert_allclose(np.diff(motion.times), 1.0 / rate)
    assert motion.times[-1] <= simulated.trajectory.times[-1]
    there = np.stack(
        [np.interp(motion.times, simulated.trajectory.times, axis) for axis in simulated.trajectory.hand.T], 1
    )
    np.testing.assert_allclose(motion.hand, there, atol=0.002)
    for before, after in zip(simulated.segments, sampled.segments, strict=True):
        assert after.action == before.action
        for at in ("start", "end"):
            moved = motion.times[getattr(after, at)] - simulated.trajectory.times[getattr(before, at)]
            assert abs(moved) <= 1.0 / rate


def test_jitter_moves_each_frame_by_less_than_a_third() -> None:
    simulated = recording(5)
    moved = jittered(simulated, 5).trajectory.times - simulated.trajectory.times
    assert 0.2 / RATE < np.abs(moved).max() <= JITTER / RATE
    assert jittered(simulated, 5).segments == simulated.segments
    np.testing.assert_array_equal(
        jittered(simulated, 5).trajectory.hand, jittered(simulated, 5).trajectory.hand
    )


def test_every_column_makes_its_recordings_of_seeds_of_its_own() -> None:
    for name, column in COLUMNS.items():
        ours, others = column.recordings(0, 2), column.recordings(1, 2)
        assert len(ours) == len(others) == 2, name
        assert not np.array_equal(
            ours[0].trajectory.hand[:50], others[0].trajectory.hand[:50], equal_nan=True
        )
    assert len(COLUMNS["15 actions"].recordings(0, 50)) == N_LONG
    assert all(len(each.segments) == 15 for each in COLUMNS["15 actions"].recordings(0, 2))
    assert any(np.isnan(each.trajectory.hand).any() for each in COLUMNS["gaps 0.3 s"].recordings(0, 5))
