"""More to do than time: nobody starves, and where time does not do the greediest have to wait."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from itertools import groupby
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI

from app.main import create_app
from app.motion.model import Model
from app.motion.simulation import recording
from app.registry.artifacts import dump_model
from app.registry.store import Store
from app.service.live import PATIENCE, Attachment, LiveSessions
from app.service.pulse import BEATS, Pulse
from app.service.session import BATCH, Session
from app.settings import Settings
from tests.api.test_stream_failures import teach
from tests.talking import METRES, Message, columns

MOTION = recording(5, 10).trajectory
START = {"type": "start", "model": "table-top", "geometry": METRES}
SCOPE = {"type": "websocket", "path": "/v1/stream", "headers": [], "query_string": b"", "subprotocols": []}


class Client:
    """A client in the same event loop: what it says is there before it is asked for."""

    def __init__(self, *messages: Message) -> None:
        self.incoming: asyncio.Queue[Message] = asyncio.Queue()
        self.heard: list[Message] = []
        self.code: int | None = None
        self.incoming.put_nowait({"type": "websocket.connect"})
        for message in messages:
            self.say(message)

    def say(self, message: Message) -> None:
        self.incoming.put_nowait({"type": "websocket.receive", "text": json.dumps(message)})

    async def send(self, message: Any) -> None:
        if message["type"] == "websocket.send":
            self.heard.append(json.loads(message["text"]))
        elif message["type"] == "websocket.close":
            self.code = message["code"]

    async def serve(self, app: FastAPI) -> None:
        await app(SCOPE, self.incoming.get, self.send)

    async def hear(self, kind: str) -> Message:
        while True:
            for message in self.heard:
                if message["type"] == kind:
                    return message
            await asyncio.sleep(0)


def with_app(folder: Path, model: Model, work: Callable[[FastAPI], Awaitable[None]]) -> None:
    """Let a server that knows a model work in this process."""
    store = folder / "store"
    app = create_app(Settings(database_url=f"sqlite:///{folder / 'gesta.db'}", store_url=str(store)))

    async def run() -> None:
        async with app.router.lifespan_context(app):
            teach(app.state.lab, model, Store(store).put(dump_model(model)))
            await work(app)

    asyncio.run(run())


def one_by_one(n_frames: int) -> list[Message]:
    return [{"type": "frames", **columns(MOTION, at, at + 1)} for at in range(n_frames)]


def test_a_flood_of_one_session_starves_no_other(
    tmp_path: Path, trained: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[tuple[str, int]] = []
    push = Session._push

    def noted(session: Session, rows: Any) -> None:
        taken.append((session.pinned.session_id, len(rows)))
        push(session, rows)

    monkeypatch.setattr(Session, "_push", noted)

    async def work(app: FastAPI) -> None:
        flood = Client(START, {"type": "frames", **columns(MOTION, 0, 600)})
        calm = Client(START, *one_by_one(200))
        serving = [asyncio.create_task(client.serve(app)) for client in (flood, calm)]
        await asyncio.gather(flood.hear("started"), calm.hear("started"))
        for client, last in ((flood, 599), (calm, 199)):
            client.say({"type": "end", "last_seq": last})
        await asyncio.gather(*serving)
        assert (flood.code, calm.code) == (1000, 1000)

    with_app(tmp_path, trained, work)
    ids = [session_id for session_id, _ in taken]
    one, other = dict.fromkeys(ids)
    begin = max(ids.index(one), ids.index(other))
    end = min(len(ids) - 1 - ids[::-1].index(each) for each in (one, other))
    runs = [list(run) for _, run in groupby(taken[begin:end], key=lambda each: each[0])]
    assert len(runs) > 20
    assert max(sum(n_rows for _, n_rows in run) for run in runs) <= 2 * BATCH


def test_the_least_of_some_looks_counts() -> None:
    looks: list[float] = []
    pulse = Pulse(lambda: looks.append(pulse.late))
    for late in [9.0, 0.0] + [0.5] * BEATS + [0.2, 0.0]:
        pulse.note(late)
    assert looks == [0.0] * (BEATS + 1) + [0.5, 0.2, 0.0]


def late(live: LiveSessions, seconds: float, n_beats: int = BEATS) -> None:
    """Let the event loop have been late for a while."""
    for _ in range(n_beats):
        live.pulse.note(seconds)


def holds(live: LiveSessions) -> list[Attachment]:
    return [place.attachment for place in live._places.values() if place.attachment is not None]


def test_where_time_does_not_do_nobody_is_taken_on(tmp_path: Path, trained: Model) -> None:
    async def work(app: FastAPI) -> None:
        live: LiveSessions = app.state.live
        late(live, 1.5 * live.limits.late)
        refused = Client(START, *one_by_one(5))
        await refused.serve(app)
        assert refused.code == 1013
        [error] = refused.heard
        assert (error["code"], error["retryable"]) == ("overloaded", True)
        late(live, 0.0)
        taken = Client(START, *one_by_one(5), {"type": "end", "last_seq": 4})
        await taken.serve(app)
        assert taken.code == 1000

    with_app(tmp_path, trained, work)


def test_the_greediest_leaves_and_goes_on_when_there_is_time(tmp_path: Path, trained: Model) -> None:
    async def work(app: FastAPI) -> None:
        live: LiveSessions = app.state.live
        calm, flood, idle = (Client(START) for _ in range(3))
        serving = []
        for client in (calm, flood, idle):
            serving.append(asyncio.create_task(client.serve(app)))
            await client.hear("started")
        live._beating.cancel()
        late(live, 3.0 * live.limits.late)
        for client, n_frames in ((calm, 10), (flood, 200)):
            for message in [*one_by_one(n_frames), {"type": "flush", "id": 1}]:
                client.say(message)
            await client.hear("flushed")
        late(live, 3.0 * live.limits.late, PATIENCE - 2)
        assert [hold.stays for hold in holds(live)] == [True, True, True]
        late(live, 3.0 * live.limits.late, 1)
        assert [hold.stays for hold in holds(live)] == [True, False, True]
        await serving[1]
        assert flood.code == 1013
        late(live, 0.0)
        started = await flood.hear("started")
        resume = {"session_id": started["session_id"], "token": started["resume_token"], "last_event": -1}
        again = Client({**START, "resume": resume})
        serving[1] = asyncio.create_task(again.serve(app))
        assert (await again.hear("started"))["next_seq"] == 200
        for client in (calm, again, idle):
            client.say({"type": "end"})
        await asyncio.gather(*serving)
        assert (calm.code, again.code, idle.code) == (1000, 1000, 1000)

    with_app(tmp_path, trained, work)


def test_sessions_that_send_nothing_stay(tmp_path: Path, trained: Model) -> None:
    async def work(app: FastAPI) -> None:
        live: LiveSessions = app.state.live
        clients = [Client(START) for _ in range(3)]
        serving = [asyncio.create_task(client.serve(app)) for client in clients]
        await asyncio.gather(*(client.hear("started") for client in clients))
        live._beating.cancel()
        late(live, 9.0, 3 * PATIENCE)
        assert [hold.stays for hold in holds(live)] == [True, True, True]
        for client in clients:
            client.say({"type": "end"})
        await asyncio.gather(*serving)

    with_app(tmp_path, trained, work)


def test_a_session_that_is_alone_stays(tmp_path: Path, trained: Model) -> None:
    async def work(app: FastAPI) -> None:
        live: LiveSessions = app.state.live
        alone = Client(START, *one_by_one(50))
        serving = asyncio.create_task(alone.serve(app))
        await alone.hear("started")
        live._beating.cancel()
        late(live, 9.0, 3 * PATIENCE)
        alone.say({"type": "end", "last_seq": 49})
        await serving
        assert alone.code == 1000

    with_app(tmp_path, trained, work)


def test_frames_that_come_at_once_are_taken_in_order(tmp_path: Path, trained: Model) -> None:
    async def work(app: FastAPI) -> None:
        messages = one_by_one(40)
        large = {"type": "frames", **columns(MOTION, 40, 140)}
        behind = [{"type": "frames", **columns(MOTION, at, at + 1)} for at in range(140, 180)]
        client = Client(START, *messages, large, *behind, {"type": "end", "last_seq": 179})
        await client.serve(app)
        assert client.code == 1000
        assert client.heard[-1]["frames"] == 180

    with_app(tmp_path, trained, work)
