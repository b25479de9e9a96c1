"""Trajectories over the real server: what the core generates, in every form that the wire has for it."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from typing import Any

import httpx
import numpy as np
import pytest
from mcap.reader import make_reader

from app.client import ApiError, GestaClient
from app.motion.asked import Limits, Step, Via
from app.motion.generation import generate, generate_task
from app.motion.model import Model
from tests.formats.controller import faults

START, GOAL = [0.0, 0.0, 0.02], [0.12, 0.31, 0.05]
STEPS: list[dict[str, Any]] = [
    {"action": "grasp", "goal": GOAL},
    {"action": "displace", "goal": [-0.2, 0.3, 0.04], "duration_s": 1.3},
    {"action": "retract", "goal": START},
]
NAMES = {
    "t": "times",
    "position": "positions",
    "velocity": "velocities",
    "acceleration": "accelerations",
    "std": "std",
}
PATH = 'application/json;profile="nav_msgs/Path"'
MULTI_DOF = 'application/json;profile="trajectory_msgs/MultiDOFJointTrajectory"'


def ask(client: GestaClient, model: str, accept: str, **fields: Any) -> httpx.Response:
    """Return the answer to a generation of a grasp in a form."""
    url = f"{client.url}/v1/models/{model}/versions/1/actions/grasp/trajectories"
    body = {"start": START, "goal": GOAL, "rate_hz": 50, **fields}
    return httpx.post(url, json=body, headers={"Accept": accept})


@pytest.mark.parametrize("action", ["grasp", "displace", "push", "retract"])
def test_a_trajectory_is_the_cores(client: GestaClient, table_top: str, trained: Model, action: str) -> None:
    answer = client.generate(
        table_top,
        "latest",
        action,
        START,
        GOAL,
        rate_hz=50,
        duration_s=1.2,
        limits={"velocity_m_s": 0.3, "acceleration_m_s2": 1.0},
        via=[{"position": [0.05, 0.1, 0.2], "fraction": 0.4, "std_m": 0.01}],
    )
    motion = generate(
        trained,
        action,
        START,
        GOAL,
        rate=50,
        duration=1.2,
        limits=Limits(0.3, 1.0),
        via=[Via([0.05, 0.1, 0.2], 0.4, 0.01)],
    )
    told: Mapping[str, Any] = answer
    for name, of_core in NAMES.items():
        np.testing.assert_array_equal(told[name], getattr(motion, of_core))
    assert (answer["model"], answer["version"], answer["action"]) == (table_top, 1, action)
    feasibility = answer["feasibility"]
    assert feasibility["duration_s"] == answer["t"][-1] > 1.3
    assert [(each["code"], each["detail"]) for each in feasibility["warnings"]] == [
        (each.code, each.detail) for each in motion.notices
    ]
    assert "slowed" in {each["code"] for each in feasibility["warnings"]}
    assert np.linalg.norm(answer["velocity"], axis=1).max() <= 0.3
    assert np.linalg.norm(answer["acceleration"], axis=1).max() <= 1.0


def test_a_task_is_the_cores(client: GestaClient, table_top: str, trained: Model) -> None:
    answer = client.generate_task(table_top, 1, START, STEPS, rate_hz=100, limits={"velocity_m_s": 0.6})
    steps = [Step(each["action"], each["goal"], each.get("duration_s")) for each in STEPS]
    motion, ends = generate_task(trained, START, steps, limits=Limits(0.6))
    told: Mapping[str, Any] = answer
    for name, of_core in NAMES.items():
        np.testing.assert_array_equal(told[name], getattr(motion, of_core))
    assert [each["action"] for each in answer["steps"]] == ["grasp", "displace", "retract"]
    assert [each["t_end"] for each in answer["steps"]] == ends.tolist()
    assert [each["t_start"] for each in answer["steps"]] == [0.0, *ends.tolist()[:-1]]
    for each in answer["steps"]:
        frame = int(np.argmin(np.abs(np.array(answer["t"]) - each["t_end"])))
        np.testing.assert_allclose(answer["position"][frame], each["goal"], atol=1e-12)
        assert answer["velocity"][frame] == [0.0, 0.0, 0.0]
    assert answer["position"][-1] == START
    assert answer["feasibility"]["feasible"] is True


def test_the_plain_method_can_be_chosen(client: GestaClient, table_top: str, trained: Model) -> None:
    answer = client.generate(table_top, 1, "grasp", START, GOAL, method="paper")
    expected = generate(trained, "grasp", START, GOAL, method="paper")
    np.testing.assert_array_equal(answer["position"], expected.positions)
    assert answer["feasibility"]["feasible"] is False
    kinds = [each["kind"] for each in answer["feasibility"]["violations"]]
    assert kinds == ["moves_at_start", "moves_at_goal"]


def test_end_points_are_met_exactly_and_at_rest(client: GestaClient, table_top: str) -> None:
    answer = client.generate(table_top, 1, "grasp", START, GOAL, frame_id="map")
    assert (answer["position"][0], answer["position"][-1]) == (START, GOAL)
    assert answer["velocity"][0] == answer["velocity"][-1] == [0.0, 0.0, 0.0]
    np.testing.assert_allclose(np.diff(answer["t"]), 0.01)
    assert answer["frame_id"] == "map"


def test_what_is_violated_is_named_with_time_and_amount(client: GestaClient, table_top: str) -> None:
    box = {"min": [-1.0, -1.0, 0.0], "max": [1.0, 0.3, 0.05]}
    answer = client.generate(table_top, 1, "displace", START, GOAL, workspace=box)
    found = {each["kind"]: each for each in answer["feasibility"]["violations"]}
    assert found.keys() == {"workspace_max_y", "workspace_max_z"}
    positions = np.array(answer["position"])
    for axis, kind in ((1, "workspace_max_y"), (2, "workspace_max_z")):
        frame = positions[:, axis].argmax()
        assert found[kind]["t"] == answer["t"][frame]
        assert found[kind]["value"] == positions[frame, axis]
        assert found[kind]["limit"] == box["max"][axis]
    assert answer["feasibility"]["feasible"] is False


def test_a_hand_that_goes_below_the_table_is_named(client: GestaClient, table_top: str) -> None:
    answer = client.generate(table_top, 1, "push", START, [0.2, 0.3, -0.1])
    (found,) = answer["feasibility"]["violations"]
    assert (found["kind"], found["limit"]) == ("table", 0.0)
    assert found["value"] == np.min(answer["position"], axis=0)[2]


def test_a_start_far_from_all_demonstrations_is_answered_with_how_far(
    client: GestaClient, table_top: str
) -> None:
    answer = client.generate(table_top, 1, "grasp", [3.0, 0.0, 0.02], [3.2, 0.3, 0.04])
    details = {each["code"]: each["detail"] for each in answer["feasibility"]["warnings"]}
    assert {"start_far", "goal_far"} <= details.keys()
    assert "lies 3 m from" in details["start_far"]
    assert answer["feasibility"]["feasible"] is True


def test_a_table_reads_back_exactly(client: GestaClient, table_top: str) -> None:
    answer = ask(client, table_top, "text/csv")
    assert answer.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    told = ask(client, table_top, "application/json").json()
    assert [float(row["t"]) for row in rows] == told["t"]
    assert [[float(row[axis]) for axis in "xyz"] for row in rows] == told["position"]
    assert [[float(row[f"std_{axis}"]) for axis in "xyz"] for row in rows] == told["std"]


def test_a_controller_takes_the_trajectory_message(client: GestaClient, table_top: str) -> None:
    answer = ask(client, table_top, MULTI_DOF, frame_id="base_link", orientation=[1.0, 0.0, 0.0, 0.0])
    assert answer.headers["content-type"] == MULTI_DOF
    message = answer.json()
    assert faults(message) == []
    assert message["header"]["frame_id"] == "base_link"
    rotations = [point["transforms"][0]["rotation"] for point in message["points"]]
    assert all(rotation == {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0} for rotation in rotations)


def test_a_path_message_has_every_position(client: GestaClient, table_top: str) -> None:
    poses = ask(client, table_top, PATH).json()["poses"]
    told = ask(client, table_top, "*/*").json()
    assert [list(pose["pose"]["position"].values()) for pose in poses] == told["position"]


def test_a_bag_opens(client: GestaClient, table_top: str) -> None:
    answer = ask(client, table_top, "application/vnd.mcap")
    topics = {channel.topic for _, channel, _ in make_reader(io.BytesIO(answer.content)).iter_messages()}
    assert topics == {"/trajectory", "/path", "/pose", "/tf"}


def test_a_bag_of_too_many_frames_is_refused(client: GestaClient, table_top: str) -> None:
    answer = ask(client, table_top, "application/vnd.mcap", rate_hz=1000, duration_s=30)
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["pointer"] == "/rate_hz"


@pytest.mark.parametrize("accept", ["application/json", PATH, MULTI_DOF, "text/csv", "application/vnd.mcap"])
def test_what_stands_against_it_is_in_the_headers_of_every_form(
    client: GestaClient, table_top: str, accept: str
) -> None:
    box = {"min": [-1.0, -1.0, 0.0], "max": [1.0, 1.0, 0.05]}
    headers = ask(client, table_top, accept, workspace=box, limits={"velocity_m_s": 0.1}).headers
    assert (headers["gesta-model"], headers["gesta-version"]) == (table_top, "1")
    assert (headers["gesta-feasible"], headers["gesta-violations"]) == ("false", "workspace_max_z")
    assert "slowed" in headers["gesta-warnings"].split(", ")


@pytest.mark.parametrize("accept", ["image/png", 'application/json;profile="other"', "text/csv;q=0"])
def test_a_form_that_there_is_not_is_not_acceptable(client: GestaClient, table_top: str, accept: str) -> None:
    answer = ask(client, table_top, accept)
    assert (answer.status_code, answer.json()["code"]) == (406, "not_acceptable")
    assert "text/csv" in answer.json()["detail"]


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
        ({"limits": {"velocity_m_s": 0}}, "/limits/velocity_m_s"),
        ({"limits": {"velocity_m_s": 1e-9}}, "/limits"),
        ({"limits": {"speed": 1}}, "/limits/speed"),
        ({"via": [{"position": GOAL, "fraction": 1.0, "std_m": 0.01}]}, "/via/0/fraction"),
        ({"via": [{"position": [900, 0, 0], "fraction": 0.5, "std_m": 0.01}]}, "/via/0/position"),
        (
            {"via": [{"position": GOAL, "fraction": 0.5, "std_m": 0.01}], "method": "paper"},
            "/via",
        ),
        ({"workspace": {"min": [0, 0, 0], "max": [1, 1, 0]}}, "/workspace"),
        ({"orientation": [0, 0, 0, 2]}, "/orientation"),
        ({"orientation": [0, 0, 0]}, "/orientation"),
        ({"speed": 1}, "/speed"),
    ],
)
def test_what_cannot_be_asked_for_is_pointed_at(
    client: GestaClient, table_top: str, fields: dict[str, Any], pointer: str
) -> None:
    answer = ask(client, table_top, "*/*", **fields)
    assert answer.status_code == 422
    assert pointer in [place["pointer"] for place in answer.json()["errors"]]


@pytest.mark.parametrize(
    ("changed", "pointer"),
    [
        ({"goal": GOAL}, "/steps/1/goal"),
        ({"duration_s": 1e9}, "/steps/1/duration_s"),
        ({"via": [{"position": [900, 0, 0], "fraction": 0.5, "std_m": 0.01}]}, "/steps/1/via/0/position"),
    ],
)
def test_what_is_wrong_with_a_step_is_pointed_at(
    client: GestaClient, table_top: str, changed: dict[str, Any], pointer: str
) -> None:
    with pytest.raises(ApiError) as raised:
        client.generate_task(table_top, 1, START, [STEPS[0], {**STEPS[1], **changed}])
    assert raised.value.status == 422
    assert [place["pointer"] for place in raised.value.problem["errors"]] == [pointer]


@pytest.mark.parametrize(
    ("ref", "action", "code"),
    [("1", "fly", "action"), ("9", "grasp", "version"), ("production", "grasp", "version")],
)
def test_what_is_not_there_is_not_found(
    client: GestaClient, table_top: str, ref: str, action: str, code: str
) -> None:
    with pytest.raises(ApiError, match=f"404 {code}_not_found"):
        client.generate(table_top, ref, action, START, GOAL)
