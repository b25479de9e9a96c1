"""Motion-capture files over the real server: looked into, taught from, or refused by what is wrong."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from threading import BoundedSemaphore
from typing import Any

import httpx
import numpy as np
import pytest

from app.client import GestaClient
from app.formats.capture import Declared
from app.motion.simulation import recording
from app.motion.trajectory import Recording
from app.service import captures
from app.service.errors import ReadersBusy
from tests.takes import qtm_tsv

SHARED = Path(__file__).parents[3] / "shared" / "data"
TRACKS = {"hand": "Hand top", "objects": {"object": "Box"}}


@pytest.fixture(scope="module")
def shown() -> Recording:
    """Four simulated actions."""
    return recording(5, 4)


def look(client: GestaClient, content: bytes, name: str, **fields: str) -> httpx.Response:
    return httpx.post(f"{client.url}/v1/captures", files={"file": (name, content)}, data=fields)


def teach(
    client: GestaClient, model: str, content: bytes, labels: Any = None, **fields: str
) -> httpx.Response:
    files: dict[str, Any] = {"file": ("take.tsv", content)}
    if labels is not None:
        files["segments"] = ("labels.json", json.dumps(labels))
    data = {"mapping": json.dumps(TRACKS), "up_axis": "z", **fields}
    url = f"{client.url}/v1/models/{model}/demonstrations"
    return httpx.post(url, files=files, data=data)


def labels_of(shown: Recording) -> list[dict[str, Any]]:
    times = shown.trajectory.times
    return [
        {"action": each.action, "start_s": times[each.start], "end_s": times[each.end]}
        for each in shown.segments
    ]


def test_a_file_is_told_in_metres_with_a_mapping(client: GestaClient, shown: Recording) -> None:
    answer = look(client, qtm_tsv(shown, gap=3), "take.tsv", up_axis="z").json()
    assert (answer["format"], answer["rate_hz"]) == ("qtm-tsv", 100.0)
    np.testing.assert_allclose(answer["t"], shown.trajectory.times, atol=1e-9)
    assert answer["tracks"]["Hand top"].pop(3) is None
    seen = np.delete(shown.trajectory.hand, 3, axis=0)
    np.testing.assert_allclose(answer["tracks"]["Hand top"], seen, atol=1e-9)
    assert answer["proposal"] == {"hand": ["Hand top"], "objects": {"object": ["Box"]}}
    assert answer["reasons"]


def test_nothing_is_kept_of_what_was_looked_into(client: GestaClient, shown: Recording) -> None:
    before = client.request("GET", "/models?page_size=500")
    look(client, qtm_tsv(shown), "take.tsv", up_axis="z")
    assert client.request("GET", "/models?page_size=500") == before


def test_a_labelled_file_teaches_what_its_recording_would(
    client: GestaClient, new_model: Callable[..., str], shown: Recording
) -> None:
    model = new_model()
    answer = teach(client, model, qtm_tsv(shown), labels_of(shown))
    assert answer.status_code == 201, answer.text
    for id_, expected in zip(answer.json()["created"], shown.demonstrations(), strict=True):
        found = client.request("GET", f"/models/{model}/demonstrations/{id_}")
        assert found["action"] == expected.action
        np.testing.assert_allclose(found["trajectory"]["hand"], expected.trajectory.hand, atol=1e-8)
        track = expected.trajectory.objects["object"]
        np.testing.assert_allclose(found["trajectory"]["objects"]["object"], track, atol=1e-8)
    again = teach(client, model, qtm_tsv(shown), labels_of(shown)).json()
    assert again["created"] == []


def test_labels_are_given_other_names_or_left_out(
    client: GestaClient, new_model: Callable[..., str], shown: Recording
) -> None:
    model = new_model()
    first = shown.segments[0].action
    answer = teach(client, model, qtm_tsv(shown), labels_of(shown), actions=json.dumps({first: "reach"}))
    assert answer.status_code == 201, answer.text
    told = client.request("GET", f"/models/{model}/demonstrations")
    assert told["actions"] == {"reach": sum(each.action == first for each in shown.segments)}


@pytest.mark.parametrize(
    ("fields", "labels", "pointer", "code"),
    [
        ({"up_axis": ""}, [], "/up_axis", "undeclared_geometry"),
        ({"mapping": "{"}, [], "/mapping", "invalid_mapping"),
        ({"mapping": '{"hand": "Hand tip"}'}, [], "/mapping", "unknown_track"),
        ({"actions": "[]"}, [], "/actions", "invalid_actions"),
        ({}, [], "/segments", "invalid_labels"),
        ({}, [{"action": "grasp", "start_s": 2, "end_s": 1}], "/segments", "invalid_labels"),
        ({}, [{"action": "grasp", "start_s": 0, "end_s": 1e6}], "/segments", "invalid_labels"),
    ],
)
def test_what_is_wrong_is_pointed_at(
    client: GestaClient,
    new_model: Callable[..., str],
    shown: Recording,
    fields: dict[str, str],
    labels: list[Any],
    pointer: str,
    code: str,
) -> None:
    answer = teach(client, new_model(), qtm_tsv(shown), labels, **fields)
    assert answer.status_code == 422
    (found,) = answer.json()["errors"]
    assert (found["pointer"], found["code"]) == (pointer, code)


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        ("take.tsv", b"NO_OF_FRAMES\t3\nnonsense", "unreadable"),
        ("notes.txt", b"hello", "unknown_format"),
        ("take.n3d", b"\x20" * 400, "not_read"),
        ("take.c3d", b"\x02\x50" + b"\xff" * 2000, "unreadable"),
        ("../../etc/passwd", b"", "unknown_format"),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_by_name(
    client: GestaClient, name: str, content: bytes, code: str
) -> None:
    answer = look(client, content, name)
    assert answer.status_code == 422, answer.text
    (found,) = answer.json()["errors"]
    assert (found["pointer"], found["code"]) == ("/file", code)


def test_a_file_that_does_not_say_what_is_up_asks_for_it(client: GestaClient, shown: Recording) -> None:
    (found,) = look(client, qtm_tsv(shown), "take.tsv").json()["errors"]
    assert found["code"] == "undeclared_geometry"
    assert "declare up_axis" in found["detail"]


def test_a_form_without_its_parts_is_refused(client: GestaClient, new_model: Callable[..., str]) -> None:
    url = f"{client.url}/v1/models/{new_model()}/demonstrations"
    answer = httpx.post(url, files={"segments": ("labels.json", b"[]")})
    assert answer.status_code == 422
    assert {place["pointer"] for place in answer.json()["errors"]} == {"/file", "/mapping"}


def test_a_form_with_another_field_is_refused(client: GestaClient, shown: Recording) -> None:
    answer = look(client, qtm_tsv(shown), "take.tsv", up="z")
    assert answer.status_code == 422
    assert [place["pointer"] for place in answer.json()["errors"]] == ["/up"]


@pytest.mark.shared
def test_a_person_teaches_by_the_files_of_their_lab(
    client: GestaClient, new_model: Callable[..., str]
) -> None:
    raw, model = SHARED / "vmci_pick_place" / "raw", new_model()
    actions = {"approach_forward": "grasp", "move_obj_table": "displace", "move_to_rest_right": "retract"}
    labels = json.loads((raw / "subject1_run1_manually_segmented.json").read_text())
    fields = {
        "actions": json.dumps(actions),
        "mapping": json.dumps({"hand": "Hand top", "objects": {"object": "Box back"}}),
    }
    answer = teach(client, model, (raw / "subject1_run1.tsv").read_bytes(), labels, **fields)
    assert answer.status_code == 201, answer.text
    assert client.request("GET", f"/models/{model}/demonstrations")["actions"] == dict.fromkeys(
        sorted(actions.values()), 1
    )


def test_more_files_than_there_is_room_for_wait_for_their_turn_or_are_sent_away(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(captures, "PATIENCE_S", 0.0)
    monkeypatch.setattr(captures, "_turns", BoundedSemaphore(1))
    sent = captures.SentFile(b"t,hand.x,hand.y,hand.z\n0,0,0,0\n", "a.csv", Declared("m", "z"))
    with captures._turns, pytest.raises(ReadersBusy):
        captures.look(sent)
    assert captures.look(sent).times == [0.0]
