"""A client that streams one session to its end, whatever happens, and writes down what it hears."""

from __future__ import annotations

import json
import random
import socket as sockets
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from websockets.exceptions import InvalidHandshake, WebSocketException
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tests.chaos.told import Told
from tests.talking import METRES, Message, binary, checked, columns

RETRY_S = 0.03
"""Between two tries to connect [s]."""
OPEN_S = 15.0
"""How long a connection may take to be answered [s]."""
FORGIVEN = frozenset({1000, 1005, 1006, 1011, 1012, 1013, 4409, 4429})
"""Closes after which a client comes back; any other is a refusal that nobody asked for."""


@dataclass(frozen=True)
class Habits:
    """How a client streams: frames a second and a message, in which encoding.

    again, ahead: share of the messages that are sent once more, and that are sent too early, which is
    refused; forgets: share of the resumes that ask for all events; patience: without a word of the server
    until the client connects anew [s].
    """

    pace: float = 800.0
    chunk: int = 10
    encoding: str = "f64"
    again: float = 0.0
    ahead: float = 0.0
    forgets: float = 0.3
    patience: float = 25.0


@dataclass
class Pulse:
    """When a client was back, and when it last got on (``time.monotonic``)."""

    resumptions: list[float] = field(default_factory=list)
    progress: float = 0.0


class Streamer:
    """Streams ``told.motion``; ``url()`` is asked for the server each time it connects."""

    def __init__(
        self,
        url: Callable[[], str],
        told: Told,
        habits: Habits,
        seed: int,
        leaving: threading.Event,
        pulse: Pulse | None = None,
    ) -> None:
        self._url, self.told, self.habits, self._leaving = url, told, habits, leaving
        self.pulse = pulse or Pulse()
        self._rng = random.Random(seed)  # noqa: S311 (chance, no secret)
        self._rows = np.column_stack(
            [told.motion.times, told.motion.hand, *(track for track in told.motion.objects.values())]
        )

    def run(self) -> None:
        """Stream until the session has ended, is gone, or the client is to leave."""
        while not (self.told.ended or self.told.gone or self._leaving.is_set()):
            try:
                with connect(
                    f"ws{self._url().removeprefix('http')}/v1/stream",
                    subprotocols=[Subprotocol("gesta.v1")],
                    compression=None,
                    max_size=None,
                    open_timeout=OPEN_S,
                    close_timeout=0.1,
                    ping_interval=None,
                ) as socket:
                    _Connection(socket, self).talk()
            except (OSError, InvalidHandshake, WebSocketException, EOFError):
                self._leaving.wait(RETRY_S)

    def chance(self, share: float) -> bool:
        """Return whether to do what is done in this share of the cases."""
        return self._rng.random() < share

    def message(self, first: int) -> str | bytes:
        """Return the message of frames that begins with frame ``first``."""
        last = min(first + self.habits.chunk, len(self.told.motion))
        if self.habits.encoding == "json":
            return json.dumps({"type": "frames", **columns(self.told.motion, first, last)})
        return binary(first, self._rows[first:last])

    @property
    def leaving(self) -> bool:
        """Whether it is to leave."""
        return self._leaving.is_set()


class _Connection:
    """One connection: what was sent on it, and which event comes next."""

    def __init__(self, socket: ClientConnection, streamer: Streamer) -> None:
        self._socket, self._streamer, self._told = socket, streamer, streamer.told
        self._habits = streamer.habits
        self._wanted, self._durable = 0, self._told.durable
        self._next = self._through = self._most = -1
        self._hasty = self._closed = self._back = False
        self._heard_at = time.monotonic()

    def talk(self) -> None:
        """Stream for as long as the connection lasts. Raises what breaks it."""
        self._begin()
        while self._next < 0 and not self._over:
            self._hear(self._habits.patience)
        begin, base, asked = time.monotonic(), self._next, False
        while not self._over:
            due = begin + (self._next - base) / self._habits.pace
            if self._next >= len(self._told.motion):
                if not asked:
                    self._say("end", last_seq=len(self._told.motion) - 1)
                asked, due = True, time.monotonic() + 0.5
            elif (
                due <= time.monotonic() and self._next + self._habits.chunk - 1 - self._through <= self._most
            ):
                self._send_frames()
                continue
            self._hear(max(due - time.monotonic(), 0.005))

    @property
    def _over(self) -> bool:
        return self._closed or self._told.ended or self._streamer.leaving

    def _say(self, kind: str, **fields: object) -> None:
        self._socket.send(json.dumps({"type": kind, **fields}))

    def _begin(self) -> None:
        told = self._told
        start: Message = {"model": "table-top", "geometry": METRES, "encoding": self._habits.encoding}
        start |= {"options": {"hypotheses": False}}
        if told.session_id:
            self._wanted = 0 if self._streamer.chance(self._habits.forgets) else len(told.events)
            start["resume"] = {
                "session_id": told.session_id,
                "token": told.token,
                "last_event": self._wanted - 1,
            }
        self._say("start", **start)
        self._say("flush", id=0)

    def _send_frames(self) -> None:
        if self._next and self._streamer.chance(self._habits.again):
            self._socket.send(self._streamer.message(max(self._next - 2 * self._habits.chunk, 0)))
        if self._streamer.chance(self._habits.ahead) and self._next + 1 < len(self._told.motion):
            self._hasty = True
            self._socket.send(self._streamer.message(self._next + 1))
        self._socket.send(self._streamer.message(self._next))
        self._next = min(self._next + self._habits.chunk, len(self._told.motion))

    def _hear(self, wait: float) -> None:
        """Take the next message, if one comes in time."""
        try:
            text = self._socket.recv(wait)
        except TimeoutError:
            if time.monotonic() - self._heard_at > self._habits.patience:
                self._socket.socket.shutdown(sockets.SHUT_RDWR)
                self._closed = True
            return
        self._heard_at = time.monotonic()
        self._take(checked(text))

    def _take(self, message: Message) -> None:
        kind = message["type"]
        if kind == "started":
            self._told.started(message, self._durable)
            self._next, self._most = message["next_seq"], message["limits"]["max_unacked_frames"]
            self._through = self._next - 1
        elif kind == "accepted":
            self._told.accepted(message)
            self._through = message["through_seq"]
        elif kind == "error":
            self._refused(message)
        elif "event" in message:
            self._told.event(message, self._wanted)
            self._wanted = message["event"] + 1
        if kind in ("flushed", "ended") and not self._back:
            self._back = True
            self._streamer.pulse.resumptions.append(self._heard_at)
        if kind in ("accepted", "flushed", "ended"):
            self._streamer.pulse.progress = self._heard_at

    def _refused(self, error: Message) -> None:
        """Take an error: the server closes after it."""
        self._closed = True
        with suppress(WebSocketException, TimeoutError):
            self._socket.recv(1.0)
        code = self._socket.protocol.close_code or 1006
        self._told.closings[code] += 1
        if code == 4410:
            self._told.gone = True
            self._told.fault("lost", "session", f"{error}")
        elif code not in FORGIVEN and not (self._hasty and code == 4400):
            self._told.gone = True
            self._told.fault("refused", "session", f"{code} {error}")
