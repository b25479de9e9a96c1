"""What a client may not ask of the server: each limit is told by name and harms nobody else."""

from __future__ import annotations

import json
import select
import socket
from collections.abc import Iterator
from datetime import UTC, datetime
from urllib.parse import urlsplit

import httpx
import pytest
import sqlalchemy as sa
from websockets.frames import Frame, Opcode
from websockets.sync.client import connect

from app.client import GestaClient
from app.motion.model import Model
from app.motion.simulation import recording
from app.registry import tables
from app.service.live import Limits
from tests.api.test_stream_resume import cut, events, resuming
from tests.serving import Server, serving
from tests.talking import METRES, Message, Talk, expected, talking

MOTION = recording(5, 5).trajectory
LIMITS = Limits(
    idle=2.0, send=0.5, resume=0.5, keep_alive=0.2, sessions=3, message_bytes=20_000, message_frames=50
)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server with little patience and room."""
    with serving(tmp_path_factory.mktemp("limits"), LIMITS) as running:
        yield running


pytestmark = pytest.mark.usefixtures("table_top")


def test_limits_are_told_and_kept(server: Server) -> None:
    with talking(server) as talk:
        assert talk.start()["limits"] == {
            "max_frame_bytes": 20_000,
            "max_frames_per_message": 50,
            "max_unacked_frames": 10_000,
        }
        talk.frames(MOTION, 0, 51, chunk=51)
        assert talk.refused()[:2] == (1009, "too_big")


def test_the_size_of_a_message_is_counted_in_bytes(server: Server) -> None:
    with talking(server) as talk:
        talk.start()
        talk.socket.send(json.dumps({"type": "ping", "id": "\u20ac" * 9000}, ensure_ascii=False))
        assert talk.refused()[:2] == (1009, "too_big")


def test_who_says_nothing_is_let_go(server: Server) -> None:
    with talking(server) as silent:
        closed_with, code, error = silent.refused()
        assert (closed_with, code, error["retryable"]) == (4408, "idle", False)


def test_who_stops_talking_is_let_go_and_can_come_back(server: Server, trained: Model) -> None:
    with talking(server) as talk:
        started = talk.start()
        talk.frames(MOTION, 0, 100)
        assert talk.refused()[:2] == (4408, "idle")
    with talking(server) as talk:
        assert talk.start(resume=resuming(started, -1))["next_seq"] == 100
        talk.frames(MOTION, 100)
        talk.say("end")
        talk.rest()
        assert events(talk)[:-1] == expected(trained, MOTION)


def test_a_session_that_nobody_comes_back_to_is_ended(server: Server, trained: Model) -> None:
    with talking(server) as talk:
        started = talk.start()
        talk.frames(MOTION)
        talk.say("flush", id=0)
        talk.hear("flushed")
        cut(talk)
    with GestaClient(server.url) as client:
        heard = list(client.session_events(started["session_id"]))
        told = expected(trained, MOTION)
        n = len(told)
        assert heard[:-1] == told
        assert heard[-1] == {"type": "ended", "event": n, "segments": n, "frames": len(MOTION)}
        assert client.session(started["session_id"])["state"] == "ended"
    with server.database.transaction() as tx:
        long_ago = datetime(2026, 1, 1, tzinfo=UTC)
        tx.execute(sa.update(tables.sessions).values(last_seen_at=long_ago))
    with talking(server) as talk:
        talk.say("start", model="table-top", geometry=METRES, resume=resuming(started, -1))
        closed_with, code, error = talk.refused()
        assert (closed_with, code, error["retryable"]) == (4410, "session_gone", False)


def test_there_is_room_for_so_many_sessions(server: Server) -> None:
    with talking(server) as one, talking(server) as two, talking(server) as three:
        first = one.start()
        two.start()
        three.start()
        with talking(server) as four:
            four.say("start", model="table-top", geometry=METRES)
            closed_with, code, error = four.refused()
            assert (closed_with, code, error["retryable"]) == (1013, "overloaded", True)
        cut(one)
        with talking(server) as five:
            self_ended(server, first, five)


def self_ended(server: Server, first: Message, talk: Talk) -> None:
    """Start a session in the place of one that waits, which is ended for it."""
    talk.start()
    with GestaClient(server.url) as client:
        assert [event["type"] for event in client.session_events(first["session_id"])] == ["ended"]


def test_a_reader_that_stops_harms_only_itself(server: Server, trained: Model) -> None:
    """It sends pings and reads no pong: it is told so if it reads again, and is closed with 4429."""
    place = urlsplit(server.url)
    with socket.socket() as narrow:
        narrow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        narrow.connect((place.hostname, place.port))
        with connect(server.stream_url, sock=narrow, compression=None, max_queue=1) as connection:
            slow = Talk(connection)
            slow.start(options={"hypotheses": False})
            sent = flood(narrow, json.dumps({"type": "ping", "id": "x" * 200}))
            with talking(server) as talk:
                talk.start()
                talk.frames(MOTION)
                talk.say("end")
                talk.rest()
                assert events(talk)[:-1] == expected(trained, MOTION)
            closed_with, code, error = slow.refused()
            assert (closed_with, code, error["retryable"]) == (4429, "not_reading", True)
            assert 0 < len(slow.said("pong")) < sent


def flood(connection: socket.socket, text: str) -> int:
    """Send a text until nobody takes any more for a second; return how often."""
    frame = Frame(Opcode.TEXT, text.encode()).serialize(mask=True)
    sent = 0
    while select.select([], [connection], [], 1.0)[1]:
        sent += connection.send(frame * 100, socket.MSG_DONTWAIT)
    return sent // len(frame)


def test_a_listener_hears_that_the_connection_lives(server: Server) -> None:
    with talking(server) as talk:
        session_id = talk.start()["session_id"]
        with httpx.stream("GET", f"{server.url}/v1/sessions/{session_id}/events") as response:
            assert next(response.iter_lines()) == ": keep-alive"
