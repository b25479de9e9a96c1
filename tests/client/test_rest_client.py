"""The REST clients against the real server."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from app.client import ApiError, AsyncGestaClient, GestaClient, JobFailed, trajectory
from app.client.answers import Recording
from app.client.requests import page_path
from app.client.server_events import EventLines, Listening, ServerEvent
from app.motion.model import Model
from app.motion.simulation import recording
from app.registry import jobs
from tests.client.cutting import Wire, wire_to
from tests.serving import Server
from tests.talking import Message, expected

MOTION = recording(5, 5).trajectory


@pytest.fixture
def wire(server: Server) -> Iterator[Wire]:
    with wire_to(server) as wire:
        yield wire


def streamed(client: GestaClient, name: str | None = None) -> str:
    """Stream the motion and return the session's id."""
    with client.stream("table-top", name=name, options={"hypotheses": False}) as stream:
        stream.send(MOTION.times, MOTION.hand, MOTION.objects)
        stream.end()
        *_, ended = stream
        assert ended["type"] == "ended"
        return str(stream.state.started["session_id"])


@pytest.mark.usefixtures("table_top")
class TestSessions:
    def test_what_the_stream_found_can_be_asked_for(self, server: Server, trained: Model) -> None:
        with GestaClient(server.url) as client:
            session_id = streamed(client)
            told = expected(trained, MOTION)
            assert client.session(session_id)["segments"] == len(told)
            assert client.segments(session_id)["segments"] == told
            assert client.segments(session_id, after=1)["segments"] == told[2:]
            assert list(client.session_events(session_id, after=0))[:-1] == told[1:]
            assert list(client.session_events(session_id, after=len(told))) == []
            motion = trajectory(MOTION.times, MOTION.hand, MOTION.objects)
            assert client.recording(session_id)["trajectory"] == motion
            assert client.end_session(session_id)["state"] == "ended"

    def test_events_are_heard_to_the_end_over_a_way_that_breaks(
        self, server: Server, wire: Wire, trained: Model
    ) -> None:
        with (
            GestaClient(server.url) as client,
            GestaClient(wire.url) as listener,
            client.stream("table-top") as stream,
        ):
            events = listener.session_events(stream.state.started["session_id"])
            heard: list[Message] = []
            for begin in range(0, len(MOTION), 150):
                part = MOTION.part(begin, min(begin + 150, len(MOTION)))
                stream.send(part.times, part.hand, part.objects)
            stream.flush()
            heard.append(next(events))
            wire.cut()
            stream.end()
            heard += events
        assert heard[:-1] == expected(trained, MOTION)
        assert heard[-1]["type"] == "ended"

    def test_a_listener_gives_up_in_the_end(self, server: Server, wire: Wire) -> None:
        with (
            GestaClient(server.url) as client,
            GestaClient(wire.url) as listener,
            client.stream("table-top") as stream,
            wire.broken(),
        ):
            session_id = stream.state.started["session_id"]
            with pytest.raises(httpx.TransportError):
                list(listener.session_events(session_id, patience_s=0))

    def test_an_unknown_session_is_no_session(self, server: Server) -> None:
        with GestaClient(server.url) as client:
            for ask in (client.session, client.segments, client.recording, client.end_session):
                with pytest.raises(ApiError) as refused:
                    ask("none")
                assert (refused.value.status, refused.value.code) == (404, "session_not_found")
            with pytest.raises(ApiError) as refused:
                list(client.session_events("none"))
            assert refused.value.code == "session_not_found"

    def test_pages_go_on_to_the_end(self, server: Server) -> None:
        with GestaClient(server.url) as client:
            ids = {streamed(client, "many") for _ in range(3)}
            listed = list(client.pages("/sessions?name=many&page_size=1", "sessions"))
        assert len(listed) == 3
        assert {session["id"] for session in listed} == ids


class TestJobs:
    """The job has no worker: the test itself ends it, while the way to the server is cut."""

    def test_a_result_is_waited_for_over_a_way_that_breaks(
        self, server: Server, wire: Wire, table_top: str
    ) -> None:
        with GestaClient(server.url) as client, GestaClient(wire.url) as waiting:
            job = segmentation(client, table_top)

            def end(seen: Message) -> None:
                if seen["state"] == "queued":
                    with wire.broken():
                        succeed(server, job["id"])

            assert waiting.result(job["id"], end) == {"segments": []}

    def test_one_that_cannot_be_had_is_given_up_in_the_end(
        self, server: Server, wire: Wire, table_top: str
    ) -> None:
        with GestaClient(server.url) as client, GestaClient(wire.url) as waiting:
            job = segmentation(client, table_top)
            with wire.broken(), pytest.raises(httpx.TransportError):
                waiting.result(job["id"], patience_s=0)
            client.cancel(job["id"])
            with pytest.raises(JobFailed, match="cancelled"):
                waiting.result(job["id"])

    def test_for_asyncio_too(self, server: Server, wire: Wire, table_top: str) -> None:
        async def run() -> Message:
            async with AsyncGestaClient(server.url) as client, AsyncGestaClient(wire.url) as waiting:
                motion = trajectory(MOTION.times, MOTION.hand, MOTION.objects)
                job = await client.segment(table_top, 1, motion, as_job=True)

                def end(seen: Message) -> None:
                    if seen["state"] == "queued":
                        with wire.broken():
                            succeed(server, job["id"])

                return await waiting.result(job["id"], end)

        assert asyncio.run(run()) == {"segments": []}


