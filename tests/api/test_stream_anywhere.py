"""A session goes on in any process: after a kill, on another server, back again; its events stay the same."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from itertools import cycle, pairwise
from pathlib import Path

import httpx
import pytest
import sqlalchemy as sa
from websockets.exceptions import ConnectionClosed

from app.motion.model import Model
from app.motion.simulation import Conditions, recording
from app.registry import models, sessions, tables
from tests.api.test_stream_resume import events, resuming
from tests.serving import Server, serving
from tests.talking import Message, Talk, expected, talking

MOTION = recording(6, 18, Conditions(gap_share=1.0)).trajectory


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def servers(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, trained: Model
) -> Iterator[list[Server]]:
    """Two servers on one database, of either kind, and one store; they know a model."""
    folder, url = tmp_path_factory.mktemp("servers"), None
    if request.param == "postgresql":
        make: Callable[[], str] = request.getfixturevalue("new_postgresql_database")
        url = make()
    with ExitStack() as stack:
        both = [stack.enter_context(serving(folder, database_url=url)) for _ in range(2)]
        both[0].teach(trained)
        yield both


def send(talk: Talk, start: int, stop: int) -> None:
    """Send frames and wait until all is processed."""
    talk.frames(MOTION, start, stop)
    talk.say("flush", id=0)
    talk.hear("flushed")


def last(told: list[Message]) -> int:
    return len(told) - 1


def finish(talk: Talk, start: int) -> list[Message]:
    """Send the frames that are left and the end; return what durable events were heard."""
    talk.frames(MOTION, start)
    talk.say("end", last_seq=len(MOTION) - 1)
    talk.rest()
    assert talk.closed_with == 1000
    return events(talk)


def test_a_killed_server_takes_nothing_with_it(tmp_path: Path, database_url: str, trained: Model) -> None:
    told = list[Message]()
    with serving(tmp_path, database_url=database_url) as server:
        server.teach(trained)
        with talking(server) as talk:
            started = talk.start()
            talk.frames(MOTION, 0, 700)
            while talk.hear("accepted")["durable_seq"] < 600:
                pass
            talk.frames(MOTION, 700, 900)
            server.process.send_signal(signal.SIGKILL)
            talk.rest()
            told += events(talk)
            durable = talk.said("accepted")[-1]["durable_seq"]
    with serving(tmp_path, database_url=database_url) as server, talking(server) as talk:
        again = talk.start(resume=resuming(started, last(told)))
        assert again["next_seq"] > durable
        told += finish(talk, again["next_seq"])
    assert told[:-1] == expected(trained, MOTION)


def test_the_newest_connection_has_the_session_on_whatever_server(
    servers: list[Server], trained: Model
) -> None:
    """Back and forth between two servers, while the connections of before are still open."""
    cuts = [*range(0, len(MOTION), 150), len(MOTION)]
    told, started = list[Message](), Message()
    with ExitStack() as stack:
        former: Talk | None = None
        for server, (start, stop) in zip(cycle(servers), pairwise(cuts), strict=False):
            talk = stack.enter_context(talking(server))
            again = talk.start(resume=resuming(started, last(told)) if started else None)
            started = started or again
            assert again["next_seq"] == start
            if former is not None:
                with suppress(ConnectionClosed):  # where it was told before
                    former.frames(MOTION, start, start + 50)
                assert former.refused()[:2] == (4409, "taken_over")
            send(talk, start, stop)
            told += events(talk)
            former = talk
        assert former is not None
        former.say("end", last_seq=len(MOTION) - 1)
        told = [*told, *(message for message in former.rest() if "event" in message)]
    assert told[:-1] == expected(trained, MOTION)
    assert [message["event"] for message in told] == list(range(len(told)))


def test_a_silent_connection_is_told_too(servers: list[Server]) -> None:
    with talking(servers[0]) as first, talking(servers[1]) as second:
        started = first.start()
        second.start(resume=resuming(started, -1))
        assert first.refused()[:2] == (4409, "taken_over")


def test_what_the_checkpoint_saw_is_not_needed_again(servers: list[Server], trained: Model) -> None:
    with talking(servers[0]) as talk:
        started = talk.start()
        for start in range(0, 1400, 100):
            send(talk, start, start + 100)
        told = events(talk)
    frames = tables.session_frames
    with servers[0].database.transaction() as tx:
        checkpoint = sessions.checkpoint(tx, started["session_id"])
        assert checkpoint is not None
        assert 900 <= checkpoint.n_frames <= 1400
        before = frames.c.first_seq < checkpoint.n_frames - 100
        tx.execute(sa.delete(frames).where(frames.c.session_id == started["session_id"], before))
    with talking(servers[1]) as talk:
        again = talk.start(resume=resuming(started, last(told)))
        assert again["next_seq"] == 1400
        told += finish(talk, 1400)
    assert told[:-1] == expected(trained, MOTION)


@pytest.mark.parametrize("state", [b"", b"no state at all", None])
def test_a_checkpoint_that_is_none_does_no_harm(
    servers: list[Server], trained: Model, state: bytes | None
) -> None:
    """Neither does one of another release: all frames are seen again."""
    with talking(servers[0]) as talk:
        started = talk.start()
        send(talk, 0, 1000)
        told = events(talk)
    checkpoints = tables.session_checkpoints
    with servers[0].database.transaction() as tx:
        if state is None:
            tx.execute(sa.delete(checkpoints))
        else:
            tx.execute(sa.update(checkpoints).values(state=state))
    with talking(servers[1]) as talk:
        talk.start(resume=resuming(started, last(told)))
        told += finish(talk, 1000)
    assert told[:-1] == expected(trained, MOTION)


def test_a_session_is_ended_from_another_server_with_all_that_it_decides(
    servers: list[Server], trained: Model
) -> None:
    with talking(servers[0]) as talk:
        session_id = talk.start()["session_id"]
        send(talk, 0, 800)
        answer = httpx.delete(f"{servers[1].url}/v1/sessions/{session_id}", timeout=20)
        assert (answer.status_code, answer.json()["state"]) == (200, "ended")
        talk.rest()
        assert talk.closed_with == 1000
        assert events(talk)[:-1] == expected(trained, MOTION.part(0, 800))
        assert events(talk)[-1]["type"] == "ended"


def test_one_that_has_ended_is_told_by_any_server(servers: list[Server]) -> None:
    with talking(servers[0]) as talk:
        started = talk.start()
        told = finish(talk, 0)
    with talking(servers[1]) as talk:
        assert talk.start(resume=resuming(started, 0))["next_seq"] == len(MOTION)
        talk.rest()
        assert events(talk) == told[1:]
        assert talk.closed_with == 1000
    path = f"/v1/sessions/{started['session_id']}/events?include=frames,hypotheses"
    listened = httpx.get(servers[1].url + path, timeout=20).text
    assert [json.loads(line[6:]) for line in listened.splitlines() if line.startswith("data: ")] == told


def test_a_wrong_token_or_start_throws_nobody_out(servers: list[Server]) -> None:
    with talking(servers[0]) as first:
        started = first.start()
        for change, code in (({"token": "wrong"}, 4403), ({"last_event": 7}, 4422)):
            with talking(servers[1]) as second:
                second.say(
                    "start",
                    model="table-top",
                    geometry={"length_unit": "m", "up_axis": "z"},
                    resume={**resuming(started, -1), **change},
                )
                assert second.refused()[0] == code
        send(first, 0, 100)


def test_a_session_keeps_its_version_when_the_model_is_gone(servers: list[Server], trained: Model) -> None:
    servers[0].teach(trained, "short-lived")
    with talking(servers[0]) as talk:
        started = talk.start("short-lived")
        send(talk, 0, 300)
        told = events(talk)
    with servers[0].database.transaction() as tx:
        models.delete(tx, "short-lived")
    with talking(servers[1]) as talk:
        talk.start("short-lived", resume=resuming(started, last(told)))
        told += finish(talk, 300)
    assert [{**message, "model": "table-top"} for message in told[:-1] if "model" in message] == [
        message for message in expected(trained, MOTION) if "model" in message
    ]
