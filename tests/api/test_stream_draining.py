"""The server goes away, in order or not: what it has acknowledged is kept."""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import threading
from pathlib import Path
from time import monotonic
from typing import Any

import httpx
import pytest

from app.client import GestaClient
from app.main import create_app
from app.motion.model import Model
from app.motion.simulation import recording
from app.registry import models, sessions
from app.service.live import Limits
from app.settings import Settings
from tests.api.conftest import Sent
from tests.serving import Server, serving
from tests.talking import Message, Talk, talking

MOTION = recording(5, 5).trajectory


def kept(server: Server, session_id: str) -> tuple[int, list[str]]:
    """Return how many frames and which events of a session are in the database."""
    with server.database.reading() as tx:
        record = sessions.get(tx, session_id)
        events = sessions.events(tx, session_id)
        chunks = sessions.chunks(tx, session_id)
    assert sum(chunk.n_frames for chunk in chunks) == record.n_frames
    assert len(events) == record.n_events
    return record.n_frames, [stored.type for stored in events]


def told(talk: Talk) -> list[str]:
    return [message["type"] for message in talk.heard if "event" in message]


def test_a_server_that_stops_lets_everybody_go_in_order(tmp_path: Path, trained: Model) -> None:
    with serving(tmp_path) as server, talking(server) as talk, talking(server) as idle:
        server.teach(trained)
        session_id = talk.start()["session_id"]
        idle.start()
        listened: list[str] = []
        begun = threading.Event()
        listener = threading.Thread(target=listen, args=(server, session_id, listened, begun))
        listener.start()
        assert begun.wait(10)
        talk.frames(MOTION, 0, 400)
        talk.hear("segment")
        server.terminate()
        began = monotonic()
        ends: list[list[Message]] = [talk.rest(), idle.rest()]
        for each, messages in zip((talk, idle), ends, strict=True):
            assert each.closed_with == 1012
            assert messages[-1]["code"] == "restarting"
            assert messages[-1]["retryable"]
            assert any(message["type"] == "going_away" for message in messages)
        listener.join()
        server.wait()
        assert monotonic() - began < 5
        frames, events = kept(server, session_id)
        assert frames >= talk.said("accepted")[-1]["through_seq"] + 1
        assert events == told(talk)
        assert "event: segment" in listened
        with pytest.raises(httpx.ConnectError):
            httpx.get(f"{server.url}/livez")


def listen(server: Server, session_id: str, lines: list[str], begun: threading.Event) -> None:
    """Listen to a session until the server ends the response."""
    with httpx.stream("GET", f"{server.url}/v1/sessions/{session_id}/events") as response:
        begun.set()
        lines += response.iter_lines()


def test_what_was_told_survives_a_kill(tmp_path: Path, trained: Model) -> None:
    with serving(tmp_path) as server, talking(server) as talk:
        server.teach(trained)
        session_id = talk.start()["session_id"]
        talk.frames(MOTION, 0, 400)
        talk.hear("segment")
        while talk.hear("accepted")["durable_seq"] < 100:
            pass
        server.process.send_signal(signal.SIGKILL)
        server.wait()
        talk.rest()
        frames, events = kept(server, session_id)
        assert frames >= talk.said("accepted")[-1]["durable_seq"] + 1
        assert events[: len(told(talk))] == told(talk)


def test_a_request_under_way_is_answered_and_who_watches_a_job_let_go(
    tmp_path: Path, sent: list[Sent]
) -> None:
    body = json.dumps({"name": "late", "objects": ["object"]}).encode()
    head = b"POST /v1/models HTTP/1.1\r\nHost: here\r\nContent-Type: application/json\r\n"
    head += b"Content-Length: %d\r\n\r\n" % len(body)
    with serving(tmp_path) as server, GestaClient(server.url) as client:
        client.create_model("table-top", ["object"])
        client.add_demonstrations("table-top", sent)
        watched = f"{server.url}/v1/jobs/{client.train('table-top')['id']}/events"
        address = "127.0.0.1", int(server.url.rpartition(":")[2])
        with socket.create_connection(address, 20) as under_way, httpx.stream("GET", watched) as watching:
            lines = watching.iter_lines()
            assert next(lines) == "event: job"
            under_way.sendall(head + body[:5])
            began = monotonic()
            server.terminate()
            list(lines)
            assert monotonic() - began < Limits().drain + 1
            under_way.sendall(body[5:])
            with under_way.makefile("rb") as answer:
                told = answer.read()
        assert told.startswith(b"HTTP/1.1 201")
        assert b"connection: close" in told
        server.wait()
        assert monotonic() - began < Limits().drain + 1
        with server.database.reading() as tx:
            assert models.get(tx, "late").objects == ("object",)


def test_one_call_drains_the_server_from_its_own_machine_only(tmp_path: Path, trained: Model) -> None:
    with serving(tmp_path) as server, talking(server) as talk:
        server.teach(trained)
        talk.start()
        drain = f"{server.url}/v1/server:drain"
        for headers in ({"X-Forwarded-For": "203.0.113.7"}, {"Origin": "http://elsewhere.example"}):
            refused = httpx.post(drain, headers=headers)
            assert (refused.status_code, refused.json()["code"]) == (403, "loopback_only")
        talk.say("ping", id=1)
        talk.hear("pong")
        answer = httpx.post(drain)
        assert (answer.status_code, answer.json()) == (202, {"state": "draining"})
        assert talk.rest()[-1]["code"] == "restarting"
        assert talk.said("going_away")
        assert talk.closed_with == 1012
        assert server.wait() == 0


def test_who_comes_while_the_server_goes_is_sent_away_with_a_problem(tmp_path: Path) -> None:
    settings = Settings(database_url=f"sqlite:///{tmp_path / 'gesta.db'}", store_url=str(tmp_path / "store"))
    app = create_app(settings)
    sent: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        return {"type": "websocket.connect"}

    async def send(message: Any) -> None:
        sent.append(message)

    async def run() -> tuple[httpx.Response, httpx.Response]:
        async with app.router.lifespan_context(app):
            await app.state.live.drain()
            scope = {
                "type": "websocket",
                "path": "/v1/stream",
                "headers": [],
                "query_string": b"",
                "subprotocols": ["gesta.v1"],
                "extensions": {"websocket.http.response": {}},
            }
            await app(scope, receive, send)
            transport = httpx.ASGITransport(app)
            async with httpx.AsyncClient(transport=transport, base_url="http://here") as client:
                return await client.get("/readyz"), await client.get("/livez")

    ready, alive = asyncio.run(run())
    assert (ready.status_code, ready.json()["sessions"]) == (503, "draining")
    assert alive.status_code == 200
    start, body = sent
    headers = dict(start["headers"])
    assert (start["type"], start["status"]) == ("websocket.http.response.start", 503)
    assert headers[b"content-type"] == b"application/problem+json"
    assert headers[b"retry-after"] == b"1"
    assert json.loads(body["body"])["code"] == "restarting"
