"""Whole recordings over the real server: at once, as jobs, and as a stream has them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from app.client import ApiError, GestaClient, trajectory
from app.motion.evaluation import evaluate
from app.motion.model import Model
from app.motion.recogniser import SegmentEvent, recognise
from app.motion.simulation import recording
from app.motion.trajectory import Recording, Segment, Trajectory
from app.service.recognition import LONG
from tests.api.conftest import working
from tests.serving import Server

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


def repeated(motion: Trajectory, n_frames: int) -> Trajectory:
    """Return the motion over and over, ``n_frames`` of it."""
    index = np.arange(n_frames) % len(motion)
    return Trajectory(
        np.arange(n_frames) / 100.0, motion.hand[index], {"object": motion.objects["object"][index]}
    )


def test_a_recording_without_the_role_is_refused(client: GestaClient, table_top: str) -> None:
    motion = SAMPLE.trajectory
    with pytest.raises(ApiError, match="422 role_missing"):
        client.segment(table_top, 1, trajectory(motion.times, motion.hand, {"cup": motion.hand}))


def test_an_evaluation_needs_labels(client: GestaClient, table_top: str) -> None:
    with pytest.raises(ApiError) as raised:
        client.evaluate(table_top, 1, recording={"trajectory": as_sent(SAMPLE.trajectory), "segments": []})
    assert raised.value.problem["errors"][0]["pointer"] == "/recording/segments"
