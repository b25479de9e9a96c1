"""Many streams at once, on a fixed schedule, from one thread: what a server is loaded with.

The thread speaks WebSocket itself, over plain sockets: a message is masked with zeros, which changes nothing
of it, so that it can be put together beforehand and sent as it is. What falls due is sent before anything is
read. How late it was itself is measured as well.
"""

from __future__ import annotations

import json
import os
import select
import socket
import struct
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from app.motion.trajectory import Floats

ASK_EVERY = 10
"""Messages of a stream for one question behind them."""
AHEAD = 16
"""Frames by which streams are apart at most."""
SETTLE_S = 1.0
"""What is sent first and not measured [s]."""
ANSWER_S = 2.0
"""How long the last answers are waited for [s]."""
AT_ONCE = 32
"""Messages sent before the answers are looked at."""
OPEN_S = 30.0
"""How long a server may take to answer while a stream is opened or ended [s]."""

TEXT, BINARY = 0x81, 0x82


@dataclass(frozen=True)
class Load:
    """What is offered: streams, frames a second of each [Hz], frames a message, for how long [s]."""

    streams: int
    rate: float
    chunk: int
    seconds: float

    @property
    def interval(self) -> float:
        """Time between two messages of a stream [s]."""
        return self.chunk / self.rate

    @property
    def n_messages(self) -> int:
        """Messages of a stream, with those that are not measured."""
        return round((SETTLE_S + self.seconds) / self.interval)


@dataclass(frozen=True)
class Answers:
    """How it went [s]: waits from the scheduled time of a message to its answer, infinite where none came;
    lateness: how long after its scheduled time each message was sent.
    """

    waits: Floats
    lateness: Floats

    @property
    def p99(self) -> float:
        """The 99th percentile of the waits [s]."""
        return float(np.percentile(self.waits, 99, method="higher"))

    @property
    def late(self) -> float:
        """The 99th percentile of the lateness [s]."""
        return float(np.percentile(self.lateness, 99))


@dataclass
class Wire:
    """One stream: its socket, and what of the server's words is not read yet."""

    socket: socket.socket
    unread: bytearray = field(default_factory=bytearray)

    def messages(self) -> Iterator[bytes]:
        """Yield the texts that have come; a close ends them all. Raises ConnectionError."""
        if not (got := self.socket.recv(1 << 16)):
            raise ConnectionError("the server has hung up")
        self.unread += got
        while (frame := _frame(self.unread)) is not None:
            kind, begin, end = frame
            text = bytes(self.unread[begin:end])
            del self.unread[:end]
            if kind == 0x8:
                raise ConnectionError(f"the server has closed: {text!r}")
            if kind == 0x1:
                yield text

    def hear(self, kind: str) -> dict[str, object]:
        """Wait for the next message of a kind; what comes with it is dropped. Raises ConnectionError."""
        while True:
            for text in self.messages():
                message: dict[str, object] = json.loads(text)
                if message["type"] == kind:
                    return message


def opened(port: int, model: str, rate: float, hypotheses: bool = True) -> Wire:
    """Open a stream of one object at a rate [Hz], binary; hypotheses: whether it asks for them."""
    wire = Wire(socket.create_connection(("127.0.0.1", port), OPEN_S))
    wire.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    wire.socket.sendall(
        b"GET /v1/stream HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        b"Sec-WebSocket-Protocol: gesta.v1\r\n\r\n"
    )
    while b"\r\n\r\n" not in wire.unread:
        wire.unread += wire.socket.recv(4096)
    head, _, rest = bytes(wire.unread).partition(b"\r\n\r\n")
    if not head.startswith(b"HTTP/1.1 101"):
        raise ConnectionError(f"the server takes no stream: {head!r}")
    wire.unread = bytearray(rest)
    start = {
        "type": "start",
        "model": model,
        "geometry": {"length_unit": "m", "up_axis": "z"},
        "rate_hz": rate,
        "encoding": "f64",
        "options": {"hypotheses": hypotheses},
    }
    wire.socket.sendall(framed(TEXT, json.dumps(start).encode()))
    wire.hear("started")
    return wire


def ended(wires: Sequence[Wire]) -> None:
    """End the streams and hang up."""
    for wire in wires:
        wire.socket.settimeout(OPEN_S)
        wire.socket.sendall(framed(TEXT, b'{"type":"end"}'))
    for wire in wires:
        wire.hear("ended")
        wire.socket.close()


def framed(kind: int, payload: bytes) -> bytes:
    """Return a whole WebSocket message of a client."""
    size = len(payload)
    head = bytes((kind, 0x80 | size)) if size < 126 else struct.pack(">BBH", kind, 0x80 | 126, size)
    return head + bytes(4) + payload


