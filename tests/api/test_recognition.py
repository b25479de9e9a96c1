"""Whole recordings over the real server: at once, as jobs, and as a stream has them."""

from __future__ import annotations

from typing import Any

import httpx
import numpy as np
import pytest

from app.client import METRES, ApiError, GestaClient, trajectory
from app.motion.evaluation import evaluate
from app.motion.model import Model
from app.motion.recogniser import SegmentEvent, recognise
from app.motion.simulation import recording
from app.motion.trajectory import Recording, Segment, Trajectory
from app.service.recognition import LONG
from tests.api.conftest import working
from tests.serving import Server
from tests.talking import waving

SAMPLE = recording(21, 4)


def as_sent(motion: Trajectory) -> dict[str, Any]:
    return trajectory(motion.times, motion.hand, motion.objects)


def found(model: Model, motion: Trajectory) -> list[Segment]:
    events = recognise(model, motion)
    return [Segment(e.start, e.end, e.action) for e in events if isinstance(e, SegmentEvent)]


def labels(labelled: Recording) -> list[dict[str, Any]]:
    times = labelled.trajectory.times
    return [{"action": s.action, "start_s": times[s.start], "end_s": times[s.end]} for s in labelled.segments]


def test_segments_are_those_of_the_core_and_of_a_stream(
    client: GestaClient, table_top: str, trained: Model
) -> None:
    motion = SAMPLE.trajectory
    segments = client.segment(table_top, "latest", as_sent(motion))["segments"]
    told = [Segment(s["start_seq"], s["end_seq"], s["action"]) for s in segments]
    assert told == found(trained, motion)
    with client.stream(table_top) as stream:
        stream.send(motion.times, motion.hand, motion.objects)
        stream.end()
        streamed = [message for message in stream if message["type"] == "segment"]
    for segment, event in zip(segments, streamed, strict=True):
        assert segment == {name: event[name] for name in segment}


def test_geometry_and_scene_are_those_declared(client: GestaClient, table_top: str) -> None:
    motion, up = SAMPLE.trajectory, np.array([0.0, 0.0, 0.7])
    flat = client.segment(table_top, 1, as_sent(motion))["segments"]
    raised = trajectory(
        motion.times, 1000 * (motion.hand + up), {"object": 1000 * (motion.objects["object"] + up)}
    )
    answer = client.segment(
        table_top,
        1,
        raised,
        geometry={"length_unit": "mm", "up_axis": "z"},
        scene={"table_height_m": 0.7},
    )
    assert answer["geometry"] == {"length_unit": "mm", "up_axis": "z"}
    same = ("start_seq", "end_seq", "action")
    assert [[s[k] for k in same] for s in answer["segments"]] == [[s[k] for k in same] for s in flat]


def test_an_evaluation_is_the_cores(client: GestaClient, table_top: str, trained: Model) -> None:
    motion = SAMPLE.trajectory
    body = {"trajectory": as_sent(motion), "segments": labels(SAMPLE)}
    answer = client.evaluate(table_top, 1, recording=body)
    expected = evaluate([(motion.times, SAMPLE.segments, found(trained, motion))])
    for name in ("n_true", "n_found", "delineated", "f1_50", "f1_75", "frame_accuracy", "n_extra"):
        assert answer[name] == getattr(expected, name)
    assert answer["per_class"].keys() == expected.per_class.keys()
    assert (answer["model"], answer["version"]) == (table_top, 1)


def test_a_long_recording_is_a_job_with_the_same_answer(
    client: GestaClient, server: Server, table_top: str, trained: Model
) -> None:
    motion = repeated(SAMPLE.trajectory, LONG)
    job = client.segment(table_top, 1, as_sent(motion))
    assert (job["kind"], job["state"]) == ("segmentation", "queued")
    with working(server):
        segments = client.result(job["id"])["segments"]
    assert [Segment(s["start_seq"], s["end_seq"], s["action"]) for s in segments] == found(trained, motion)


@pytest.mark.parametrize(
    "headers", [[("Prefer", "wait=5"), ("Prefer", "Respond-Async; x=1")], [("Prefer", "foo, respond-async")]]
)
def test_a_short_recording_is_a_job_where_that_is_preferred(
    client: GestaClient, server: Server, table_top: str, headers: list[tuple[str, str]]
) -> None:
    motion = as_sent(SAMPLE.trajectory)
    bodies = {
        "segmentations": {"geometry": METRES, "trajectory": motion},
        "evaluations": {
            "geometry": METRES,
            "recording": {"trajectory": motion, "segments": labels(SAMPLE)},
        },
    }
    for path, body in bodies.items():
        url = f"{client.url}/v1/models/{table_top}/versions/1/{path}"
        at_once = httpx.post(url, json=body, headers=[("Prefer", "wait=5")])
        later = httpx.post(url, json=body, headers=headers)
        assert (at_once.status_code, later.status_code) == (200, 202)
        job = later.json()
        assert later.headers["Location"] == f"/v1/jobs/{job['id']}"
        with working(server):
            result = client.result(job["id"])
        assert result == {name: at_once.json()[name] for name in result}


