"""What a session says, as server-sent events: for those who listen while another client streams."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator, Collection
from typing import Any, Literal

from fastapi.sse import format_sse_event
from starlette.responses import StreamingResponse

from app.registry.records import StoredEvent
from app.service.live import LiveSessions
from app.service.session_errors import SessionError

Provisional = Literal["frames", "hypotheses"]
RATE_HZ = 20.0
"""Provisional events come at most at this rate [Hz]."""


class EventStream(StreamingResponse):
    """Events as they come."""

    media_type = "text/event-stream"


async def listen(
    live: LiveSessions, session_id: str, after: int, include: Collection[Provisional]
) -> AsyncIterator[bytes]:
    """Yield the durable events after number ``after`` and what else is included, until the session ends.

    It breaks off where the server goes away or the session moves: the listener comes back and goes on.
    Provisional events come from sessions of this process only.
    """
    durable = _durable(live, session_id, after)
    sources = [durable]
    if (session := live.get(session_id)) is not None and not session.ended:
        if "frames" in include:
            sources.append(_provisional("frame", session.frames(RATE_HZ)))
        if "hypotheses" in include:
            sources.append(_provisional("hypothesis", session.hypotheses(RATE_HZ)))
    next_of = {asyncio.ensure_future(anext(source, None)): source for source in sources}
    leaving = asyncio.ensure_future(live.draining.wait())
    try:
        while not leaving.done():
            done, _ = await asyncio.wait(
                {leaving, *next_of}, timeout=live.limits.keep_alive, return_when=asyncio.FIRST_COMPLETED
            )
            if not done:
                yield format_sse_event(data_str=None, comment="keep-alive")
            for task in [task for task in next_of if task.done()]:
                source, text = next_of.pop(task), task.result()
                if text is None:
                    return
                yield text
                next_of[asyncio.ensure_future(anext(source, None))] = source
    except SessionError:
        return
    finally:
        await _let_go({leaving, *next_of}, sources)


async def _let_go(
    tasks: Collection[asyncio.Future[Any]], sources: Collection[AsyncGenerator[bytes, None]]
) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    for source in sources:
        await source.aclose()


async def _durable(live: LiveSessions, session_id: str, after: int) -> AsyncGenerator[bytes, None]:
    async for stored in live.events(session_id, after):
        yield _event(stored)


async def _provisional(kind: str, texts: AsyncIterator[str]) -> AsyncGenerator[bytes, None]:
    async for text in texts:
        yield format_sse_event(data_str=text, event=kind)


def _event(stored: StoredEvent) -> bytes:
    return format_sse_event(data_str=stored.text, event=stored.type, id=str(stored.event))
