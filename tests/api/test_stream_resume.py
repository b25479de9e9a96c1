"""A session outlives its connections: it goes on where it was, and every event is told."""

from __future__ import annotations

import asyncio
import socket
from contextlib import suppress

import pytest
from websockets.exceptions import ConnectionClosed

from app.motion.model import Model
from app.motion.simulation import recording
from tests.serving import Server
from tests.talking import METRES, Message, Talk, expected, talking

MOTION = recording(5, 5).trajectory
pytestmark = pytest.mark.usefixtures("table_top")


def resuming(started: Message, last_event: int) -> Message:
    """Return the fields that resume a session."""
    return {
        "session_id": started["session_id"],
        "token": started["resume_token"],
        "last_event": last_event,
    }


def cut(talk: Talk) -> None:
    """Break the connection without a word."""
    talk.socket.socket.shutdown(socket.SHUT_RDWR)
    talk.rest()
    assert talk.closed_with == 1006


def events(talk: Talk) -> list[Message]:
    return [message for message in talk.heard if "event" in message]


def test_goes_on_at_next_seq_and_tells_the_rest(server: Server, trained: Model) -> None:
    told = expected(trained, MOTION)
    with talking(server) as talk:
        started = talk.start()
        assert started["next_seq"] == 0
        talk.frames(MOTION, 0, 400)
        talk.say("flush", id=0)
        talk.hear("flushed")
        before = events(talk)
        cut(talk)
    assert 0 < len(before) < len(told)
    with talking(server) as talk:
        again = talk.start(resume=resuming(started, len(before) - 1))
        assert again["next_seq"] == 400
        assert again["session_id"] == started["session_id"]
        assert talk.hear("accepted")["through_seq"] == 399
        talk.frames(MOTION, 400)
        talk.say("end", last_seq=len(MOTION) - 1)
        talk.rest()
        assert [*before, *events(talk)][:-1] == told
        assert talk.closed_with == 1000


def test_frames_on_their_way_are_taken_or_sent_again(server: Server, trained: Model) -> None:
    """Whatever the server had of them when the connection broke, next_seq says how to go on."""
    with talking(server) as talk:
        started = talk.start()
        talk.frames(MOTION, 0, 300)
        cut(talk)
    with talking(server) as talk:
        next_seq = talk.start(resume=resuming(started, -1))["next_seq"]
        assert 0 <= next_seq <= 300
        talk.frames(MOTION, next_seq)
        talk.say("end")
        talk.rest()
        assert events(talk)[:-1] == expected(trained, MOTION)


def test_replays_what_came_after_the_last_event(server: Server, trained: Model) -> None:
    told = expected(trained, MOTION)
    with talking(server) as talk:
        started = talk.start()
        talk.frames(MOTION)
        talk.say("end")
        talk.rest()
        ended = events(talk)[-1]
    for last_event in range(-1, len(told) + 1):
        with talking(server) as talk:
            again = talk.start(resume=resuming(started, last_event))
            talk.rest()
            assert again["next_seq"] == len(MOTION)
            assert events(talk) == [*told, ended][last_event + 1 :]
            assert talk.closed_with == 1000


def test_many_events_are_replayed_from_the_database(server: Server) -> None:
    """More than a session keeps in memory: every other frame is a dropout."""
    motion = MOTION.part(0, 400)
    hand = motion.hand.copy()
    hand[1::2] = float("nan")
    with talking(server) as talk:
        started = talk.start()
        talk.frames(type(motion)(motion.times, hand, motion.objects), chunk=100)
        talk.say("end")
        talk.rest()
        told = events(talk)
        assert len(told) > 150
    with talking(server) as talk:
        talk.start(resume=resuming(started, 4))
        talk.rest()
        assert events(talk) == told[5:]


def test_the_newest_connection_has_the_session(server: Server, trained: Model) -> None:
    with talking(server) as first, talking(server) as second:
        started = first.start()
        first.frames(MOTION, 0, 100)
        first.say("flush", id=0)
        first.hear("flushed")
        second.start(resume=resuming(started, -1))
        closed_with, code, error = first.refused()
        assert (closed_with, code, error["retryable"]) == (4409, "taken_over", False)
        second.frames(MOTION, 100)
        second.say("end")
        second.rest()
        assert events(second)[:-1] == expected(trained, MOTION)


def test_the_encoding_may_change(server: Server, trained: Model) -> None:
    with talking(server) as talk:
        started = talk.start(encoding="f64", name="both")
        cut(talk)
    with talking(server) as talk:
        talk.start(encoding="json", resume=resuming(started, -1), options={"hypotheses": False})
        talk.frames(MOTION)
        talk.say("end")
        talk.rest()
        assert events(talk)[:-1] == expected(trained, MOTION)


def test_a_session_keeps_its_version(server: Server, trained: Model) -> None:
    with talking(server) as talk:
        started = talk.start()
        cut(talk)
    server.teach(trained)
    with talking(server) as talk:
        assert talk.start(resume=resuming(started, -1))["version"] == started["version"]


def test_many_connections_at_once_fight_for_one_session(server: Server) -> None:
    """One of them holds it in the end, the others are told; none is left waiting."""

    async def contend() -> list[int | None]:
        return await asyncio.gather(*(asyncio.to_thread(hold) for _ in range(6)))

    def hold() -> int | None:
        with talking(server) as talk:
            talk.say("start", model="table-top", geometry=METRES, resume=resuming(started, -1))
            with suppress(ConnectionClosed):
                talk.say("flush", id=0)
            message = talk.hear("flushed", "error")
            if message["type"] == "error":
                talk.rest()
            return talk.closed_with

    with talking(server) as talk:
        started = talk.start()
    codes = asyncio.run(contend())
    assert set(codes) <= {4409, None}
    assert None in codes
