"""Sessions over REST and as server-sent events, against the real server."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from time import monotonic
from typing import Any
from uuid import uuid4

import httpx
import numpy as np
import pytest

from app.api.schemas import TrajectorySent
from app.client import GestaClient
from app.motion.model import Model
from app.motion.simulation import recording
from app.registry import sessions
from app.registry.records import SessionState, StoredEvent
from app.service.geometry import Geometry
from app.service.uploads import read_trajectory
from tests.api.test_stream_resume import events
from tests.serving import Server
from tests.talking import Message, Talk, binary, checked, expected, talking

MOTION = recording(5, 5).trajectory
MILLIMETRES = {"length_unit": "mm", "up_axis": "y"}
pytestmark = pytest.mark.usefixtures("table_top")


def ask(server: Server, path: str, method: str = "GET", **options: Any) -> httpx.Response:
    return httpx.request(method, f"{server.url}/v1/sessions{path}", timeout=30, **options)


def streamed(server: Server, **start: Any) -> tuple[str, Talk]:
    """Stream the motion to its end; return the session's id and the talk."""
    with talking(server) as talk:
        session_id = talk.start(**start)["session_id"]
        talk.frames(MOTION)
        talk.say("end")
        talk.rest()
        return session_id, talk


def elsewhere(server: Server, **fields: Any) -> str:
    """Make an active session that lives in another process."""
    given: dict[str, Any] = {
        "id_": uuid4().hex,
        "model": "table-top",
        "version": 1,
        "token_hash": "",
        "artifact_digest": "",
        "geometry": {"length_unit": "m", "up_axis": "z"},
        "channels": ("t", *(f"{name}.{axis}" for name in ("hand", "object") for axis in "xyz")),
        "start": {"rate_hz": None, "table_height_m": 0.0},
    }
    with server.database.transaction() as tx:
        return sessions.create(tx, **{**given, **fields}).id


def add(server: Server, session_id: str, event: int, kind: str = "gap", ended: bool = False) -> Message:
    """Let the other process add an event."""
    message = {"type": kind, "event": event}
    with server.database.transaction() as tx:
        stored = StoredEvent(event, kind, json.dumps(message))
        over: SessionState = "ended" if ended else "active"
        sessions.append(tx, sessions.Addition(session_id, 0, 0, events=[stored], state=over))
    return message


class TestRecords:
    def test_a_session_tells_what_it_is(self, server: Server) -> None:
        session_id, talk = streamed(
            server, name="first", scene={"table_height_m": 0.01}, goals={"shelf": [0.5, 0, 1]}
        )
        told = ask(server, f"/{session_id}").json()
        times = [datetime.fromisoformat(told.pop(name)) for name in ("created_at", "last_seen_at")]
        assert told == {
            "id": session_id,
            "name": "first",
            "model": "table-top",
            "version": 1,
            "state": "ended",
            "geometry": {"length_unit": "m", "up_axis": "z"},
            "objects": ["object"],
            "rate_hz": None,
            "scene": {"table_height_m": 0.01},
            "goals": {"shelf": [0.5, 0.0, 1.0]},
            "frames": len(MOTION),
            "events": len(events(talk)),
            "segments": len(talk.said("segment")),
            "frames_kept": True,
        }
        assert times[0] <= times[1] <= datetime.now(UTC) < times[0] + timedelta(minutes=5)

    def test_sessions_are_listed_newest_first_by_state_and_name(self, server: Server) -> None:
        name = uuid4().hex
        over = [streamed(server, name=name)[0] for _ in range(2)]
        with talking(server) as talk:
            live = talk.start(name=name)["session_id"]
            listed = ask(server, f"?name={name}").json()
            assert [session["id"] for session in listed["sessions"]] == [live, *reversed(over)]
            assert listed["next_page_token"] is None
            active = ask(server, f"?name={name}&state=active").json()["sessions"]
            assert [session["id"] for session in active] == [live]
            ended = ask(server, f"?name={name}&state=ended&page_size=1").json()
            assert [session["id"] for session in ended["sessions"]] == [over[1]]
            rest = ask(server, f"?name={name}&state=ended&page_token={ended['next_page_token']}").json()
            assert [session["id"] for session in rest["sessions"]] == [over[0]]

    @pytest.mark.parametrize(
        ("path", "status", "code"),
        [
            ("?state=over", 422, "invalid"),
            ("?page_size=0", 422, "invalid"),
            ("?page_token=x", 422, "invalid_page_token"),
            ("/none", 404, "session_not_found"),
            ("/none/segments", 404, "session_not_found"),
            ("/none/recording", 404, "session_not_found"),
            ("/none/events", 404, "session_not_found"),
        ],
    )
    def test_what_cannot_be_asked_is_a_problem(
        self, server: Server, path: str, status: int, code: str
    ) -> None:
        answer = ask(server, path)
        assert (answer.status_code, answer.json()["code"]) == (status, code)
        assert answer.headers["Content-Type"] == "application/problem+json"

    def test_segments_are_those_of_the_stream(self, server: Server, trained: Model) -> None:
        session_id, talk = streamed(server)
        assert ask(server, f"/{session_id}/segments").json() == {"segments": talk.said("segment")}
        after = ask(server, f"/{session_id}/segments?after=1").json()["segments"]
        assert after == talk.said("segment")[2:]
        assert ask(server, f"/{session_id}/segments?after=99").json() == {"segments": []}
        assert ask(server, f"/{session_id}/segments?after=x").status_code == 422


