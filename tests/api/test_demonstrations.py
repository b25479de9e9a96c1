"""Uploads over the real server: kept whole and once, or refused by name."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from app.client import ApiError, GestaClient, trajectory
from app.motion.simulation import recording
from app.motion.trajectory import Demonstration, Floats
from tests.api.conftest import Sent
from tests.serving import Server

Change = Callable[[dict[str, Any]], None]


def files(server: Server) -> int:
    return sum(path.is_file() for path in Path(server.store.url).rglob("*"))


def ids(client: GestaClient, model: str) -> list[str]:
    return [item["id"] for item in client.pages(f"/models/{model}/demonstrations", "demonstrations")]


def test_what_was_uploaded_is_there_to_the_last_bit(
    client: GestaClient, new_model: Callable[..., str], sent: list[Sent], shown: list[Demonstration]
) -> None:
    model = new_model()
    answer = client.add_demonstrations(model, sent)
    assert ids(client, model) == answer["created"]
    assert answer["geometry"] == {"length_unit": "m", "up_axis": "z"}
    for id_, demonstration in zip(answer["created"], shown, strict=True):
        found = client.request("GET", f"/models/{model}/demonstrations/{id_}")
        assert found["action"] == demonstration.action
        assert found["trajectory"] == as_json(demonstration)
    listed = client.request("GET", f"/models/{model}/demonstrations?action=push&page_size=3")
    assert [item["action"] for item in listed["demonstrations"]] == ["push"] * 3
    assert listed["actions"] == dict.fromkeys(("displace", "grasp", "push", "retract"), 4)


def as_json(demonstration: Demonstration) -> dict[str, Any]:
    motion = demonstration.trajectory
    return trajectory(motion.times, motion.hand, motion.objects)


def test_the_same_content_is_kept_once(
    client: GestaClient, new_model: Callable[..., str], sent: list[Sent]
) -> None:
    model = new_model()
    first = client.add_demonstrations(model, sent[:2])
    again = client.add_demonstrations(model, [sent[1], sent[2], sent[1]])
    assert again["duplicates"] == [first["created"][1]]
    assert len(again["created"]) == 1
    assert len(ids(client, model)) == 3
    client.request("DELETE", f"/models/{model}/demonstrations/{first['created'][0]}")
    assert len(ids(client, model)) == 2


def y_up(positions: Floats) -> Floats:
    """Return what a y-up system in millimetres would have recorded."""
    return 1000.0 * np.column_stack([positions[:, 0], positions[:, 2], -positions[:, 1]])


def test_geometry_is_converted_and_echoed(
    client: GestaClient, new_model: Callable[..., str], shown: list[Demonstration]
) -> None:
    model, motion = new_model(), shown[0].trajectory
    moved = trajectory(motion.times, y_up(motion.hand), {"object": y_up(motion.objects["object"])})
    geometry = {"length_unit": "mm", "up_axis": "y"}
    answer = client.add_demonstrations(model, [("grasp", moved)], geometry)
    assert answer["geometry"] == geometry
    [id_] = answer["created"]
    found = client.request("GET", f"/models/{model}/demonstrations/{id_}")
    np.testing.assert_allclose(found["trajectory"]["hand"], motion.hand, atol=1e-12)
    assert found["geometry"] == {"length_unit": "m", "up_axis": "z"}


def test_dropouts_stay_dropouts_and_a_rate_stands_for_times(
    client: GestaClient, new_model: Callable[..., str], sent: list[Sent]
) -> None:
    model, motion = new_model(), copy.deepcopy(sent[0][1])
    motion["hand"][20], motion["objects"]["object"][7] = None, None
    del motion["t"]
    [id_] = client.add_demonstrations(model, [("grasp", {"rate_hz": 100, **motion})])["created"]
    found = client.request("GET", f"/models/{model}/demonstrations/{id_}")["trajectory"]
    assert [i for i, position in enumerate(found["hand"]) if position is None] == [20]
    assert [i for i, position in enumerate(found["objects"]["object"]) if position is None] == [7]
    np.testing.assert_allclose(np.diff(found["t"]), 0.01)


def at(*path: Any, to: Any) -> Change:
    def change(motion: dict[str, Any]) -> None:
        target: Any = motion
        for step in path[:-1]:
            target = target[step]
        target[path[-1]] = to

    return change


def short(n_frames: int) -> Change:
    def change(motion: dict[str, Any]) -> None:
        for track in (motion["t"], motion["hand"], motion["objects"]["object"]):
            del track[n_frames:]

    return change


def back_to_start(motion: dict[str, Any]) -> None:
    motion["hand"][-1] = motion["hand"][0]


@pytest.mark.parametrize(
    ("change", "pointer", "code"),
    [
        (at("hand", 5, 1, to=float("nan")), "/demonstrations/1/trajectory/hand/5/1", "finite_number"),
        (at("t", 3, to=float("inf")), "/demonstrations/1/trajectory/t/3", "finite_number"),
        (at("hand", 5, to=[0.1, 0.2]), "/demonstrations/1/trajectory/hand/5", "too_short"),
        (at("hand", 5, 0, to="0.1"), "/demonstrations/1/trajectory/hand/5/0", "float_type"),
        (at("t", 3, to=0.0), "/demonstrations/1/trajectory/t/3", "times_not_increasing"),
        (at("hand", 5, to=[0, 700, 0]), "/demonstrations/1/trajectory/hand/5", "wrong_unit"),
        (
            at("objects", "object", 6, to=[0, 0, 1e3]),
            "/demonstrations/1/trajectory/objects/object/6",
            "wrong_unit",
        ),
        (
            at("objects", "object", to=[[0.0, 0.0, 0.0]]),
            "/demonstrations/1/trajectory/objects/object",
            "wrong_length",
        ),
        (at("objects", to={}), "/demonstrations/1", "role_missing"),
        (at("rate_hz", to=100), "/demonstrations/1/trajectory", "value_error"),
        (at("hand", 0, to=None), "/demonstrations/1", "unusable_demonstration"),
        (short(10), "/demonstrations/1", "unusable_demonstration"),
        (back_to_start, "/demonstrations/1", "unusable_demonstration"),
    ],
)
def test_a_refusal_names_field_and_frame_and_keeps_nothing(
    client: GestaClient,
    server: Server,
    new_model: Callable[..., str],
    sent: list[Sent],
    change: Change,
    pointer: str,
    code: str,
) -> None:
    model, motion, before = new_model(), copy.deepcopy(sent[1][1]), files(server)
    change(motion)
    with pytest.raises(ApiError) as raised:
        upload_with_nan(client, model, [sent[0], ("grasp", motion)])
    assert raised.value.status == 422
    assert (pointer, code) in [(p["pointer"], p["code"]) for p in raised.value.problem["errors"]]
    assert ids(client, model) == []
    assert files(server) == before


def upload_with_nan(client: GestaClient, model: str, demonstrations: list[Sent]) -> None:
    """Upload as a writer of JSON would that lets NaN through."""
    items = [{"action": action, "trajectory": motion} for action, motion in demonstrations]
    body = {"geometry": {"length_unit": "m", "up_axis": "z"}, "demonstrations": items}
    answer = httpx.post(
        f"{client.url}/v1/models/{model}/demonstrations",
        content=json.dumps(body),
        headers={"Content-Type": "application/json"},
    )
    if answer.is_error:
        raise ApiError(answer.status_code, answer.json())


def test_all_refusals_of_an_upload_are_told_together(
    client: GestaClient, new_model: Callable[..., str], sent: list[Sent]
) -> None:
    first, second = copy.deepcopy(sent[0][1]), copy.deepcopy(sent[1][1])
    first["t"][3], second["hand"][5] = 0.0, [0.0, 700.0, 0.0]
    with pytest.raises(ApiError) as raised:
        client.add_demonstrations(new_model(), [("grasp", first), sent[2], ("grasp", second)])
    places = [place["pointer"] for place in raised.value.problem["errors"]]
    assert places == ["/demonstrations/0/trajectory/t/3", "/demonstrations/2/trajectory/hand/5"]


def test_a_labelled_recording_becomes_its_demonstrations(
    client: GestaClient, new_model: Callable[..., str]
) -> None:
    model, labelled = new_model(), recording(5, 4)
    motion = trajectory(labelled.trajectory.times, labelled.trajectory.hand, labelled.trajectory.objects)
    labels = [
        {"action": segment.action, "start_s": segment.start / 100, "end_s": segment.end / 100}
        for segment in labelled.segments
    ]
    answer = client.add_recording(model, motion, labels[::-1])
    for id_, demonstration in zip(answer["created"], labelled.demonstrations(), strict=True):
        found = client.request("GET", f"/models/{model}/demonstrations/{id_}")
        assert found["action"] == demonstration.action
        assert found["trajectory"] == as_json(demonstration)


def test_rest_names_no_action(client: GestaClient, new_model: Callable[..., str], sent: list[Sent]) -> None:
    motion = sent[1][1]
    with pytest.raises(ApiError) as raised:
        client.add_demonstrations(new_model(), [sent[0], ("rest", motion), ("idle", motion)])
    [found] = raised.value.problem["errors"]
    assert (found["pointer"], found["code"]) == ("/demonstrations/1/action", "reserved_name")
    labels = [{"action": "rest", "start_s": 0.0, "end_s": motion["t"][-1]}]
    with pytest.raises(ApiError) as raised:
        client.add_recording(new_model(), motion, labels)
    [found] = raised.value.problem["errors"]
    assert (found["pointer"], found["code"]) == ("/recording/segments/0/action", "reserved_name")


@pytest.mark.parametrize(
    ("labels", "place"),
    [
        ([("grasp", 0.0, 0.5), ("push", 0.4, 0.9)], 1),
        ([("grasp", 0.5, 0.5)], 0),
        ([("grasp", 0.0, 99.0)], 0),
        ([("grasp", -1.0, 0.5)], 0),
    ],
)
def test_labels_that_do_not_fit_are_refused(
    client: GestaClient, new_model: Callable[..., str], labels: list[tuple[str, float, float]], place: int
) -> None:
    motion = recording(5, 4).trajectory
    with pytest.raises(ApiError) as raised:
        client.add_recording(
            new_model(),
            trajectory(motion.times, motion.hand, motion.objects),
            [{"action": action, "start_s": start, "end_s": end} for action, start, end in labels],
        )
    [found] = raised.value.problem["errors"]
    assert (found["pointer"], found["code"]) == (f"/recording/segments/{place}", "invalid_segment")
