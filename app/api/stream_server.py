"""The web server under the stream: uvicorn with the options that a stream needs, and an end in order.

uvicorn alone closes every socket as soon as it is told to stop. Here the sessions are drained first: clients
hear ``going_away``, what is decided becomes durable, and each stream closes by itself.
"""

from __future__ import annotations

import gc
import socket
from typing import Any

import uvicorn
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

LARGEST = 4 << 20
"""A message longer than this [bytes] closes the connection unread, without an ``error``."""
LINGER = 30.0
"""How long a connection that is over may take to let go [s]."""
NOT_UTF8 = "\ufffd"
"""No message of a client: it is no JSON."""
GRACE = 10
"""How long a server that stops waits for requests under way [s]."""


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

    The app's lifespan gives ``drain``, a coroutine function, in its state.
    """

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Get ready; what is loaded by then stays, and the garbage collector need not look at it again.

        To look at all of it takes a tenth of a second, in which no frame is recognised.
        """
        await super().startup(sockets)
        gc.collect()
        gc.freeze()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Stop accepting, drain, close."""
        for server in self.servers:
            server.close()
        await self.lifespan.state["drain"]()
        await super().shutdown(sockets)


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
