"""What a movement was asked for and does not do is told, exactly and at any rate."""

from __future__ import annotations

import numpy as np
import pytest

from app.motion.asked import Step, Via
from app.motion.generation import generate, generate_task
from app.motion.model import Model

START, GOAL = [0.1, 0.3, 0.04], [-0.2, 0.25, 0.04]


@pytest.mark.parametrize("rate", [2.0, 5.0, 100.0])
def test_point_on_the_way_is_not_missed_at_any_rate(trained: Model, rate: float) -> None:
    fine = generate(trained, "displace", START, GOAL, rate=1000.0, duration=1.0)
    for frame in (130, 500, 810):
        via = [Via(fine.positions[frame], frame / 1000.0, 0.001)]
        assert generate(trained, "displace", START, GOAL, rate=rate, duration=1.0, via=via).violations == ()


def test_points_that_contradict_each_other_are_missed(trained: Model) -> None:
    via = [Via([0.0, 0.3, 0.5], 0.5, 0.001), Via([0.0, 0.3, 0.1], 0.5, 0.001)]
    violations = generate(trained, "displace", START, GOAL, duration=1.0, via=via).violations
    assert [(each.kind, each.time) for each in violations] == [("via", 0.5), ("via", 0.5)]
    np.testing.assert_allclose([each.value for each in violations], 0.2, atol=0.01)


def test_plain_task_is_told_to_move_where_its_steps_meet(trained: Model) -> None:
    steps = [Step("grasp", GOAL, 0.8), Step("retract", START, 1.0)]
    motion, _ = generate_task(trained, START, steps, method="paper")
    found = [(each.kind, each.time) for each in motion.violations]
    assert found == [
        ("moves_at_start", 0.0),
        ("moves_at_goal", 0.8),
        ("moves_at_start", 0.8),
        ("moves_at_goal", 1.8),
    ]