class TestEnd:
    def test_a_live_session_is_ended_for_its_client_too(self, server: Server) -> None:
        with talking(server) as talk:
            session_id = talk.start()["session_id"]
            talk.frames(MOTION)
            talk.say("flush", id=0)
            talk.hear("flushed")
            told = ask(server, f"/{session_id}", "DELETE").json()
            talk.rest()
            assert talk.closed_with == 1000
            assert talk.heard[-1]["type"] == "ended"
        assert (told["state"], told["frames"]) == ("ended", len(MOTION))
        assert told["segments"] == talk.heard[-1]["segments"] == len(talk.said("segment"))
        assert ask(server, f"/{session_id}", "DELETE").json() == told

    def test_a_session_of_another_process_is_ended(self, server: Server) -> None:
        session_id = elsewhere(server)
        add(server, session_id, 0)
        assert ask(server, f"/{session_id}", "DELETE").json()["state"] == "ended"
        with GestaClient(server.url) as client:
            *_, last = client.session_events(session_id)
        assert last == {"type": "ended", "event": 1, "segments": 0, "frames": 0}
        assert checked(json.dumps(last))

    def test_an_unknown_session_cannot_be_ended(self, server: Server) -> None:
        answer = ask(server, "/none", "DELETE")
        assert (answer.status_code, answer.json()["code"]) == (404, "session_not_found")

    def test_a_live_session_that_another_process_has_ended_is_over(self, server: Server) -> None:
        """Its client is told as if it had been ended here, and nobody else harmed."""
        with talking(server) as talk, talking(server) as other:
            session_id = talk.start()["session_id"]
            other_id = other.start()["session_id"]
            with server.database.transaction() as tx:
                epoch = sessions.take_on(tx, session_id).epoch
                last = StoredEvent(0, "ended", '{"type":"ended","event":0,"segments":0,"frames":0}')
                sessions.append(tx, sessions.Addition(session_id, epoch, 0, events=[last], state="ended"))
            other.frames(MOTION, 0, 100)
            talk.frames(MOTION, 0, 100)
            assert talk.rest()[-1] == {"type": "ended", "event": 0, "segments": 0, "frames": 0}
            assert talk.closed_with == 1000
            other.say("end", last_seq=99)
            other.rest()
            assert other.closed_with == 1000
        assert ask(server, f"/{session_id}").json()["frames"] == 0
        assert ask(server, f"/{other_id}").json()["frames"] == 100


