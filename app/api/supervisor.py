"""Several server processes on one listening socket, and a parent that keeps them.

Each process accepts from the same socket, so none that comes or goes costs a connection: what nobody has
accepted yet stays in the socket's backlog. A socket pair, the *line*, joins the parent with each of them. A
server says ``READY`` when it serves and ``LEAVE`` where it was asked that all leave. The parent says nothing,
but a server whose line is cut is alone, and leaves.

uvicorn has such a parent, ``uvicorn.supervisors.Multiprocess``. It makes plain servers, which do not drain;
where it is killed its processes go on serving for ever; it starts one that dies at once again without end
and without a pause, and gives all of them up where one cannot start.
"""

from __future__ import annotations

import asyncio
import logging
import signal
import socket
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, field

READY, LEAVE = b"r", b"l"
START_S = 120.0
"""How long a new server may take to be ready before it does not replace an old one [s]."""
STOP_S = 30.0
"""How long a server may take to drain and leave before it is killed [s]."""
STEADY_S = 30.0
"""A server that lived so long did not die at once [s]."""
SHORTEST_S, LONGEST_S = 0.5, 30.0
"""Pause before a server that died at once is started again: it doubles from the first to the last [s]."""

log = logging.getLogger(__name__)


@dataclass(eq=False)
class _Child:
    process: subprocess.Popen[bytes]
    line: socket.socket
    began: float
    ready: asyncio.Event = field(default_factory=asyncio.Event)
    ended: asyncio.Event = field(default_factory=asyncio.Event)


@dataclass(eq=False)
class _Place:
    """Where one server is to run; who changes which one has the turn."""

    child: _Child | None = None
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)


class Supervisor:
    """Keeps ``count`` servers; made and run inside the running event loop.

    command: of a server; the numbers of the listening socket and of its line are added as arguments.
    """

    def __init__(self, listener: socket.socket, count: int, command: Sequence[str]) -> None:
        self._listener = listener
        self._command = tuple(command)
        self._places = [_Place() for _ in range(count)]
        self._running: set[_Child] = set()
        self._leaving, self._renewing = asyncio.Event(), asyncio.Event()

    async def run(self) -> None:
        """Serve until SIGTERM, SIGINT or a server asks that all leave; SIGHUP renews one after the other."""
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self._leaving.set)
        loop.add_signal_handler(signal.SIGHUP, self._renewing.set)
        works = [self._leaving.wait(), self._renew(), *(self._keep(place) for place in self._places)]
        tasks = [asyncio.ensure_future(work) for work in works]
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        self._listener.close()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await asyncio.gather(*(self._dismiss(child) for child in self._running))
        for task in done:
            task.result()

    async def _keep(self, place: _Place) -> None:
        """Keep a place filled; the longer the sooner one dies after the other, the longer the pause."""
        pause, loop = 0.0, asyncio.get_running_loop()
        while True:
            async with place.turn:
                if place.child is None or place.child.ended.is_set():
                    place.child = self._start()
            child = place.child
            await child.ended.wait()
            if place.child is not child:
                continue
            lived = loop.time() - child.began
            pause = 0.0 if lived > STEADY_S else min(max(2.0 * pause, SHORTEST_S), LONGEST_S)
            process = child.process
            log.error("server %d ended with %s; next in %g s", process.pid, process.returncode, pause)
            await asyncio.sleep(pause)

    async def _renew(self) -> None:
        """Replace each server, whenever it is asked for: the old one leaves once the new one is ready."""
        while True:
            await self._renewing.wait()
            self._renewing.clear()
            for place in self._places:
                async with place.turn:
                    if not await self._is_replaced(place):
                        break
            else:
                log.info("%d servers are renewed", len(self._places))

    async def _is_replaced(self, place: _Place) -> bool:
        old, new = place.child, self._start()
        if not await self._is_ready(new):
            log.error("server %d did not get ready: the restart is given up", new.process.pid)
            await self._dismiss(new)
            return False
        place.child = new
        if old is not None:
            await self._dismiss(old)
        return True

    def _start(self) -> _Child:
        ours, theirs = socket.socketpair()
        with theirs:
            given = self._listener.fileno(), theirs.fileno()
            command = [*self._command, *map(str, given)]
            process = subprocess.Popen(command, pass_fds=given)  # noqa: S603 (nothing of it comes from outside)
        loop = asyncio.get_running_loop()
        child = _Child(process, ours, loop.time())
        self._running.add(child)
        loop.add_reader(ours, self._hear, child)
        return child

    def _hear(self, child: _Child) -> None:
        """Note what a server says; its line is cut by its end."""
        try:
            said = child.line.recv(64)
        except ConnectionError:
            said = b""
        if READY in said:
            log.info("server %d serves", child.process.pid)
            child.ready.set()
        if LEAVE in said:
            self._leaving.set()
        if not said:
            asyncio.get_running_loop().remove_reader(child.line)
            child.line.close()
            child.process.wait()
            self._running.discard(child)
            child.ended.set()

    async def _is_ready(self, child: _Child) -> bool:
        waits = [asyncio.ensure_future(event.wait()) for event in (child.ready, child.ended)]
        await asyncio.wait(waits, timeout=START_S, return_when=asyncio.FIRST_COMPLETED)
        for wait in waits:
            wait.cancel()
        return child.ready.is_set() and not child.ended.is_set()

    async def _dismiss(self, child: _Child) -> None:
        """Let a server drain and leave; one that does not is killed."""
        child.process.terminate()
        try:
            async with asyncio.timeout(STOP_S):
                await child.ended.wait()
        except TimeoutError:
            log.error("server %d did not leave within %g s: it is killed", child.process.pid, STOP_S)
            child.process.kill()
            await child.ended.wait()


def supervise(listener: socket.socket, count: int, command: Sequence[str]) -> None:
    """Keep ``count`` servers of a command on a listening socket until they are asked to leave."""

    async def run() -> None:
        await Supervisor(listener, count, command).run()

    asyncio.run(run())