def segmentation(client: GestaClient, model: str) -> Message:
    motion = trajectory(MOTION.times, MOTION.hand, MOTION.objects)
    job = client.segment(model, 1, motion, as_job=True)
    assert job["state"] == "queued"
    return job


def succeed(server: Server, job_id: str) -> None:
    """End a job as a worker does."""
    with server.database.transaction() as tx:
        job = jobs.start(tx, job_id, "test")
        jobs.succeed(tx, job_id, job.attempt, {"segments": []})


class TestAsyncClient:
    def test_asks_the_same(self, server: Server, table_top: str, trained: Model) -> None:
        async def run() -> tuple[str, list[Message], Recording]:
            async with AsyncGestaClient(server.url) as client:
                async with client.stream(table_top, name="async") as stream:
                    session_id = stream.state.started["session_id"]
                    events = client.session_events(session_id)
                    await stream.send(MOTION.times, MOTION.hand, MOTION.objects)
                    await stream.end()
                    heard = [event async for event in events]
                assert [s["id"] async for s in client.pages("/sessions?name=async", "sessions")] == [
                    session_id
                ]
                assert (await client.version(table_top))["version"] == 1
                with pytest.raises(ApiError):
                    await client.session("none")
                with pytest.raises(ApiError):
                    await client.result("none")
                return session_id, heard, await client.recording(session_id)

        session_id, heard, recorded = asyncio.run(run())
        assert heard[:-1] == expected(trained, MOTION)
        assert recorded["session"] == session_id
        assert len(recorded["trajectory"]["t"]) == len(MOTION)

    def test_hears_on_over_a_way_that_breaks(
        self, server: Server, wire: Wire, table_top: str, trained: Model
    ) -> None:
        async def run() -> list[Message]:
            async with (
                AsyncGestaClient(server.url) as client,
                AsyncGestaClient(wire.url) as listener,
                client.stream(table_top) as stream,
            ):
                events = listener.session_events(stream.state.started["session_id"])
                await stream.send(MOTION.times, MOTION.hand, MOTION.objects)
                heard = [await anext(events)]
                with wire.broken():
                    await stream.end()
                return heard + [event async for event in events]

        assert asyncio.run(run())[:-1] == expected(trained, MOTION)


class TestParts:
    def test_both_clients_have_the_same_methods(self) -> None:
        def public(kind: type) -> set[str]:
            return {name for name in dir(kind) if not name.startswith("_")}

        assert public(GestaClient) == public(AsyncGestaClient)

    def test_names_are_quoted_in_paths(self) -> None:
        asked: list[tuple[str, str]] = []

        class Asking(GestaClient):
            def request(self, method: str, path: str, body: Any = None, headers: Any = None) -> Any:
                asked.append((method, path))
                return {}

        with Asking() as client:
            client.generate("a b", "latest", "put/back?", [0, 0, 0], [0, 0, 1])
            client.cancel("../models/x")
        assert asked == [
            ("POST", "/models/a%20b/versions/latest/actions/put%2Fback%3F/trajectories"),
            ("DELETE", "/jobs/..%2Fmodels%2Fx"),
        ]

    def test_a_page_token_joins_the_query(self) -> None:
        assert page_path("/jobs", None) == "/jobs"
        assert page_path("/jobs", "a=") == "/jobs?page_token=a%3D"
        assert page_path("/jobs?state=queued", "b") == "/jobs?state=queued&page_token=b"

    def test_lines_become_events(self) -> None:
        lines = EventLines()
        text = [
            ": keep-alive",
            "",
            "id: 3",
            "event: segment",
            'data: {"a":',
            'data: "b: c"}',
            "",
            "data:1",
            "",
            "",
        ]
        events = [event for event in map(lines.feed, text) if event is not None]
        assert events == [ServerEvent("segment", {"a": "b: c"}, "3"), ServerEvent("message", 1, None)]

    def test_a_listener_knows_where_it_is(self) -> None:
        listening = Listening(after=1, patience_s=10.0)
        listening.begin(100.0)
        assert listening.headers == {"Last-Event-ID": "1"}
        assert listening.hear(ServerEvent("gap", {"event": 2}, "2"), 105.0) == {"event": 2}
        listening.hear(ServerEvent("frame", {}, None), 106.0)
        assert (listening.last, listening.ended) == (2, False)
        assert not listening.tired(116.0)
        assert listening.tired(116.5)
        assert not listening.over({"state": "active", "events": 3})
        assert not listening.over({"state": "ended", "events": 4})
        assert listening.over({"state": "expired", "events": 3})
        listening.hear(ServerEvent("ended", {}, "3"), 120.0)
        assert listening.ended
