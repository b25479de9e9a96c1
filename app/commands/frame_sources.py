"""Where lines come from: standard input, or UDP datagrams; in batches, an empty one where nothing came."""

from __future__ import annotations

import os
import select
import socket
import sys
import threading
from collections.abc import Generator
from contextlib import suppress
from queue import Empty, Full, Queue

from app.commands.terminal import failure, tell

Batches = Generator[list[bytes], None, None]

WAIT_S = 0.1
"""How long something is waited for, before it is looked whether to stop [s]."""
PART = 1 << 16
"""Bytes that are read at once: a datagram is no longer."""
LONGEST = 1 << 20
"""Bytes of a line; one that is longer is cut."""
N_WAITING = 1 << 16
"""Datagrams that wait while the server cannot be reached: minutes of frames."""
N_AT_ONCE = 1000


def lines_of_input(stopped: threading.Event) -> Batches:
    """Yield the lines of standard input to its end, or until ``stopped``; none is read before it can go."""
    descriptor, rest = sys.stdin.fileno(), b""
    while not stopped.is_set():
        if not select.select([descriptor], [], [], WAIT_S)[0]:
            yield []
            continue
        content = os.read(descriptor, PART)
        if not content:
            yield [rest] if rest else []
            return
        *lines, rest = (rest + content).split(b"\n")
        if len(rest) > LONGEST:
            lines, rest = [*lines, rest], b""
        yield lines


def lines_of_datagrams(at: str, stopped: threading.Event) -> Batches:
    """Yield the lines of datagrams that come to HOST:PORT until ``stopped``, and of those that wait then.

    A thread takes them as they come, since nobody sends one twice; those that find no room are counted.
    """
    with _bound(at) as opened:
        waiting: Queue[bytes] = Queue(N_WAITING)
        leaving, lost = threading.Event(), [0]
        receiver = threading.Thread(target=_receive, args=(opened, waiting, leaving, lost))
        receiver.start()
        try:
            while not stopped.is_set():
                yield _lines(_taken(waiting))
            while left := _taken(waiting):
                leaving.set()
                yield _lines(left)
        finally:
            leaving.set()
            receiver.join()
            if lost[0]:
                tell(f"{lost[0]} datagrams found no room: the server was away for too long", "red")


def _bound(at: str) -> socket.socket:
    host, _, port = at.rpartition(":")
    try:
        [(family, kind, _, _, address), *_] = socket.getaddrinfo(
            host.strip("[]") or None, int(port), type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE
        )
    except (ValueError, OSError) as error:
        raise failure(f"{at} is no HOST:PORT: {error}") from error
    opened = socket.socket(family, kind)
    try:
        opened.bind(address)
    except OSError as error:
        opened.close()
        raise failure(f"{at}: {error.strerror}") from error
    opened.settimeout(WAIT_S)
    tell("datagrams are awaited at {}:{}".format(*opened.getsockname()))
    return opened


def _receive(opened: socket.socket, waiting: Queue[bytes], leaving: threading.Event, lost: list[int]) -> None:
    while not leaving.is_set():
        with suppress(TimeoutError):
            datagram = opened.recv(PART)
            try:
                waiting.put_nowait(datagram)
            except Full:
                lost[0] += 1


def _lines(datagrams: list[bytes]) -> list[bytes]:
    return [line for datagram in datagrams for line in datagram.rstrip().split(b"\n")]


def _taken(waiting: Queue[bytes]) -> list[bytes]:
    """Return what waits, or comes within a moment."""
    taken: list[bytes] = []
    with suppress(Empty):
        taken.append(waiting.get(timeout=WAIT_S))
        while len(taken) < N_AT_ONCE:
            taken.append(waiting.get_nowait())
    return taken
