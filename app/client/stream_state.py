"""What a client knows of its stream, without any socket: shared by ``AsyncStream`` and ``Stream``."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike

from app.client.errors import StreamError
from app.client.wire import METRES, Encoding, Message, binary_frames, json_frames

RETRYABLE = frozenset({1001, 1006, 1011, 1012, 1013, 4429})
"""Close codes after which a new connection may go on with the session."""
ENDED: Message = {"code": "ended", "detail": "the session has ended"}


def start_message(
    model: str,
    *,
    version: str | int | None = None,
    geometry: Mapping[str, str] | None = None,
    rate_hz: float | None = None,
    objects: list[str] | None = None,
    scene: Mapping[str, float] | None = None,
    goals: Mapping[str, ArrayLike] | None = None,
    name: str | None = None,
    encoding: Encoding = "f64",
    options: Mapping[str, bool | float] | None = None,
    resume: Mapping[str, str | int] | None = None,
) -> Message:
    """Return a ``start``; what is None is left to the server.

    objects: names of what the frames hold besides the hand; goals: places (3,) that movements may go to.
    """
    fields = {
        "model": model,
        "version": version,
        "geometry": dict(geometry or METRES),
        "rate_hz": rate_hz,
        "objects": objects,
        "scene": scene,
        "goals": None if goals is None else {name: np.asarray(at).tolist() for name, at in goals.items()},
        "name": name,
        "encoding": encoding,
        "options": options,
        "resume": resume,
    }
    return {"type": "start", **{key: value for key, value in fields.items() if value is not None}}


class StreamState:
    """The frames sent, those accepted and those durable, the last durable event.

    ``started`` is empty until the server has answered ``start``. What is not durable is kept, so that a new
    connection can go on. ``next_seq`` is the number of the frame to be sent next.
    """

    def __init__(self, start: Message) -> None:
        self.start = start
        self.started: Message = {}
        self.next_seq = 0
        self.through_seq = -1
        self.durable_seq = -1
        self.last_event = start.get("resume", {}).get("last_event", -1)
        self.error: Message | None = None
        self.ended: Message | None = None
        self._kept: deque[tuple[int, str | bytes]] = deque()
        self._flushes: list[int | str] = []
        self._end: str | None = None

    @property
    def full(self) -> bool:
        """Whether so many frames are under way that the next must wait; none is sent before ``started``."""
        limit = self.started["limits"]["max_unacked_frames"] if self.started else 0
        return self.next_seq - 1 - self.through_seq >= limit

    @property
    def resume(self) -> Message | None:
        """What ``start`` needs to go on with this session, from any process; None before it has started."""
        if not self.started:
            return None
        session = {"session_id": self.started["session_id"], "token": self.started["resume_token"]}
        return {**session, "last_event": self.last_event}

    def opening(self) -> str:
        """Return the first message of a connection: it starts the session, or goes on with it."""
        resume = self.resume
        return json.dumps(self.start | ({} if resume is None else {"resume": resume}))

    def read(self, text: str | bytes) -> Message:
        """Return a message of the server and note what it tells."""
        message: Message = json.loads(text)
        kind = message["type"]
        if kind == "started":
            self._note_start(message)
        elif kind == "accepted":
            self.through_seq, self.durable_seq = message["through_seq"], message["durable_seq"]
            self._forget()
        elif kind == "flushed" and message["id"] in self._flushes:
            self._flushes.remove(message["id"])
        elif kind == "error":
            self.error = message
        elif kind == "ended":
            self.ended = message
        self.last_event = message.get("event", self.last_event)
        return message

    def frames(
        self, times: ArrayLike | None, hand: ArrayLike, objects: Mapping[str, ArrayLike]
    ) -> Iterator[str | bytes]:
        """Yield the messages that carry these frames, each counted as sent when it is asked for.

        times: (n,) [s], None where ``start`` gave ``rate_hz``; hand and each object: (n, 3).
        """
        tracks = {"hand": np.asarray(hand, float)}
        tracks |= {name: np.asarray(track, float) for name, track in objects.items()}
        stamps = None if times is None else np.asarray(times, float)
        encoding: Encoding = self.start.get("encoding", "json")
        limits = self.started["limits"]
        most = min(limits["max_frames_per_message"], limits["max_frame_bytes"] // (80 * (len(tracks) + 1)))
        for first in range(0, len(tracks["hand"]), most):
            part = slice(first, first + most)
            block = {name: track[part] for name, track in tracks.items()}
            moments = None if stamps is None else stamps[part]
            if encoding == "json":
                message: str | bytes = json_frames(self.next_seq, moments, block)
            else:
                message = binary_frames(self.next_seq, moments, block, self.started["channels"], encoding)
            self.next_seq += len(block["hand"])
            self._kept.append((self.next_seq - 1, message))
            yield message

    def flush(self, flush_id: int | str) -> str:
        """Return a ``flush``."""
        self._flushes.append(flush_id)
        return json.dumps({"type": "flush", "id": flush_id})

    def end(self) -> str:
        """Return the ``end``."""
        self._end = json.dumps({"type": "end", "last_seq": self.next_seq - 1})
        return self._end

    def again(self) -> Iterator[str | bytes]:
        """Yield what a new connection must be sent once it has ``started``; nothing if it was refused."""
        if self.error is not None:
            return
        for last_seq, message in tuple(self._kept):
            if last_seq > self.through_seq:
                yield message
        for flush_id in self._flushes:
            yield json.dumps({"type": "flush", "id": flush_id})
        if self._end is not None:
            yield self._end

    def lost(self, close_code: int | None) -> StreamError:
        """Return the error of a stream that was closed before it ended."""
        return StreamError(close_code or 1006, self.error or (ENDED if self.ended else None))

    def can_go_on(self, close_code: int | None) -> bool:
        """Whether a new connection may go on where the last one was closed."""
        return bool(self.started) and self.ended is None and (close_code or 1006) in RETRYABLE

    def _note_start(self, message: Message) -> None:
        if not self.started:
            self.next_seq = message["next_seq"]
        self.started, self.error = message, None
        self.through_seq = message["next_seq"] - 1

    def _forget(self) -> None:
        while self._kept and self._kept[0][0] <= self.durable_seq:
            self._kept.popleft()
