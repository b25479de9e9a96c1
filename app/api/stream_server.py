"""The web server under the stream: uvicorn with the options that a stream needs, and an end in order.

uvicorn alone closes every socket as soon as it is told to stop. Here the sessions are drained first: clients
hear ``going_away``, what is decided becomes durable, and each stream closes by itself.
"""

from __future__ import annotations

import asyncio
import gc
import math
import socket
from contextlib import suppress
from typing import Any

import uvicorn
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from app.api.supervisor import LEAVE, READY

LARGEST = 4 << 20
"""A message longer than this [bytes] closes the connection unread, without an ``error``."""
LINGER = 30.0
"""How long a connection that is over may take to let go [s]."""
NOT_UTF8 = "\ufffd"
"""No message of a client: it is no JSON."""
GRACE = 10
"""How long a server that stops waits for requests under way, from when it is told [s]."""
SETTLE = 0.1
"""How long a server that stops waits for the first request of a connection that it has just accepted [s]."""


class StreamProtocol(WebSocketsSansIOProtocol):
    """A WebSocket that is cut where its client does not take the last words.

    Text that is no UTF-8 reaches the app as ``NOT_UTF8``, so that the app refuses it like any bad message.
    """

    def send_receive_event_to_app(self) -> None:
        """Hand over a whole message."""
        if self.curr_msg_data_type == "text":
            try:
                b"".join(self.frames).decode()
            except UnicodeDecodeError:
                self.frames = [NOT_UTF8.encode()]
        super().send_receive_event_to_app()

    async def run_asgi(self) -> None:
        """Serve the connection."""
        await super().run_asgi()
        self.loop.call_later(LINGER, self.transport.abort)


class StreamServer(uvicorn.Server):
    """A server that drains its sessions before it closes its sockets.

    The app's lifespan gives ``drain``, a coroutine function, in its state; the server adds ``leave``.
    line: to the supervisor, where this is one of several servers.
    """

    def __init__(self, config: uvicorn.Config, line: socket.socket | None = None) -> None:
        super().__init__(config)
        self._line = line

    def leave(self) -> None:
        """Drain and stop; where there are several servers, all of them."""
        if self._line is None:
            self.should_exit = True
        else:
            self._say(self._line, LEAVE)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Get ready; what is loaded by then stays, and the garbage collector need not look at it again.

        To look at all of it takes a tenth of a second, in which no frame is recognised.
        """
        self.lifespan.state["leave"] = self.leave
        await super().startup(sockets)
        gc.collect()
        gc.freeze()
        if self._line is not None:
            self._line.setblocking(False)
            asyncio.get_running_loop().add_reader(self._line, self._cut_off, self._line)
            self._say(self._line, READY)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Stop accepting, drain, close; what is asked in the meantime is answered, and not to be followed."""
        loop = asyncio.get_running_loop()
        told = loop.time()
        for server in self.servers:
            server.close()
        draining = asyncio.ensure_future(self.lifespan.state["drain"]())
        # Once the draining has begun no WebSocket is accepted, whose answer must not have this header.
        await asyncio.sleep(0)
        self.server_state.default_headers = [*self.server_state.default_headers, (b"connection", b"close")]
        await asyncio.sleep(SETTLE)
        await draining
        self.config.timeout_graceful_shutdown = max(1, math.ceil(told + GRACE - loop.time()))
        await super().shutdown(sockets)

    def _say(self, line: socket.socket, word: bytes) -> None:
        with suppress(ConnectionError):  # then the line is cut, which is heard
            line.send(word)

    def _cut_off(self, line: socket.socket) -> None:
        """Leave: the supervisor, who says nothing, has died."""
        asyncio.get_running_loop().remove_reader(line)
        self.should_exit = True


def stream_config(app: Any, **options: Any) -> uvicorn.Config:
    """Return the configuration of a ``StreamServer``; app, options: as uvicorn.Config takes them."""
    return uvicorn.Config(
        app,
        ws=StreamProtocol,
        ws_max_size=LARGEST,
        ws_ping_interval=20.0,
        ws_ping_timeout=60.0,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=GRACE,
        **options,
    )