class TestRecording:
    def test_is_what_was_sent_in_metres_z_up(self, server: Server) -> None:
        hand = MOTION.hand.copy()
        hand[30:33] = np.nan
        rows = np.column_stack([MOTION.times, *map(in_millimetres, (hand, MOTION.objects["object"]))])
        with talking(server) as talk:
            session_id = talk.start(geometry=MILLIMETRES, encoding="f64")["session_id"]
            talk.socket.send(binary(0, rows))
            talk.say("end")
            talk.rest()
        answer = ask(server, f"/{session_id}/recording")
        assert answer.headers["Content-Type"] == "application/json"
        told = answer.json()
        trajectory = told.pop("trajectory")
        assert told == {
            "session": session_id,
            "model": "table-top",
            "version": 1,
            "geometry": {"length_unit": "m", "up_axis": "z"},
            "scene": {"table_height_m": 0.0},
        }
        assert trajectory["t"] == MOTION.times.tolist()
        assert trajectory["hand"][29:34].count(None) == 3
        whole = [position or [np.nan] * 3 for position in trajectory["hand"]]
        np.testing.assert_allclose(whole, hand, atol=1e-15)
        np.testing.assert_allclose(trajectory["objects"]["object"], MOTION.objects["object"], atol=1e-15)

    def test_can_be_uploaded_and_recognised_again(self, server: Server) -> None:
        session_id, talk = streamed(server, geometry={"length_unit": "m", "up_axis": "z"})
        trajectory = ask(server, f"/{session_id}/recording").json()["trajectory"]
        sent = TrajectorySent.model_validate_json(json.dumps(trajectory))
        motion = read_trajectory(sent.read(), Geometry())
        np.testing.assert_array_equal(motion.hand, MOTION.hand)
        np.testing.assert_array_equal(motion.times, MOTION.times)
        with GestaClient(server.url) as client:
            again = client.segment("table-top", 1, trajectory)["segments"]
        assert [segment["action"] for segment in again] == [s["action"] for s in talk.said("segment")]

    def test_of_a_stream_with_a_rate_has_times(self, server: Server) -> None:
        with talking(server) as talk:
            session_id = talk.start(rate_hz=50, objects=["a.x", "object"], encoding="f32")["session_id"]
            talk.socket.send(binary(0, np.ones((3, 9)), "<f4"))
            talk.say("end")
            talk.rest()
        trajectory = ask(server, f"/{session_id}/recording").json()["trajectory"]
        assert trajectory == {
            "t": [0.0, 0.02, 0.04],
            "hand": [[1.0] * 3] * 3,
            "objects": {"a.x": [[1.0] * 3] * 3, "object": [[1.0] * 3] * 3},
        }
        assert ask(server, f"/{session_id}").json()["objects"] == ["a.x", "object"]

    def test_of_a_session_without_frames_is_empty(self, server: Server) -> None:
        with talking(server) as talk:
            session_id = talk.start()["session_id"]
        trajectory = ask(server, f"/{session_id}/recording").json()["trajectory"]
        assert trajectory == {"t": [], "hand": [], "objects": {"object": []}}

    def test_of_many_frames_is_whole(self, server: Server) -> None:
        motion = recording(7, 60).trajectory
        assert len(motion) > 5000
        with talking(server) as talk:
            session_id = talk.start()["session_id"]
            talk.frames(motion, chunk=1000)
            talk.say("end")
            talk.rest()
        trajectory = ask(server, f"/{session_id}/recording").json()["trajectory"]
        assert trajectory["t"] == motion.times.tolist()
        assert trajectory["hand"] == motion.hand.tolist()

    def test_is_gone_once_it_is_no_longer_kept(self, server: Server) -> None:
        session_id, talk = streamed(server)
        with server.database.transaction() as tx:
            sessions.drop_frames(tx, last_seen_before=datetime.now(UTC))
        answer = ask(server, f"/{session_id}/recording")
        assert (answer.status_code, answer.json()["code"]) == (410, "recording_gone")
        assert not ask(server, f"/{session_id}").json()["frames_kept"]
        assert ask(server, f"/{session_id}/segments").json()["segments"] == talk.said("segment")


