"""A bare client of the stream, and what a server should make of simulated motion.

Everything the server says, here or to the clients under test, is held against docs/asyncapi.yaml.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jsonschema import Draft202012Validator
from referencing import Registry, Resource
from referencing.jsonschema import DRAFT202012
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from app.motion.model import Model
from app.motion.recogniser import Recogniser, SegmentEvent
from app.motion.trajectory import Trajectory
from tests.serving import Server

Message = dict[str, Any]
ASYNCAPI = Path(__file__).parents[1] / "docs" / "asyncapi.yaml"
METRES = {"length_unit": "m", "up_axis": "z"}
WAIT_S = 20.0


class Talk:
    """One connection; ``heard`` is what the server has said on it so far."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.heard: list[Message] = []

    @property
    def closed_with(self) -> int | None:
        """The close code, once the server has closed."""
        return self.socket.protocol.close_code

    def say(self, kind: str, **fields: Any) -> None:
        """Send a message."""
        self.socket.send(json.dumps({"type": kind, **fields}))

    def start(self, model: str = "table-top", **fields: Any) -> Message:
        """Send ``start`` and return ``started``."""
        self.say("start", **{"model": model, "geometry": METRES, **fields})
        return self.hear("started")

    def frames(self, motion: Trajectory, start: int = 0, stop: int | None = None, chunk: int = 10) -> None:
        """Send frames ``start`` to ``stop`` of a motion in metres as JSON messages of ``chunk`` frames."""
        stop = len(motion) if stop is None else stop
        for first in range(start, stop, chunk):
            self.say("frames", **columns(motion, first, min(first + chunk, stop)))

    def hear(self, *kinds: str) -> Message:
        """Return the next message of one of these kinds; the server must say one before it closes."""
        while True:
            message = self._next()
            assert message is not None, f"no {kinds} before {self.closed_with}: {self.heard[-3:]}"
            if message["type"] in kinds:
                return message

    def waiting(self) -> list[Message]:
        """Return the messages that have arrived."""
        before = len(self.heard)
        while self._next(wait=0.0) is not None:
            pass
        return self.heard[before:]

    def rest(self) -> list[Message]:
        """Return the messages up to the close of the connection."""
        before = len(self.heard)
        while self._next() is not None:
            pass
        return self.heard[before:]

    def said(self, kind: str) -> list[Message]:
        """Return what has been heard of a kind."""
        return [message for message in self.heard if message["type"] == kind]

    def refused(self) -> tuple[int | None, str, Message]:
        """Return the close code, the error's code, and the error, which must come last."""
        error = self.rest()[-1]
        assert error["type"] == "error"
        return self.closed_with, error["code"], error

    def _next(self, wait: float = WAIT_S) -> Message | None:
        try:
            text = self.socket.recv(wait)
        except ConnectionClosed:
            return None
        except TimeoutError:
            assert wait == 0.0, "the server says nothing"
            return None
        message = checked(text)
        self.heard.append(message)
        return message


@contextmanager
def talking(server: Server) -> Iterator[Talk]:
    """Connect to the stream of a server."""
    with connect(
        server.stream_url,
        subprotocols=[Subprotocol("gesta.v1")],
        compression=None,
        max_size=None,
        close_timeout=5,
    ) as socket:
        yield Talk(socket)


def waving() -> Trajectory:
    """Return a wide wave high above the table, far from the cup: nothing that the simulation shows."""
    ends = np.array([[0.0, 0.0, 0.02], [0.0, 0.0, 0.7], [0.5, -0.4, 0.7], [0.0, 0.0, 0.02]])
    share = np.linspace(0.0, 1.0, 80)[:, None]
    share = 10 * share**3 - 15 * share**4 + 6 * share**5
    still = np.zeros((60, 1))
    hand = np.concatenate(
        [a + (b - a) * np.concatenate([still, share]) for a, b in pairwise(ends)] + [ends[-1] + still]
    )
    return Trajectory(np.arange(len(hand)) / 100, hand, {"cup": np.tile([0.0, 0.36, 0.0], (len(hand), 1))})


def columns(motion: Trajectory, start: int, stop: int) -> Message:
    """Return frames as the fields of ``frames``, a dropout null."""
    return {
        "first_seq": start,
        "t": motion.times[start:stop].tolist(),
        "hand": positions(motion.hand[start:stop]),
        "objects": {name: positions(track[start:stop]) for name, track in motion.objects.items()},
    }


def positions(track: np.ndarray[Any, Any]) -> list[list[float] | None]:
    """Return positions (n, 3) as JSON values."""
    return [None if np.isnan(row[0]) else row.tolist() for row in track]


def binary(first_seq: int, rows: np.ndarray[Any, Any], dtype: str = "<f8") -> bytes:
    """Return rows as a binary message."""
    return struct.pack("<QII", first_seq, *rows.shape) + rows.astype(dtype).tobytes()


def expected(model: Model, motion: Trajectory, rate: float | None = None, version: int = 1) -> list[Message]:
    """Return the durable events but ``ended`` that a stream of these frames must give, bit for bit."""
    recogniser = Recogniser(model, rate=rate, objects=tuple(motion.objects))
    found: list[Message] = []
    n_segments = 0
    for number, event in enumerate(recogniser.push(motion) + recogniser.finish()):
        if isinstance(event, SegmentEvent):
            fields: Message = {
                "segment": n_segments,
                "start_seq": event.start,
                "end_seq": event.end,
                "t_start": event.t_start,
                "t_end": event.t_end,
                "action": event.action,
                "objects": event.objects,
                "log_likelihoods": {
                    action: value if np.isfinite(value) else None
                    for action, value in event.log_likelihoods.items()
                },
                "margin": event.margin,
                "novelty": event.novelty,
                "model": "table-top",
                "version": version,
            }
            found.append({"type": "segment", "event": number, **fields})
            n_segments += 1
        else:
            span = {"from_seq": event.start, "to_seq": event.end, "seconds": event.seconds}
            found.append({"type": "gap", "event": number, **span})
    return found


def checked(text: str | bytes) -> Message:
    """Return a message of the server, which must be as the AsyncAPI document says."""
    message: Message = json.loads(text, parse_constant=_not_json)
    validators()[message["type"]].validate(message)
    return message


@cache
def document() -> dict[str, Any]:
    """Return the AsyncAPI document."""
    loaded: dict[str, Any] = yaml.safe_load(ASYNCAPI.read_text())
    return loaded


@cache
def validators() -> Mapping[str, Draft202012Validator]:
    """Return a validator for each message of the AsyncAPI document."""
    resource = Resource.from_contents(document(), DRAFT202012)
    registry: Registry[Any] = Registry().with_resource("urn:stream", resource)
    return {
        name: Draft202012Validator(
            {"$ref": f"urn:stream#/components/messages/{name}/payload"}, registry=registry
        )
        for name in document()["components"]["messages"]
    }


def _not_json(constant: str) -> None:
    raise AssertionError(f"{constant} is no JSON")
