"""A way to the server that can be cut."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from urllib.parse import urlsplit

from tests.serving import Server


class Wire:
    """Passes bytes between clients and the server; ``cut`` ends every connection without a word."""

    def __init__(self, listener: socket.socket, server: Server) -> None:
        self.url = f"http://127.0.0.1:{listener.getsockname()[1]}"
        self._target = urlsplit(server.url).hostname, urlsplit(server.url).port
        self._listener = listener
        self._ends: list[socket.socket] = []
        self.connections: list[threading.Thread] = []
        self._whole = threading.Event()
        self._whole.set()

    def cut(self) -> None:
        """End every connection."""
        ends, self._ends = self._ends, []
        for end in ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    @contextmanager
    def broken(self) -> Iterator[None]:
        """Cut, and let nobody connect for as long as the block lasts."""
        self._whole.clear()
        self.cut()
        try:
            yield
        finally:
            self._whole.set()

    def serve(self) -> None:
        """Accept connections until the listener is closed."""
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            if not self._whole.is_set():
                near.close()
                continue
            far = socket.create_connection(self._target)
            self._ends += [near, far]
            self.connections.append(threading.Thread(target=_join, args=(near, far)))
            self.connections[-1].start()


def _join(near: socket.socket, far: socket.socket) -> None:
    with near, far:
        back = threading.Thread(target=_pass, args=(far, near))
        back.start()
        _pass(near, far)
        back.join()


def _pass(source: socket.socket, sink: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(1 << 16):
            sink.sendall(data)
    for end in (source, sink):
        with suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)


@contextmanager
def wire_to(server: Server) -> Iterator[Wire]:
    """Open a way to the server."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        wire = Wire(listener, server)
        thread = threading.Thread(target=wire.serve, daemon=True)
        thread.start()
        try:
            yield wire
        finally:
            wire.cut()
            listener.shutdown(socket.SHUT_RDWR)
            thread.join()
            for connection in wire.connections:
                connection.join()
