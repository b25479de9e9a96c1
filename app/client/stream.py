"""A stream to the server, for asyncio (``AsyncStream``) and for plain code (``Stream``).

Both send frames, waiting while too many are under way, and yield the server's messages as they come. After
``end`` the messages run out behind ``ended``. A connection that breaks is made anew: the session goes on,
the frames that were lost are sent again, and each durable event is yielded once. What cannot be mended
raises StreamError.
"""

from __future__ import annotations

import asyncio
import queue
import threading
import time
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import ExitStack, suppress
from types import TracebackType
from typing import Any, Self

from numpy.typing import ArrayLike
from websockets.asyncio.client import ClientConnection as AsyncSocket
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import ClientConnection as SyncSocket
from websockets.sync.client import connect as connect_sync
from websockets.typing import Subprotocol

from app.client.stream_state import StreamState, start_message
from app.client.wire import SUBPROTOCOL, Message

RECONNECT_S = 30.0
PAUSE_S = 0.25
"""Between two attempts to connect [s]."""
UNREACHABLE = (OSError, InvalidHandshake, ConnectionClosed)
OPTIONS: dict[str, Any] = {
    "subprotocols": [Subprotocol(SUBPROTOCOL)],
    "compression": None,
    "max_size": None,
    "ping_timeout": 60,
}


