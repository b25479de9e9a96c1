"""Trajectories over the real server: what the core generates, as the wire has it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from app.client import ApiError, GestaClient
from app.motion.generation import generate
from app.motion.model import Model

START, GOAL = [0.0, 0.0, 0.02], [0.12, 0.31, 0.05]


@pytest.mark.parametrize("action", ["grasp", "displace", "push", "retract"])
def test_a_trajectory_is_the_cores(client: GestaClient, table_top: str, trained: Model, action: str) -> None:
    answer = client.generate(table_top, "latest", action, START, GOAL, rate_hz=50, duration_s=1.2)
    motion = generate(trained, action, START, GOAL, rate=50, duration=1.2)
    pairs = {
        "t": motion.times,
        "position": motion.positions,
        "velocity": motion.velocities,
        "acceleration": motion.accelerations,
        "std": motion.std,
    }
    for name, expected in pairs.items():
        np.testing.assert_array_equal(answer[name], expected)
    assert (answer["model"], answer["version"], answer["action"]) == (table_top, 1, action)
    assert answer["feasibility"]["feasible"] is True
    assert answer["feasibility"]["duration_s"] == answer["t"][-1]


def test_the_plain_method_can_be_chosen(client: GestaClient, table_top: str, trained: Model) -> None:
    answer = client.generate(table_top, 1, "grasp", START, GOAL, method="paper")
    expected = generate(trained, "grasp", START, GOAL, method="paper")
    np.testing.assert_array_equal(answer["position"], expected.positions)


def test_end_points_are_met_exactly_and_at_rest(client: GestaClient, table_top: str) -> None:
    answer = client.generate(table_top, 1, "grasp", START, GOAL, frame_id="map")
    assert (answer["position"][0], answer["position"][-1]) == (START, GOAL)
    assert answer["velocity"][0] == answer["velocity"][-1] == [0.0, 0.0, 0.0]
    np.testing.assert_allclose(np.diff(answer["t"]), 0.01)
    assert answer["frame_id"] == "map"


@pytest.mark.parametrize(
    ("fields", "pointer"),
    [
        ({"goal": START}, "/goal"),
        ({"goal": [0, 0]}, "/goal"),
        ({"goal": [0, 0, "1"]}, "/goal/2"),
        ({"goal": [500, 0, 0]}, "/goal"),
        ({"rate_hz": 0}, "/rate_hz"),
        ({"rate_hz": 1e9}, "/rate_hz"),
        ({"duration_s": -1}, "/duration_s"),
        ({"speed": 1}, "/speed"),
    ],
)
def test_what_cannot_be_asked_for_is_pointed_at(
    client: GestaClient, table_top: str, fields: dict[str, Any], pointer: str
) -> None:
    path = f"/models/{table_top}/versions/1/actions/grasp/trajectories"
    with pytest.raises(ApiError) as raised:
        client.request("POST", path, {"start": START, "goal": GOAL, **fields})
    assert raised.value.status == 422
    assert pointer in [place["pointer"] for place in raised.value.problem["errors"]]


@pytest.mark.parametrize(
    ("ref", "action", "code"),
    [("1", "fly", "action"), ("9", "grasp", "version"), ("production", "grasp", "version")],
)
def test_what_is_not_there_is_not_found(
    client: GestaClient, table_top: str, ref: str, action: str, code: str
) -> None:
    with pytest.raises(ApiError, match=f"404 {code}_not_found"):
        client.generate(table_top, ref, action, START, GOAL)
