"""A load balancer without a memory: each connection goes to the next server that is ready, byte for byte.

python benchmarks/balancer.py PORT SERVER_PORT...
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Sequence
from contextlib import suppress

CHECK_S = 0.2
"""Pause between two questions to a server whether it is ready [s]."""
ANSWER_S = 2.0
"""How long it may take to say so [s]."""
QUESTION = b"GET /readyz HTTP/1.1\r\nHost: server\r\nConnection: close\r\n\r\n"
PIECE = 1 << 16


class Balancer:
    """Takes turns between servers on ports of this machine; one that refuses costs a client nothing."""

    def __init__(self, ports: Sequence[int]) -> None:
        self._ports = list(ports)
        self._ready: set[int] = set()

    async def run(self, port: int) -> None:
        """Serve for ever."""
        server = await asyncio.start_server(self._serve, "127.0.0.1", port, backlog=2048)
        async with server, asyncio.TaskGroup() as group:
            for behind in tuple(self._ports):
                group.create_task(self._watch(behind))

    async def _watch(self, port: int) -> None:
        while True:
            ready = False
            with suppress(OSError, TimeoutError):
                async with asyncio.timeout(ANSWER_S):
                    ready = await _is_ready(port)
            (self._ready.add if ready else self._ready.discard)(port)
            await asyncio.sleep(CHECK_S)

    async def _serve(self, near: asyncio.StreamReader, back: asyncio.StreamWriter) -> None:
        self._ports.append(self._ports.pop(0))
        for port in sorted(self._ports, key=lambda port: port not in self._ready):
            try:
                far, forth = await asyncio.open_connection("127.0.0.1", port)
            except OSError:
                continue
            await asyncio.gather(_carry(near, forth), _carry(far, back))
            return
        back.transport.abort()


async def _is_ready(port: int) -> bool:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        writer.write(QUESTION)
        return (await reader.readline()).startswith(b"HTTP/1.1 200")
    finally:
        writer.transport.abort()


async def _carry(source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
    """Carry what comes one way, and its end: orderly where it was."""
    try:
        while piece := await source.read(PIECE):
            target.write(piece)
            await target.drain()
        target.write_eof()
    except OSError:
        target.transport.abort()


if __name__ == "__main__":
    asyncio.run(Balancer([int(port) for port in sys.argv[2:]]).run(int(sys.argv[1])))