def test_a_key_gives_the_same_job_of_a_recording(client: GestaClient, table_top: str) -> None:
    motion = as_sent(SAMPLE.trajectory)
    job = client.segment(table_top, 1, motion, as_job=True, idempotency_key="one")
    assert client.segment(table_top, 1, motion, as_job=True, idempotency_key="one")["id"] == job["id"]
    with pytest.raises(ApiError, match="409 idempotency_key_reused"):
        client.segment(table_top, 1, as_sent(waving()), as_job=True, idempotency_key="one")
    client.cancel(job["id"])


def repeated(motion: Trajectory, n_frames: int) -> Trajectory:
    """Return the motion over and over, ``n_frames`` of it."""
    index = np.arange(n_frames) % len(motion)
    return Trajectory(
        np.arange(n_frames) / 100.0, motion.hand[index], {"object": motion.objects["object"][index]}
    )


def test_objects_may_have_any_names(client: GestaClient, table_top: str, trained: Model) -> None:
    motion = SAMPLE.trajectory
    thing = motion.objects["object"]
    for objects in (
        {"cup": thing},
        {"cup": thing + 0.4, "object": thing},
        {"saucer": thing + 0.4, "cup": thing},
    ):
        renamed = Trajectory(motion.times, motion.hand, objects)
        segments = client.segment(table_top, 1, as_sent(renamed))["segments"]
        told = [(s["start_seq"], s["end_seq"], s["action"], s["objects"], s["novelty"]) for s in segments]
        events = [e for e in recognise(trained, renamed) if isinstance(e, SegmentEvent)]
        assert told == [(e.start, e.end, e.action, e.objects, e.novelty) for e in events]
        body = {"trajectory": as_sent(renamed), "segments": labels(SAMPLE)}
        measures = evaluate([(motion.times, SAMPLE.segments, found(trained, renamed))])
        assert client.evaluate(table_top, 1, recording=body)["f1_50"] == measures.f1_50


def test_what_the_model_does_not_know_has_no_name_and_is_no_detection(
    client: GestaClient, table_top: str
) -> None:
    motion = as_sent(waving())
    segments = client.segment(table_top, 1, motion)["segments"]
    assert [segment["action"] for segment in segments] == [None] * len(segments)
    assert len(segments) >= 2
    assert {segment["objects"]["object"] for segment in segments} == {"cup"}
    known = client.segment(table_top, 1, as_sent(SAMPLE.trajectory))["segments"]
    assert min(s["novelty"] for s in segments) > max(s["novelty"] for s in known)
    labelled = [{"action": "grasp", "start_s": segments[0]["t_start"], "end_s": segments[0]["t_end"]}]
    measures = client.evaluate(table_top, 1, recording={"trajectory": motion, "segments": labelled})
    assert (measures["n_true"], measures["n_found"], measures["frame_accuracy"]) == (1, 0, 0.0)


@pytest.mark.parametrize("n_frames", [100, LONG])
def test_objects_that_cannot_fill_the_roles_are_refused(
    client: GestaClient, server: Server, paired: Model, n_frames: int
) -> None:
    model = server.teach(paired, "pairs")
    motion = repeated(SAMPLE.trajectory, n_frames)
    for n_objects, code, places in (
        (0, "role_missing", []),
        (1, "role_missing", []),
        (9, "content_refused", [("/trajectory/objects", "objects_ambiguous")]),
    ):
        objects = {f"thing {index}": motion.objects["object"] for index in range(n_objects)}
        with pytest.raises(ApiError) as raised:
            client.segment(model, 1, trajectory(motion.times, motion.hand, objects))
        problem = raised.value.problem
        assert (problem["status"], problem["code"]) == (422, code)
        assert [(place["pointer"], place["code"]) for place in problem["errors"]] == places
    assert list(client.pages(f"/jobs?model={model}", "jobs")) == []


def test_an_evaluation_needs_labels(client: GestaClient, table_top: str) -> None:
    with pytest.raises(ApiError) as raised:
        client.evaluate(table_top, 1, recording={"trajectory": as_sent(SAMPLE.trajectory), "segments": []})
    assert raised.value.problem["errors"][0]["pointer"] == "/recording/segments"
