"""``GET /v1/stream``: frames in, decisions out, over one WebSocket (subprotocol ``gesta.v1``).

One connection is a handful of tasks. The *reader* lets the session compute what it reads there and then, and
then lets the other connections have their turn, so that a flood of one starves nobody. What cannot be done at
once goes into a bounded queue, a full queue stops the reader; the *worker* takes it from there in order.

What goes out is written by tasks of its own: durable events in order, hypotheses and acknowledgements with
what is newest when their turn comes. Each waits for the client at most ``Limits.send``: a client that does
not read harms nobody else.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Coroutine
from dataclasses import replace
from typing import Any, NoReturn

from fastapi import APIRouter, WebSocket
from starlette.websockets import WebSocketDisconnect

from app.api.problems import problem
from app.api.stream_closing import Closing, Idle, NotReading, TooBig, closing_of
from app.api.stream_messages import Control, End, Flush, Ping, Start, read, read_start
from app.registry.errors import Unavailable
from app.service.frames import Frames, Layout
from app.service.live import Attachment, LiveSessions
from app.service.mark import Mark
from app.service.messages import as_json
from app.service.session import Session
from app.service.session_errors import Restarting, SessionError, SessionGone

SUBPROTOCOL = "gesta.v1"
QUEUE = 4
"""Messages that wait to be computed."""
ACKNOWLEDGE = 0.2
"""Shortest time between two ``accepted`` [s]."""
FAREWELL = 30.0
"""How long a client has to take the last words; nothing but its own socket is held [s]."""

log = logging.getLogger(__name__)
router = APIRouter()


@router.websocket("/v1/stream")
async def stream(socket: WebSocket) -> None:
    """Serve one connection."""
    live: LiveSessions = socket.app.state.live
    offered = socket.scope["subprotocols"]
    if live.draining.is_set():
        await _deny(socket, 503, "restarting", "the server is restarting")
    elif offered and SUBPROTOCOL not in offered:
        await _deny(socket, 400, "unknown_subprotocol", f"the stream speaks {SUBPROTOCOL}")
    else:
        await socket.accept(subprotocol=SUBPROTOCOL if offered else None)
        await _Door(socket, live).serve()


async def _deny(socket: WebSocket, status: int, code: str, detail: str) -> None:
    headers = {"Retry-After": "1"} if status == 503 else None
    await socket.send_denial_response(problem(status, code, detail, headers=headers))


class _Wire:
    """The socket: messages one at a time, none longer than allowed, none waited for for ever."""

    def __init__(self, socket: WebSocket, live: LiveSessions) -> None:
        self._socket = socket
        self._limits = live.limits
        self._turn = asyncio.Lock()
        self._open = True
        self.silent_since: float | None = None

    async def receive(self) -> str | bytes:
        """Return the next message. Raises WebSocketDisconnect, TooBig."""
        self.silent_since = asyncio.get_running_loop().time()
        received = await self._socket.receive()
        self.silent_since = None
        if received["type"] == "websocket.disconnect":
            self._open = False
            raise WebSocketDisconnect(received["code"])
        message: str | bytes | None = received.get("text")
        message = received["bytes"] if message is None else message
        size = len(message) if isinstance(message, bytes) or message.isascii() else len(message.encode())
        if size > self._limits.message_bytes:
            raise TooBig(f"a message of {size} bytes is longer than {self._limits.message_bytes}")
        return message

    async def send(self, text: str) -> None:
        """Send; what a client that has gone would get is dropped. Raises NotReading."""
        try:
            async with asyncio.timeout(self._limits.send), self._turn:
                if self._open:
                    await self._socket.send({"type": "websocket.send", "text": text})
        except TimeoutError:
            raise NotReading from None
        except WebSocketDisconnect:
            self._open = False

    async def say(self, kind: str, **fields: Any) -> None:
        """Send a message made of plain fields."""
        await self.send(as_json({"type": kind, **fields}))

    async def close(self, closing: Closing) -> None:
        """Say why, and close."""
        try:
            async with asyncio.timeout(FAREWELL):
                if closing.error is not None:
                    await self._socket.send_text(as_json({"type": "error", **closing.error}))
                await self._socket.close(closing.code, closing.reason)
        except (TimeoutError, WebSocketDisconnect, RuntimeError):
            log.info("a client went before it was told: %s", closing.reason)


class _Door:
    """From accept to close: whatever ends a connection becomes its last words here."""

    def __init__(self, socket: WebSocket, live: LiveSessions) -> None:
        self._wire = _Wire(socket, live)
        self._live = live

    async def serve(self) -> None:
        """Serve the connection to its end."""
        error: Exception | None = None
        try:
            await self._converse()
        except WebSocketDisconnect:
            return
        except Exception as caught:
            error = caught
        closing = closing_of(error)
        if closing.code == 1011:
            log.error("a stream ended by an internal error", exc_info=error)
        await self._wire.close(closing)

    async def _converse(self) -> None:
        start = read_start(await self._first())
        attachment, token = await self._attach(start)
        connection = _Connection(self._wire, self._live, attachment, start)
        try:
            await connection.run(token)
        except SessionGone:
            await connection.tell_the_rest()
        except (SessionError, WebSocketDisconnect, Unavailable):
            raise
        except Exception:
            self._live.abandon(attachment.session)
            raise
        finally:
            self._live.leave(attachment)

    async def _first(self) -> str | bytes:
        try:
            async with asyncio.timeout(self._live.limits.idle):
                return await self._wire.receive()
        except TimeoutError:
            raise Idle(self._live.limits.idle) from None

    async def _attach(self, start: Start) -> tuple[Attachment, str]:
        if start.resume is None:
            return await self._live.open(start.wish())
        ticket = start.ticket(start.resume)
        return await self._live.resume(ticket), ticket.token


class _Connection:
    """One connection attached to one session."""

    def __init__(self, wire: _Wire, live: LiveSessions, attachment: Attachment, start: Start) -> None:
        self._wire = wire
        self._live = live
        self._attachment = attachment
        self._start = start
        self._session: Session = attachment.session
        self._layout: Layout = replace(self._session.pinned.layout, encoding=start.encoding)
        self._queue: asyncio.Queue[Frames | Control | Exception] = asyncio.Queue(QUEUE)
        self._working = asyncio.Lock()
        self._told = Mark(start.resume.last_event + 1 if start.resume else 0)

    async def run(self, token: str) -> None:
        """Serve until the session has ended, which is told. Raises what ends the connection before."""
        await self._welcome(token)
        jobs: list[Coroutine[Any, Any, None]] = [self._work(), self._tell_events(), self._acknowledge()]
        jobs += [self._attachment.revoked(), self._drain(), self._listen()]
        if self._start.options.hypotheses:
            jobs.append(self._guess())
        reader = asyncio.create_task(self._read())
        tasks = [asyncio.create_task(job) for job in jobs]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (reader, *tasks):
                task.cancel()
            await asyncio.gather(reader, *tasks, return_exceptions=True)
        for task in done:
            task.result()

    async def tell_the_rest(self) -> None:
        """Tell the events of a session that was ended elsewhere, ``ended`` the last."""
        async for stored in self._live.events(self._session.pinned.session_id, self._told.value - 1):
            await self._wire.send(stored.text)

    async def _welcome(self, token: str) -> None:
        pinned, limits = self._session.pinned, self._live.limits
        await self._wire.say(
            "started",
            session_id=pinned.session_id,
            resume_token=token,
            next_seq=self._session.next_seq,
            model=pinned.model,
            version=pinned.version,
            actions=pinned.actions,
            channels=self._layout.channels,
            geometry={
                "length_unit": self._start.geometry.length_unit,
                "up_axis": self._start.geometry.up_axis,
            },
            limits={
                "max_frame_bytes": limits.message_bytes,
                "max_frames_per_message": limits.message_frames,
                "max_unacked_frames": limits.unacked_frames,
            },
        )
        for code, detail in pinned.warnings:
            await self._wire.say("warning", code=code, detail=detail)

    async def _read(self) -> None:
        """Let the session take what comes; what ends the reading is queued, behind all that came before."""
        try:
            while True:
                message = read(await self._wire.receive(), self._layout)
                if isinstance(message, Ping):
                    await self._wire.say("pong", id=message.id)
                elif isinstance(message, Frames) and self._take_at_once(message):
                    await asyncio.sleep(0)
                else:
                    await self._queue.put(message)
        except Exception as error:
            await self._queue.put(error)

    def _take_at_once(self, frames: Frames) -> bool:
        """Return whether frames could be taken there and then: nothing waits before them."""
        if len(frames) > (limit := self._live.limits.message_frames):
            raise TooBig(f"{len(frames)} frames are more than {limit} a message")
        return not self._working.locked() and self._queue.empty() and self._session.take_at_once(frames)

    async def _work(self) -> None:
        while True:
            message = await self._queue.get()
            async with self._working:
                if isinstance(message, Exception):
                    raise message
                if isinstance(message, Frames):
                    await self._session.take(message)
                elif isinstance(message, Flush):
                    await self._all_told()
                    await self._wire.say("flushed", id=message.id)
                elif isinstance(message, End):
                    await self._session.end(message.last_seq)
                    await self._all_told()
                    return

    async def _listen(self) -> NoReturn:
        """Wait until the client has said nothing for too long, with nothing left to do. Raises Idle."""
        loop, limit = asyncio.get_running_loop(), self._live.limits.idle
        while True:
            since, is_busy = self._wire.silent_since, self._working.locked() or not self._queue.empty()
            if since is None or is_busy:
                since = loop.time()
            if loop.time() - since >= limit:
                raise Idle(limit)
            await asyncio.sleep(since + limit - loop.time())

    async def _all_told(self) -> None:
        await self._session.saved()
        await self._told.beyond(self._session.events.value - 1)

    async def _tell_events(self) -> None:
        async for stored in self._session.events_after(self._told.value - 1):
            await self._wire.send(stored.text)
            self._told.advance(stored.event + 1)

    async def _acknowledge(self) -> None:
        session, seen = self._session, -1
        while True:
            seen = await session.moved.beyond(seen)
            through, durable = session.next_seq - 1, session.frames_durable.value - 1
            await self._wire.say("accepted", through_seq=through, durable_seq=durable)
            await asyncio.sleep(ACKNOWLEDGE)

    async def _guess(self) -> None:
        async for text in self._session.hypotheses(self._start.options.hypotheses_hz):
            await self._wire.send(text)

    async def _drain(self) -> NoReturn:
        await self._live.draining.wait()
        await self._wire.say("going_away", seconds_left=self._live.limits.drain)
        async with self._working:
            await self._all_told()
            raise Restarting
