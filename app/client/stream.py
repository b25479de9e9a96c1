"""A stream to the server, for asyncio (``AsyncStream``) and for plain code (``Stream``).

Both send frames, waiting while too many are under way, and yield the server's messages as they come. After
``end`` the messages run out behind ``ended``; a stream that breaks off raises StreamError.
"""

from __future__ import annotations

import asyncio
import json
import queue
import threading
from collections.abc import AsyncIterator, Iterator, Mapping
from types import TracebackType
from typing import Any, Self

from numpy.typing import ArrayLike
from websockets.asyncio.client import ClientConnection as AsyncSocket
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection as SyncSocket
from websockets.sync.client import connect as connect_sync
from websockets.typing import Subprotocol

from app.client.errors import StreamError
from app.client.wire import METRES, SUBPROTOCOL, Encoding, Message, StreamState


def start_message(
    model: str,
    *,
    version: str | int | None = None,
    geometry: Mapping[str, str] | None = None,
    rate_hz: float | None = None,
    objects: list[str] | None = None,
    scene: Mapping[str, float] | None = None,
    name: str | None = None,
    encoding: Encoding = "f64",
    options: Mapping[str, Any] | None = None,
    resume: Mapping[str, Any] | None = None,
) -> Message:
    """Return a ``start``; what is None is left to the server."""
    fields = {
        "model": model,
        "version": version,
        "geometry": dict(geometry or METRES),
        "rate_hz": rate_hz,
        "objects": objects,
        "scene": scene,
        "name": name,
        "encoding": encoding,
        "options": options,
        "resume": resume,
    }
    return {"type": "start", **{key: value for key, value in fields.items() if value is not None}}


class AsyncStream:
    """A stream for asyncio: ``async with AsyncStream(url, model="table-top") as stream``.

    url: of the server, ``http://…``; the other arguments are those of ``start_message``.
    """

    def __init__(self, url: str, model: str, **start: Any) -> None:
        self.state = StreamState(start_message(model, **start))
        self._url = stream_url(url)
        self._messages: asyncio.Queue[Message | None] = asyncio.Queue()
        self._moved = asyncio.Event()
        self._socket: AsyncSocket
        self._reader: asyncio.Task[None]

    async def __aenter__(self) -> Self:
        self._socket = await connect_async(
            self._url,
            subprotocols=[Subprotocol(SUBPROTOCOL)],
            compression=None,
            max_size=None,
            ping_timeout=60,
        )
        await self._socket.send(json.dumps(self.state.start))
        self._reader = asyncio.create_task(self._read())
        try:
            await self._until_room()
        except StreamError:
            await self._socket.close()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._socket.close()
        await self._reader

    async def send(
        self, times: ArrayLike | None, hand: ArrayLike, objects: Mapping[str, ArrayLike] | None = None
    ) -> None:
        """Send frames: times (n,) [s] or None, hand and each object (n, 3). Raises StreamError."""
        for message in self.state.frames(times, hand, objects or {}):
            await self._until_room()
            await self._send(message)

    async def flush(self, flush_id: int | str = 0) -> None:
        """Ask for ``flushed``."""
        await self._send(json.dumps({"type": "flush", "id": flush_id}))

    async def end(self) -> None:
        """Tell that no more frames come; the messages then run out behind ``ended``."""
        await self._send(json.dumps({"type": "end", "last_seq": self.state.next_seq - 1}))

    async def __aiter__(self) -> AsyncIterator[Message]:
        while (message := await self._messages.get()) is not None:
            yield message
        if self.state.ended is None:
            raise self._broken()

    async def _send(self, message: str | bytes) -> None:
        try:
            await self._socket.send(message)
        except ConnectionClosed:
            await self._reader
            raise self._broken() from None

    async def _until_room(self) -> None:
        while self.state.full:
            if self._reader.done():
                raise self._broken()
            self._moved.clear()
            await self._moved.wait()

    async def _read(self) -> None:
        try:
            async for text in self._socket:
                self._messages.put_nowait(self.state.read(text))
                self._moved.set()
        except ConnectionClosed:
            pass
        finally:
            self._messages.put_nowait(None)
            self._reader_left()

    def _reader_left(self) -> None:
        asyncio.get_running_loop().call_soon(self._moved.set)

    def _broken(self) -> StreamError:
        return StreamError(self._socket.close_code or 1006, self.state.error)


class Stream:
    """The same for plain code: ``with Stream(url, model="table-top") as stream``; a thread reads."""

    def __init__(self, url: str, model: str, **start: Any) -> None:
        self.state = StreamState(start_message(model, **start))
        self._url = stream_url(url)
        self._messages: queue.SimpleQueue[Message | None] = queue.SimpleQueue()
        self._moved = threading.Condition()
        self._closed = False
        self._socket: SyncSocket
        self._reader: threading.Thread

    def __enter__(self) -> Self:
        self._socket = connect_sync(
            self._url,
            subprotocols=[Subprotocol(SUBPROTOCOL)],
            compression=None,
            max_size=None,
            ping_timeout=60,
        )
        self._socket.send(json.dumps(self.state.start))
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        try:
            self._until_room()
        except StreamError:
            self._socket.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()
        self._reader.join()

    def send(
        self, times: ArrayLike | None, hand: ArrayLike, objects: Mapping[str, ArrayLike] | None = None
    ) -> None:
        """Send frames: times (n,) [s] or None, hand and each object (n, 3). Raises StreamError."""
        for message in self.state.frames(times, hand, objects or {}):
            self._until_room()
            self._send(message)

    def flush(self, flush_id: int | str = 0) -> None:
        """Ask for ``flushed``."""
        self._send(json.dumps({"type": "flush", "id": flush_id}))

    def end(self) -> None:
        """Tell that no more frames come; the messages then run out behind ``ended``."""
        self._send(json.dumps({"type": "end", "last_seq": self.state.next_seq - 1}))

    def __iter__(self) -> Iterator[Message]:
        while (message := self._messages.get()) is not None:
            yield message
        if self.state.ended is None:
            raise self._broken()

    def _send(self, message: str | bytes) -> None:
        try:
            self._socket.send(message)
        except ConnectionClosed:
            self._reader.join()
            raise self._broken() from None

    def _until_room(self) -> None:
        with self._moved:
            self._moved.wait_for(lambda: self._closed or not self.state.full)
        if self._closed and self.state.full:
            raise self._broken()

    def _read(self) -> None:
        try:
            for text in self._socket:
                with self._moved:
                    self._messages.put(self.state.read(text))
                    self._moved.notify_all()
        except ConnectionClosed:
            pass
        finally:
            with self._moved:
                self._closed = True
                self._moved.notify_all()
            self._messages.put(None)

    def _broken(self) -> StreamError:
        return StreamError(self._socket.protocol.close_code or 1006, self.state.error)


def stream_url(url: str) -> str:
    """Return where the stream of the server at ``url`` is."""
    return f"ws{url.removeprefix('http').rstrip('/')}/v1/stream"
