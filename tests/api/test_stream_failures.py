"""Where the server itself fails, a client is told so, and the session is given up in order."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from app.main import create_app
from app.motion.model import Model
from app.motion.simulation import recording
from app.registry import models, versions
from app.registry.artifacts import dump_model
from app.registry.store import Store
from app.service.journal import Entry
from app.service.lab import Lab
from app.service.session_store import SessionStore
from app.settings import Settings
from tests.talking import METRES, Message, checked, columns

MOTION = recording(5, 5).trajectory


def teach(lab: Lab, model: Model, digest: str) -> None:
    with lab.database.transaction() as tx:
        models.create(tx, name="table-top", objects=model.features.objects)
        versions.register(
            tx,
            "table-top",
            artifact_digest=digest,
            actions=model.names,
            options={},
            demonstrations=[],
            library_versions={},
        )


def converse(folder: Path, model: Model, digest: str) -> tuple[list[Message], int, Lab]:
    """Start, send frames and hear the answer; return the messages, the close code and the lab."""
    database_url, store_url = f"sqlite:///{folder / 'gesta.db'}", str(folder / "store")
    app = create_app(Settings(database_url=database_url, store_url=store_url))
    incoming: asyncio.Queue[Message] = asyncio.Queue()
    heard: list[Message] = []
    codes: list[int] = []

    async def send(message: Any) -> None:
        if message["type"] == "websocket.send":
            heard.append(checked(message["text"]))
        elif message["type"] == "websocket.close":
            codes.append(message["code"])

    async def run() -> Lab:
        async with app.router.lifespan_context(app):
            lab: Lab = app.state.lab
            teach(lab, model, digest)
            start = {"type": "start", "model": "table-top", "geometry": METRES}
            frames = {"type": "frames", **columns(MOTION, 0, 100)}
            incoming.put_nowait({"type": "websocket.connect"})
            for message in (start, frames):
                incoming.put_nowait({"type": "websocket.receive", "text": json.dumps(message)})
            scope = {
                "type": "websocket",
                "path": "/v1/stream",
                "headers": [],
                "query_string": b"",
                "subprotocols": [],
            }
            await app(scope, incoming.get, send)
            return lab

    lab = asyncio.run(run())
    [code] = codes
    return heard, code, lab


@pytest.fixture
def digest(tmp_path: Path, trained: Model) -> str:
    return Store(tmp_path / "store").put(dump_model(trained))


def test_a_failure_is_told_without_its_cause(
    tmp_path: Path, trained: Model, digest: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise ZeroDivisionError("secret")

    monkeypatch.setattr("app.service.session.settle", fails)
    heard, code, lab = converse(tmp_path, trained, digest)
    assert code == 1011
    assert (heard[-1]["code"], heard[-1]["retryable"]) == ("internal", True)
    assert "secret" not in json.dumps(heard)
    session_id = heard[0]["session_id"]
    store = SessionStore(lab)
    assert store.get(session_id).state == "ended"
    assert [stored.type for stored in store.events(session_id, -1)] == ["ended"]


def test_a_database_that_fails_is_told(
    tmp_path: Path, trained: Model, digest: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write(self: SessionStore, entries: Sequence[Entry]) -> None:
        raise OSError("the disk is full")

    monkeypatch.setattr(SessionStore, "write", write)
    heard, code, _ = converse(tmp_path, trained, digest)
    assert code == 1011
    assert heard[-1]["code"] == "write_failed"
    assert all(message["durable_seq"] == -1 for message in heard if message["type"] == "accepted")
    assert not any("event" in message for message in heard)


def test_an_artifact_that_is_lost_is_the_servers_fault(tmp_path: Path, trained: Model) -> None:
    heard, code, lab = converse(tmp_path, trained, f"sha256:{'0' * 64}")
    assert (code, heard[-1]["code"]) == (1011, "internal")
    with lab.database.reading() as tx:
        assert models.get(tx, "table-top").name == "table-top"