def frames(first_seq: int, rows: Floats) -> bytes:
    """Return rows (n, n_channels) as a binary message of frames."""
    return framed(BINARY, struct.pack("<QII", first_seq, *rows.shape) + rows.tobytes())


def offer(load: Load, wires: Sequence[Wire], rows: Floats) -> Answers:
    """Offer a load to streams just opened; rows: (n, n_channels), each stream starts elsewhere in them.

    Streams are staggered: message j of stream i is due at (j + i / streams) intervals; what stream i sends
    before, up to AHEAD frames at once, is as if it had begun at another time. An answer is the
    ``pong`` to a ``ping`` sent behind every tenth message, in one piece with it. Raises ConnectionError
    where a stream does not last.
    """
    return _Offer(load, wires, rows).run()


class _Offer:
    def __init__(self, load: Load, wires: Sequence[Wire], rows: Floats) -> None:
        self._load, self._wires, self._rows = load, wires, rows
        n_frames = AHEAD + load.n_messages * load.chunk
        self._starts = np.linspace(0, len(rows) - n_frames, len(wires)).astype(int).tolist()
        self._total = load.n_messages * len(wires)
        self._step = load.interval / len(wires)
        self._lateness = np.zeros(self._total)
        self._answered = np.full(self._total, np.inf)
        self._asked = np.zeros(self._total, dtype=bool)
        self._open = 0
        self._messages = [self._message(number) for number in range(self._total)]
        self._poll = select.epoll()
        self._of = {wire.socket.fileno(): wire for wire in wires}

    def run(self) -> Answers:
        for wire in self._wires:
            wire.socket.setblocking(False)
            self._poll.register(wire.socket, select.EPOLLIN)
        try:
            for stream, wire in enumerate(self._wires):
                if ahead := stream % AHEAD:
                    begin = self._starts[stream]
                    wire.socket.send(frames(0, self._rows[begin : begin + ahead]))
            self._begin, sent = time.perf_counter() + 0.1, 0
            while sent < self._total:
                sent = self._send_due(sent)
                self._read(self._begin + sent * self._step)
            deadline = time.perf_counter() + ANSWER_S
            while self._open and time.perf_counter() < deadline:
                self._read(deadline)
        finally:
            self._poll.close()
        measured = np.arange(self._total) * self._step >= SETTLE_S
        due = self._begin + np.arange(self._total) * self._step
        asked = self._asked & measured
        return Answers((self._answered - due)[asked], self._lateness[measured])

    def _send_due(self, sent: int) -> int:
        """Send what is due, some at once; return how many messages have been sent."""
        for number in range(sent, min(sent + AT_ONCE, self._total)):
            late = time.perf_counter() - self._begin - number * self._step
            if late < 0:
                return number
            self._lateness[number] = late
            self._send(number)
        return min(sent + AT_ONCE, self._total)

    def _message(self, number: int) -> bytes:
        """Return a message with its question, and note that it has one."""
        message, stream = divmod(number, len(self._wires))
        first, chunk = stream % AHEAD + message * self._load.chunk, self._load.chunk
        begin = self._starts[stream] + first
        data = frames(first, self._rows[begin : begin + chunk])
        if (message + stream) % ASK_EVERY == 0:
            self._asked[number] = True
            data += framed(TEXT, b'{"type":"ping","id":%d}' % number)
        return data

    def _send(self, number: int) -> None:
        data = self._messages[number]
        try:
            sent = self._wires[number % len(self._wires)].socket.send(data)
        except BlockingIOError:
            sent = 0
        if sent < len(data):
            raise ConnectionError("the server does not read")
        self._open += bool(self._asked[number])

    def _read(self, until: float) -> None:
        """Read what has come; where nothing has, wait for it until a time."""
        if not (ready := self._poll.poll(0)):
            pause = until - time.perf_counter()
            if pause <= 0 or not select.select([self._poll], [], [], pause)[0]:
                return
            ready = self._poll.poll(0)
        for descriptor, _ in ready:
            for text in self._of[descriptor].messages():
                if text.startswith(b'{"type":"pong"'):
                    self._answered[json.loads(text)["id"]] = time.perf_counter()
                    self._open -= 1


def _frame(data: bytearray) -> tuple[int, int, int] | None:
    """Return the opcode, begin and end of the message that data begins with; None where it is not whole."""
    if len(data) < 2:
        return None
    size, begin = data[1], 2
    if size >= 126:
        width = 2 if size == 126 else 8
        begin += width
        if len(data) < begin:
            return None
        size = int.from_bytes(data[2:begin], "big")
    return None if len(data) < begin + size else (data[0] & 0x0F, begin, begin + size)


def on_cores(*cores: int) -> None:
    """Bind this process to cores."""
    os.sched_setaffinity(0, set(cores))
