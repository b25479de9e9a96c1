"""Reviewed segments become demonstrations, over the real server: while a session lives and after it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any
from uuid import uuid4

import numpy as np
import pytest

from app.client import ApiError, AsyncGestaClient, GestaClient, trajectory
from app.client.answers import Demonstration, Learned
from app.motion.simulation import recording
from app.motion.trajectory import Floats
from app.registry import sessions
from app.registry.records import SessionState, StoredEvent
from tests.api.conftest import Sent
from tests.serving import Server
from tests.talking import Message, checked, waving

SAMPLE = recording(5, 5)
MOTION = SAMPLE.trajectory
LENGTH = len(MOTION)
THING = MOTION.objects["object"]
SPAN = SAMPLE.segments[1].start, SAMPLE.segments[1].end
BY_NAME = {"object": "object"}
MILLIMETRES = {"length_unit": "mm", "up_axis": "z"}


def past(
    server: Server,
    model: str,
    objects: Mapping[str, Floats],
    filled: Message,
    span: tuple[int, int] = SPAN,
    height: float = 0.0,
    kept: int = LENGTH,
    state: SessionState = "ended",
) -> str:
    """Make a session of ``kept`` frames of the motion, with these objects and one segment; return its id."""
    rows = np.column_stack([MOTION.times, MOTION.hand, *objects.values()])[:kept].astype("<f8")
    event = {"type": "segment", "event": 0, "segment": 0, "start_seq": span[0], "end_seq": span[1]}
    stored = StoredEvent(0, "segment", json.dumps({**event, "action": "grasp", "objects": filled}))
    with server.database.transaction() as tx:
        made = sessions.create(
            tx,
            id_=uuid4().hex,
            model=model,
            version=1,
            token_hash="",
            artifact_digest="",
            geometry={"length_unit": "m", "up_axis": "z"},
            channels=("t", *(f"{name}.{axis}" for name in ("hand", *objects) for axis in "xyz")),
            start={"rate_hz": None, "table_height_m": height},
        )
        for first in range(0, kept, 50):
            part = rows[first : first + 50].tobytes()
            sessions.append(tx, sessions.Addition(made.id, 0, first, rows=part))
        sessions.append(tx, sessions.Addition(made.id, 0, kept, events=[stored], state=state))
    return made.id


def learned(client: GestaClient, answer: Learned) -> Demonstration:
    """Return the demonstration that was made."""
    [id_] = answer["created"]
    return client.demonstration(answer["model"], id_)


def part(start: int, goal: int, **objects: Floats) -> Message:
    """Return frames ``start..goal`` of the motion as they are told."""
    span = slice(start, goal + 1)
    tracks = {name: track[span] for name, track in objects.items()}
    return trajectory(MOTION.times[span], MOTION.hand[span], tracks)


def refused(client: GestaClient, session_id: str, **fields: Any) -> tuple[int, str, list[tuple[str, str]]]:
    """Ask for what is refused; return status, code, and the places with their codes."""
    given = {"segment": 0, "action": "grasp", **fields}
    with pytest.raises(ApiError) as raised:
        client.learn(session_id, **given)
    places = [(place["pointer"], place["code"]) for place in raised.value.problem["errors"]]
    return raised.value.status, raised.value.code, places


@pytest.fixture
def model(new_model: Callable[..., str]) -> str:
    """A model without demonstrations."""
    return new_model()


class TestDemonstration:
    def test_is_the_segment_to_the_last_bit(self, client: GestaClient, server: Server, model: str) -> None:
        session_id = past(server, model, {"object": THING}, BY_NAME, height=0.02)
        answer = client.learn(session_id, 0, "push")
        assert (answer["model"], answer["duplicates"]) == (model, [])
        found = learned(client, answer)
        assert (found["action"], found["table_height_m"]) == ("push", 0.02)
        assert found["trajectory"] == part(*SPAN, object=THING)

    def test_has_the_ends_that_a_reviewer_gave_it(
        self, client: GestaClient, server: Server, model: str
    ) -> None:
        session_id = past(server, model, {"object": THING}, BY_NAME)
        begin, goal = SPAN[0] - 7, SPAN[1] + 60
        for given, span in (
            ({"start_seq": begin}, (begin, SPAN[1])),
            ({"end_seq": goal}, (SPAN[0], goal)),
            ({"start_seq": begin, "end_seq": goal}, (begin, goal)),
            ({"start_seq": LENGTH - 90, "end_seq": LENGTH}, (LENGTH - 90, LENGTH - 1)),
        ):
            found = learned(client, client.learn(session_id, 0, "grasp", **given))
            assert found["trajectory"] == part(*span, object=THING)

    def test_of_a_segment_that_ends_with_the_frames_has_its_goal_in_the_last(
        self, client: GestaClient, server: Server, model: str
    ) -> None:
        span = (LENGTH - 90, LENGTH)
        for state in ("ended", "active"):
            session_id = past(server, model, {"object": THING}, BY_NAME, span, 0.1 * (state == "active"))
            found = learned(client, client.learn(session_id, 0, "grasp"))
            assert found["trajectory"] == part(LENGTH - 90, LENGTH - 1, object=THING)

    @pytest.mark.parametrize(
        ("objects", "filled", "in_role"),
        [
            ({"cup": THING, "object": THING + 0.3}, {"object": "cup"}, THING),
            ({"cup": THING + 0.3, "object": THING}, {"object": "object"}, THING),
            ({"cup": THING + 0.3, "object": THING}, {}, THING),
        ],
    )
    def test_names_its_objects_by_the_roles_they_filled(
        self,
        client: GestaClient,
        server: Server,
        model: str,
        objects: dict[str, Floats],
        filled: Message,
        in_role: Floats,
    ) -> None:
        found = learned(client, client.learn(past(server, model, objects, filled), 0, "grasp"))
        assert found["objects"] == ["object"]
        assert found["trajectory"] == part(*SPAN, object=in_role)

    def test_is_kept_once_however_it_came(self, client: GestaClient, server: Server, model: str) -> None:
        session_id = past(server, model, {"object": THING}, BY_NAME)
        [first] = client.learn(session_id, 0, "grasp")["created"]
        assert client.learn(session_id, 0, "grasp")["duplicates"] == [first]
        [other] = client.learn(session_id, 0, "push")["created"]
        uploaded = client.add_demonstrations(model, [("grasp", part(*SPAN, object=THING))])
        assert (uploaded["created"], uploaded["duplicates"]) == ([], [first])
        assert client.model(model)["actions"] == {"grasp": 1, "push": 1}
        assert other != first

    def test_can_be_learned_by_asyncio_too(self, server: Server, model: str) -> None:
        async def run() -> Learned:
            async with AsyncGestaClient(server.url) as client:
                session_id = past(server, model, {"object": THING}, BY_NAME)
                return await client.learn(session_id, 0, "grasp", start_seq=SPAN[0] + 1, end_seq=SPAN[1])

        assert len(asyncio.run(run())["created"]) == 1


class TestRefusals:
    @pytest.mark.parametrize(
        ("fields", "status", "code", "places"),
        [
            ({"segment": 1}, 404, "segment_not_found", []),
            ({"segment": -1}, 422, "invalid", [("path/segment", "greater_than_equal")]),
            ({"action": "rest"}, 422, "content_refused", [("/action", "reserved_name")]),
            ({"action": "_"}, 422, "invalid", [("/action", "string_pattern_mismatch")]),
            ({"start_seq": -1}, 422, "invalid", [("/start_seq", "greater_than_equal")]),
            ({"end_seq": LENGTH + 1}, 422, "content_refused", [("/end_seq", "out_of_range")]),
            ({"start_seq": SPAN[1]}, 422, "content_refused", [("/start_seq", "out_of_range")]),
            ({"end_seq": SPAN[0]}, 422, "content_refused", [("/end_seq", "out_of_range")]),
            ({"start_seq": SPAN[1] - 5}, 422, "content_refused", [("", "unusable_demonstration")]),
        ],
    )
    def test_name_the_field_and_keep_nothing(
        self,
        client: GestaClient,
        server: Server,
        model: str,
        fields: Message,
        status: int,
        code: str,
        places: list[tuple[str, str]],
    ) -> None:
        session_id = past(server, model, {"object": THING}, BY_NAME)
        assert refused(client, session_id, **fields) == (status, code, places)
        assert client.model(model)["actions"] == {}

    def test_what_is_not_there(self, client: GestaClient, server: Server, model: str) -> None:
        assert refused(client, "none") == (404, "session_not_found", [])
        session_id = past(server, model, {"object": THING}, BY_NAME)
        client.delete_model(model)
        assert refused(client, session_id) == (404, "model_not_found", [])

    def test_a_role_that_nothing_filled(self, client: GestaClient, server: Server, model: str) -> None:
        session_id = past(server, model, {"cup": THING}, {})
        assert refused(client, session_id) == (422, "content_refused", [("", "role_missing")])

    def test_frames_that_are_no_longer_kept(self, client: GestaClient, server: Server, model: str) -> None:
        session_id = past(server, model, {"object": THING}, BY_NAME)
        with server.database.transaction() as tx:
            sessions.drop_frames(tx, last_seen_before=datetime.now(UTC))
        assert refused(client, session_id) == (410, "recording_gone", [])

    def test_frames_that_may_still_come(self, client: GestaClient, server: Server, model: str) -> None:
        kept = SPAN[1] + 10
        session_id = past(server, model, {"object": THING}, BY_NAME, kept=kept, state="active")
        assert refused(client, session_id, end_seq=kept) == (409, "frames_not_durable", [])
        assert len(client.learn(session_id, 0, "grasp", end_seq=kept - 1)["created"]) == 1


def test_an_unknown_action_is_learned_with_the_object_that_it_was_about(
    client: GestaClient, table_top: str
) -> None:
    motion = waving()
    with client.stream(table_top, objects=["cup"]) as stream:
        stream.send(motion.times, motion.hand, motion.objects)
        stream.end()
        told = [checked(json.dumps(message)) for message in stream]
    session_id = stream.state.started["session_id"]
    segments = [message for message in told if message["type"] == "segment"]
    assert client.segments(session_id)["segments"] == segments
    heard = list(client.session_events(session_id))
    assert heard[:-1] == segments
    assert [(segment["action"], segment["objects"]) for segment in segments[:1]] == [
        (None, {"object": "cup"})
    ]
    found = learned(client, client.learn(session_id, 0, "wave"))
    span = slice(segments[0]["start_seq"], segments[0]["end_seq"] + 1)
    assert found["action"] == "wave"
    assert found["trajectory"] == trajectory(
        motion.times[span], motion.hand[span], {"object": motion.objects["cup"][span]}
    )


@pytest.mark.usefixtures("worker")
def test_a_version_learns_from_what_the_last_one_recognised(
    client: GestaClient, model: str, sent: list[Sent]
) -> None:
    client.add_demonstrations(model, sent)
    first = client.result(client.train(model, options={"n_states": 4})["id"])["version"]
    with client.stream(model, geometry=MILLIMETRES) as stream:
        session_id = stream.state.started["session_id"]
        stream.send(MOTION.times, 1000 * MOTION.hand, {"object": 1000 * THING})
        segment = next(message for message in stream if message["type"] == "segment")
        live = client.learn(session_id, segment["segment"], "grasp")
        assert client.session(session_id)["state"] == "active"
        stream.end()
        *_, last = (message for message in stream if message["type"] == "segment")
    after = client.learn(session_id, last["segment"], "wave")
    again = client.learn(session_id, 0, "wave", start_seq=last["start_seq"], end_seq=last["end_seq"] - 1)
    ids = [*live["created"], *after["created"], *again["created"]]
    digests = [client.demonstration(model, id_)["digest"] for id_ in ids]
    second = client.result(client.train(model, options={"n_states": 4}, base=first)["id"])["version"]
    made = client.version(model, second)
    assert set(digests) == set(made["demonstrations"]) - set(client.version(model, first)["demonstrations"])
    assert made["actions"] == ["displace", "grasp", "push", "retract", "wave"]
    shown = client.demonstration(model, live["created"][0])
    span = slice(segment["start_seq"], segment["end_seq"] + 1)
    hand = np.array(shown["trajectory"]["hand"], dtype=np.float64)
    np.testing.assert_allclose(hand, MOTION.hand[span], atol=1e-12)
