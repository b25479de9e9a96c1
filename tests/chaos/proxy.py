"""A way to the server on which connections break: reset, sliced, delayed, silent in one direction."""

from __future__ import annotations

import asyncio
import random
import socket
import struct
import threading
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

PIECE = 1 << 16
RESET = struct.pack("ii", 1, 0)
"""SO_LINGER that makes of a close a reset."""


@dataclass(frozen=True)
class Weather:
    """What happens to a connection.

    slices: most bytes passed at once; wait: longest that a piece is held back [s], by chance; reset: bytes
    passed either way until both ends are reset; deaf: which way nothing passes any more after ``silence``
    bytes of it, while the connection stays open.
    """

    slices: int = PIECE
    wait: float = 0.0
    reset: int | None = None
    silence: int | None = None
    deaf: str = "server"


FAIR = Weather()


class Proxy:
    """Passes bytes; ``weather(number)`` is asked for each connection, counted from 0."""

    def __init__(self, port: int, weather: Callable[[int], Weather], seed: int) -> None:
        self._target, self._weather = port, weather
        self._rng = random.Random(seed)  # noqa: S311 (chance, no secret)
        self._connections, self._leaving = 0, asyncio.Event()

    def leave(self) -> None:
        """Let all connections go; of the loop's own thread."""
        self._leaving.set()

    async def serve(self, listener: socket.socket) -> None:
        """Pass on what comes until told to leave."""
        server = await asyncio.start_server(self._join, sock=listener)
        await self._leaving.wait()
        server.close()
        joined = asyncio.all_tasks() - {asyncio.current_task()}
        for task in joined:
            task.cancel()
        await asyncio.gather(*joined, return_exceptions=True)

    async def _join(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        weather, self._connections = self._weather(self._connections), self._connections + 1
        try:
            far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._target)
        except OSError:
            writer.transport.abort()
            return
        connection = _Connection(weather, self._rng, (writer, far_writer), self._leaving)
        with suppress(asyncio.CancelledError):
            await asyncio.gather(
                connection.carry(reader, far_writer, "server"), connection.carry(far_reader, writer, "client")
            )
        for end in (writer, far_writer):
            end.transport.abort()
            with suppress(OSError):
                await end.wait_closed()


class _Connection:
    def __init__(
        self,
        weather: Weather,
        rng: random.Random,
        ends: tuple[asyncio.StreamWriter, asyncio.StreamWriter],
        leaving: asyncio.Event,
    ) -> None:
        self._weather, self._rng, self._ends, self._leaving = weather, rng, ends, leaving
        self._carried = {"server": 0, "client": 0}

    async def carry(self, source: asyncio.StreamReader, sink: asyncio.StreamWriter, to: str) -> None:
        """Carry bytes one way until there are no more."""
        with suppress(OSError):
            while data := await source.read(PIECE):
                for piece in self._pieces(data):
                    await self._weathered(to)
                    sink.write(piece)
                    await sink.drain()
                    self._carried[to] += len(piece)
        if self._weather.silence is not None:
            await self._leaving.wait()
        with suppress(OSError):
            sink.write_eof()

    def _pieces(self, data: bytes) -> Iterator[bytes]:
        at = 0
        while at < len(data):
            size = self._rng.randint(1, self._weather.slices) if self._weather.slices < PIECE else PIECE
            yield data[at : at + size]
            at += size

    async def _weathered(self, to: str) -> None:
        """Wait, reset or stop if the weather is so. Raises ConnectionError after a reset."""
        weather = self._weather
        if weather.wait and self._rng.random() < 0.02:
            await asyncio.sleep(self._rng.uniform(0.0, weather.wait))
        if weather.reset is not None and sum(self._carried.values()) >= weather.reset:
            for end in self._ends:
                end.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
                end.transport.abort()
            raise ConnectionResetError
        if weather.silence is not None and weather.deaf == to and self._carried[to] >= weather.silence:
            await self._leaving.wait()


@contextmanager
def proxied(port: int, weather: Callable[[int], Weather], seed: int = 0) -> Iterator[str]:
    """Open a way to the server on a port; yield its address."""
    loop = asyncio.new_event_loop()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        proxy = Proxy(port, weather, seed)
        thread = threading.Thread(target=_run, args=(loop, proxy.serve(listener)))
        thread.start()
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            loop.call_soon_threadsafe(proxy.leave)
            thread.join()


def _run(loop: asyncio.AbstractEventLoop, work: Coroutine[Any, Any, None]) -> None:
    with asyncio.Runner(loop_factory=lambda: loop) as runner:
        runner.run(work)
