"""A client that listens to a session by server-sent events, and comes back with ``Last-Event-ID``."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator

import httpx

from tests.chaos.caller import Caller
from tests.chaos.told import Told
from tests.talking import Message

RETRY_S = 0.05
SILENCE_S = 20.0
"""The server says something more often than this [s]."""


def heard(caller: Caller, session_id: str) -> list[Message]:
    """Return the durable events of a session that has ended, as far as they come in reasonable time."""
    leaving = threading.Event()
    timer = threading.Timer(caller.patience, leaving.set)
    timer.start()
    try:
        return list(listening(caller, session_id, leaving))
    finally:
        timer.cancel()


def listening(caller: Caller, session_id: str, leaving: threading.Event) -> Iterator[Message]:
    """Yield the durable events as they come, each once, until ``ended``."""
    last = -1
    while not leaving.is_set():
        headers = {"Last-Event-ID": str(last)}
        try:
            with caller.stream(f"/sessions/{session_id}/events", headers, SILENCE_S) as answer:
                if answer.status_code == 204:
                    return
                for message in _parsed(answer, leaving):
                    last = message["event"]
                    yield message
                    if message["type"] == "ended":
                        return
        except httpx.TransportError:
            pass
        leaving.wait(RETRY_S)


def listen(caller: Caller, told: Told, leaving: threading.Event) -> None:
    """Listen to the session of ``told``, and write down there what is heard."""
    wanted = 0
    for message in listening(caller, told.session_id, leaving):
        told.event(message, wanted)
        wanted = message["event"] + 1


def _parsed(answer: httpx.Response, leaving: threading.Event) -> Iterator[Message]:
    """Yield the events that have come whole; their id must be their number."""
    fields: dict[str, str] = {}
    for line in answer.iter_lines():
        if leaving.is_set():
            return
        name, _, value = line.partition(": ")
        if line:
            fields[name] = value
            continue
        if "data" in fields:
            message: Message = json.loads(fields["data"])
            if fields.get("id") != str(message["event"]):
                raise ValueError(f"event {message} has the id {fields.get('id')}")
            yield message
        fields = {}