class TestEvents:
    def test_are_those_of_the_stream_with_their_ids(self, server: Server) -> None:
        session_id, talk = streamed(server)
        answer = ask(server, f"/{session_id}/events")
        assert answer.headers["Content-Type"].startswith("text/event-stream")
        blocks = [block.splitlines() for block in answer.text.split("\n\n") if block]
        assert [
            {
                "event": f"event: {message['type']}" in block,
                "id": f"id: {message['event']}" in block,
                "data": json.loads(next(line for line in block if line.startswith("data:"))[5:]),
            }
            for block, message in zip(blocks, events(talk), strict=True)
        ] == [{"event": True, "id": True, "data": message} for message in events(talk)]

    def test_last_event_id_goes_on(self, server: Server) -> None:
        session_id, talk = streamed(server)
        answer = ask(server, f"/{session_id}/events", headers={"Last-Event-ID": "2"})
        ids = [line for line in answer.text.splitlines() if line.startswith("id:")]
        assert ids == [f"id: {message['event']}" for message in events(talk)[3:]]

    def test_a_browser_need_not_come_back_to_what_has_ended(self, server: Server) -> None:
        session_id, talk = streamed(server)
        last = {"Last-Event-ID": str(events(talk)[-1]["event"])}
        assert ask(server, f"/{session_id}/events", headers=last).status_code == 204

    @pytest.mark.parametrize(
        ("headers", "query"), [({"Last-Event-ID": "x"}, ""), ({}, "?include=everything")]
    )
    def test_what_is_no_number_or_no_kind_is_refused(
        self, server: Server, headers: dict[str, str], query: str
    ) -> None:
        session_id = elsewhere(server)
        assert ask(server, f"/{session_id}/events{query}", headers=headers).status_code == 422

    def test_frames_and_hypotheses_are_heard_while_another_streams(
        self, server: Server, trained: Model
    ) -> None:
        with GestaClient(server.url) as client, talking(server) as talk:
            heard: list[tuple[float, Message]] = []
            began = monotonic()
            session_id = talk.start(options={"hypotheses": False})["session_id"]
            listener = client.session_events(session_id, include="frames,hypotheses")
            talk.frames(MOTION, 0, 100)
            while not {"frame", "hypothesis"} <= {message["type"] for _, message in heard}:
                talk.frames(MOTION, len(heard) + 100, len(heard) + 101)
                message = next(listener)
                heard.append((monotonic(), message))
            talk.frames(MOTION, len(heard) + 100)
            talk.say("end")
            heard += [(monotonic(), message) for message in listener]
        messages = [message for _, message in heard]
        durable = [message for message in messages if "event" in message]
        assert durable[:-1] == expected(trained, MOTION)
        assert messages[-1]["type"] == "ended"
        for frame in (message for message in messages if message["type"] == "frame"):
            seq = frame["seq"]
            assert frame["t"] == MOTION.times[seq]
            assert frame["hand"] == MOTION.hand[seq].tolist()
            assert frame["objects"] == {"object": MOTION.objects["object"][seq].tolist()}
        for guess in (message for message in messages if message["type"] == "hypothesis"):
            assert checked(json.dumps(guess))
        for kind in ("frame", "hypothesis"):
            count = sum(message["type"] == kind for message in messages)
            assert 1 <= count <= 20 * (heard[-1][0] - began) + 2

    def test_are_heard_from_another_process(self, server: Server) -> None:
        session_id = elsewhere(server)
        with GestaClient(server.url) as client:
            listener = client.session_events(session_id)
            for number in range(3):
                message = add(server, session_id, number)
                assert next(listener) == message
            add(server, session_id, 3, "ended", ended=True)
            assert [message["type"] for message in listener] == ["ended"]

    def test_begin_before_and_go_on_after_a_connection_is_lost(self, server: Server, trained: Model) -> None:
        with GestaClient(server.url) as client:
            with talking(server) as talk:
                started = talk.start()
                listener = client.session_events(started["session_id"])
                talk.frames(MOTION, 0, 400)
                heard = [next(listener)]
            resume = {
                "session_id": started["session_id"],
                "token": started["resume_token"],
                "last_event": -1,
            }
            with talking(server) as talk:
                next_seq = talk.start(resume=resume)["next_seq"]
                talk.frames(MOTION, next_seq)
                talk.say("end")
                talk.rest()
            heard += listener
        assert heard[:-1] == expected(trained, MOTION)


def in_millimetres(track: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return positions in millimetres, Y up."""
    return np.column_stack([track[:, 0], track[:, 2], -track[:, 1]]) * 1000.0