class AsyncStream:
    """A stream for asyncio: ``async with AsyncStream(url, model="table-top") as stream``.

    url: of the server, ``http://…``; reconnect_s: how long a broken connection is tried to be made anew, 0:
    not at all; the other arguments are those of ``start_message``. ``state.resume`` is what another stream
    needs as ``resume`` to go on with this one's session.
    """

    def __init__(self, url: str, model: str, *, reconnect_s: float = RECONNECT_S, **start: Any) -> None:
        self.state = StreamState(start_message(model, **start))
        self._url, self._patience = stream_url(url), reconnect_s
        self._messages: asyncio.Queue[Message | None] = asyncio.Queue()
        self._moved = asyncio.Event()
        self._turn = asyncio.Lock()
        self._over = False
        self._socket: AsyncSocket
        self._reader: asyncio.Task[None]

    async def __aenter__(self) -> Self:
        self._socket = await connect_async(self._url, **OPTIONS)
        await self._socket.send(self.state.opening())
        self._reader = asyncio.create_task(self._read())
        try:
            await self._until_room()
        except BaseException:
            await self.close()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Leave; the session waits to be resumed, unless it has ended."""
        self._reader.cancel()
        await asyncio.gather(self._reader, return_exceptions=True)
        await self._socket.close()

    async def send(
        self, times: ArrayLike | None, hand: ArrayLike, objects: Mapping[str, ArrayLike] | None = None
    ) -> None:
        """Send frames: times (n,) [s] or None, hand and each object (n, 3). Raises StreamError."""
        messages = self.state.frames(times, hand, objects or {})
        while True:
            await self._until_room()
            async with self._turn:
                message = next(messages, None)
                if message is None:
                    return
                await self._send(message)

    async def flush(self, flush_id: int | str = 0) -> None:
        """Ask for ``flushed``."""
        async with self._turn:
            await self._send(self.state.flush(flush_id))

    async def end(self) -> None:
        """Tell that no more frames come; the messages then run out behind ``ended``."""
        async with self._turn:
            await self._send(self.state.end())

    async def __aiter__(self) -> AsyncIterator[Message]:
        while (message := await self._messages.get()) is not None:
            yield message
        self._messages.put_nowait(None)
        if self.state.ended is None:
            raise self.state.lost(self._socket.close_code)

    async def _send(self, message: str | bytes) -> None:
        """Send; the reader will do it again should the connection be lost."""
        try:
            await self._socket.send(message)
        except ConnectionClosed:
            if self._over:
                raise self.state.lost(self._socket.close_code) from None

    async def _until_room(self) -> None:
        while self.state.full or self._over:
            if self._over:
                raise self.state.lost(self._socket.close_code)
            self._moved.clear()
            await self._moved.wait()

    async def _read(self) -> None:
        try:
            await self._hear()
            while self.state.can_go_on(self._socket.close_code) and await self._reconnect():
                await self._hear()
        finally:
            self._over = True
            self._messages.put_nowait(None)
            self._moved.set()

    async def _hear(self) -> None:
        try:
            async for text in self._socket:
                self._note(text)
        except ConnectionClosed:
            return

    async def _reconnect(self) -> bool:
        """Connect again and send again what was lost; return whether the server has answered."""
        deadline = time.monotonic() + self._patience
        while time.monotonic() < deadline:
            with suppress(*UNREACHABLE):
                async with self._turn:
                    self._socket = await connect_async(self._url, **OPTIONS)
                    await self._socket.send(self.state.opening())
                    answer = self._note(await self._socket.recv())
                    if not answer.get("retryable"):
                        for message in self.state.again():
                            await self._socket.send(message)
                        return True
            await asyncio.sleep(PAUSE_S)
        return False

    def _note(self, text: str | bytes) -> Message:
        message = self.state.read(text)
        self._messages.put_nowait(message)
        self._moved.set()
        return message


class Stream:
    """The same for plain code: ``with Stream(url, model="table-top") as stream``; a thread reads."""

    def __init__(self, url: str, model: str, *, reconnect_s: float = RECONNECT_S, **start: Any) -> None:
        self.state = StreamState(start_message(model, **start))
        self._url, self._patience = stream_url(url), reconnect_s
        self._messages: queue.SimpleQueue[Message | None] = queue.SimpleQueue()
        self._moved = threading.Condition()
        self._turn = threading.Lock()
        self._leaving = threading.Event()
        self._over = False
        self._sockets = ExitStack()
        self._socket: SyncSocket
        self._reader = threading.Thread(target=self._read, daemon=True)

    def __enter__(self) -> Self:
        self._socket = self._sockets.enter_context(connect_sync(self._url, **OPTIONS))
        self._socket.send(self.state.opening())
        self._reader.start()
        try:
            self._until_room()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave; the session waits to be resumed, unless it has ended."""
        self._leaving.set()
        self._socket.close()
        self._reader.join()
        self._sockets.close()

    def send(
        self, times: ArrayLike | None, hand: ArrayLike, objects: Mapping[str, ArrayLike] | None = None
    ) -> None:
        """Send frames: times (n,) [s] or None, hand and each object (n, 3). Raises StreamError."""
        messages = self.state.frames(times, hand, objects or {})
        while True:
            self._until_room()
            with self._turn:
                message = next(messages, None)
                if message is None:
                    return
                self._send(message)

    def flush(self, flush_id: int | str = 0) -> None:
        """Ask for ``flushed``."""
        with self._turn:
            self._send(self.state.flush(flush_id))

    def end(self) -> None:
        """Tell that no more frames come; the messages then run out behind ``ended``."""
        with self._turn:
            self._send(self.state.end())

    def __iter__(self) -> Iterator[Message]:
        while (message := self._messages.get()) is not None:
            yield message
        self._messages.put(None)
        if self.state.ended is None:
            raise self.state.lost(self._close_code)

    @property
    def _close_code(self) -> int | None:
        return self._socket.protocol.close_code

    def _send(self, message: str | bytes) -> None:
        """Send; the reader will do it again should the connection be lost."""
        try:
            self._socket.send(message)
        except ConnectionClosed:
            if self._over:
                raise self.state.lost(self._close_code) from None

    def _until_room(self) -> None:
        with self._moved:
            self._moved.wait_for(lambda: self._over or not self.state.full)
        if self._over:
            raise self.state.lost(self._close_code)

    def _read(self) -> None:
        try:
            self._hear()
            while self.state.can_go_on(self._close_code) and self._reconnect():
                self._hear()
        finally:
            with self._moved:
                self._over = True
                self._moved.notify_all()
            self._messages.put(None)

    def _hear(self) -> None:
        try:
            for text in self._socket:
                self._note(text)
        except ConnectionClosed:
            return

    def _reconnect(self) -> bool:
        """Connect again and send again what was lost; return whether the server has answered.

        Between two tries others may send: what they send is kept for when the server is back.
        """
        deadline = time.monotonic() + self._patience
        while time.monotonic() < deadline and not self._leaving.is_set():
            with suppress(*UNREACHABLE), self._turn:
                self._socket = self._sockets.enter_context(connect_sync(self._url, **OPTIONS))
                self._socket.send(self.state.opening())
                answer = self._note(self._socket.recv())
                if not answer.get("retryable"):
                    for message in self.state.again():
                        self._socket.send(message)
                    return True
            self._leaving.wait(PAUSE_S)
        return False

    def _note(self, text: str | bytes) -> Message:
        with self._moved:
            message = self.state.read(text)
            self._messages.put(message)
            self._moved.notify_all()
        return message


def stream_url(url: str) -> str:
    """Return where the stream of the server at ``url`` is."""
    return f"ws{url.removeprefix('http').rstrip('/')}/v1/stream"
