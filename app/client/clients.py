"""The clients: ``GestaClient`` for plain code, ``AsyncGestaClient`` for asyncio."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from types import TracebackType
from typing import Any, Self

import httpx

from app.client.errors import ApiError, JobFailed
from app.client.requests import Request, page_path, session_events_path
from app.client.rest import Asyncio, Plain
from app.client.server_events import EventLines, Listening, ServerEvent
from app.client.stream import AsyncStream, Stream
from app.client.wire import Message

TIMEOUT_S = 60.0
PAUSE_S = 0.5
"""Before a listener comes back [s]."""
PATIENCE_S = 60.0
"""How long a listener that was cut off tries to come back [s]."""


OPEN = ("queued", "running")
"""States of a job that has not ended."""


class Waiting:
    """A job that is waited for; if it cannot be looked at, for a while."""

    def __init__(self, patience_s: float, now: float) -> None:
        self.job: Message = {}
        self._patience = patience_s
        self._heard_at = now

    @property
    def ended(self) -> bool:
        """Whether its end was seen."""
        return bool(self.job) and self.job["state"] not in OPEN

    def hear(self, job: Message, now: float) -> None:
        """Note how it is."""
        self.job = job
        self._heard_at = now

    def is_over(self, error: httpx.TransportError | ApiError, now: float) -> bool:
        """Whether to wait no more: the server refuses, or it has been away for too long."""
        refused = isinstance(error, ApiError) and not error.is_passing
        return refused or now - self._heard_at > self._patience


class GestaClient(Plain):
    """A Gesta server at ``url``; every method raises ApiError where the server refuses."""

    def __init__(self, url: str = "http://127.0.0.1:8000") -> None:
        self.url = url.rstrip("/")
        self._http = httpx.Client(base_url=self.url, timeout=TIMEOUT_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let the connections go."""
        self._http.close()

    def request(
        self, method: str, path: str, body: Any = None, headers: Mapping[str, str] | None = None
    ) -> Any:
        """Ask ``/v1{path}`` and return the parsed answer, ``{}`` where it is empty.

        What is no JSON, as asked for by an ``Accept`` header, is returned as text or as bytes.
        """
        response = self._http.request(method, f"/v1{path}", json=body, headers=dict(headers or {}))
        return _parsed(response)

    def pages(self, path: str, field: str) -> Iterator[Message]:
        """Yield every item of a paged list: ``field`` of the answers of ``/v1{path}``."""
        token = None
        while True:
            page = self.request("GET", page_path(path, token))
            yield from page[field]
            if (token := page.get("next_page_token")) is None:
                return

    def result(
        self, job_id: str, watch: Callable[[Message], object] = bool, patience_s: float = PATIENCE_S
    ) -> Message:
        """Wait for a job and return its result; ``watch`` gets every state. Raises JobFailed.

        A connection that breaks, or a server that is away, is tried anew for ``patience_s``.
        """
        waiting = Waiting(patience_s, time.monotonic())
        while True:
            try:
                for _, job in self.events(f"/jobs/{job_id}/events"):
                    watch(job)
                    waiting.hear(job, time.monotonic())
                if waiting.ended:
                    return _result(waiting.job)
            except (httpx.TransportError, ApiError) as error:
                if waiting.is_over(error, time.monotonic()):
                    raise
            time.sleep(PAUSE_S)

    def session_events(
        self, session_id: str, after: int = -1, include: str = "", patience_s: float = PATIENCE_S
    ) -> Iterator[Message]:
        """Yield a session's events after number ``after`` as they come, until it ends.

        include: ``frames``, ``hypotheses`` or both with a comma. A connection that breaks is made anew for
        ``patience_s``; each durable event is yielded once.
        """
        listening, path = Listening(after, patience_s), session_events_path(session_id, include)
        listening.begin(time.monotonic())
        while not listening.ended:
            try:
                for event in self._events(path, listening.headers):
                    yield listening.hear(event, time.monotonic())
                if listening.ended or listening.over(self.session(session_id)):
                    return
            except httpx.TransportError:
                if listening.tired(time.monotonic()):
                    raise
            time.sleep(PAUSE_S)

    def events(self, path: str, headers: Mapping[str, str] | None = None) -> Iterator[tuple[str, Message]]:
        """Yield (type, data) of the server-sent events at ``/v1{path}``."""
        for event in self._events(path, headers or {}):
            yield event.kind, event.data

    def stream(self, model: str, **start: Any) -> Stream:
        """Return a stream to enter by ``with``; start: the arguments of ``Stream``."""
        return Stream(self.url, model, **start)

    def ask(self, request: Request) -> Any:
        """Send a request and return its answer: see ``request``."""
        return self.request(*request)

    def _events(self, path: str, headers: Mapping[str, str]) -> Iterator[ServerEvent]:
        with self._http.stream("GET", f"/v1{path}", headers=dict(headers)) as response:
            if response.is_error:
                response.read()
                _parsed(response)
            lines = EventLines()
            for line in response.iter_lines():
                if (event := lines.feed(line)) is not None:
                    yield event


class AsyncGestaClient(Asyncio):
    """The same for asyncio: what returns an answer there returns a coroutine of it here."""

    def __init__(self, url: str = "http://127.0.0.1:8000") -> None:
        self.url = url.rstrip("/")
        self._http = httpx.AsyncClient(base_url=self.url, timeout=TIMEOUT_S)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Let the connections go."""
        await self._http.aclose()

    async def request(
        self, method: str, path: str, body: Any = None, headers: Mapping[str, str] | None = None
    ) -> Any:
        """Ask ``/v1{path}`` and return the parsed answer, ``{}`` where it is empty.

        What is no JSON, as asked for by an ``Accept`` header, is returned as text or as bytes.
        """
        response = await self._http.request(method, f"/v1{path}", json=body, headers=dict(headers or {}))
        return _parsed(response)

    async def pages(self, path: str, field: str) -> AsyncIterator[Message]:
        """Yield every item of a paged list: ``field`` of the answers of ``/v1{path}``."""
        token = None
        while True:
            page = await self.request("GET", page_path(path, token))
            for item in page[field]:
                yield item
            if (token := page.get("next_page_token")) is None:
                return

    async def result(
        self, job_id: str, watch: Callable[[Message], object] = bool, patience_s: float = PATIENCE_S
    ) -> Message:
        """Wait for a job and return its result: see ``GestaClient.result``."""
        waiting = Waiting(patience_s, time.monotonic())
        while True:
            try:
                async for _, job in self.events(f"/jobs/{job_id}/events"):
                    watch(job)
                    waiting.hear(job, time.monotonic())
                if waiting.ended:
                    return _result(waiting.job)
            except (httpx.TransportError, ApiError) as error:
                if waiting.is_over(error, time.monotonic()):
                    raise
            await asyncio.sleep(PAUSE_S)

    async def session_events(
        self, session_id: str, after: int = -1, include: str = "", patience_s: float = PATIENCE_S
    ) -> AsyncIterator[Message]:
        """Yield a session's events: see ``GestaClient.session_events``."""
        listening, path = Listening(after, patience_s), session_events_path(session_id, include)
        listening.begin(time.monotonic())
        while not listening.ended:
            try:
                async for event in self._events(path, listening.headers):
                    yield listening.hear(event, time.monotonic())
                if listening.ended or listening.over(await self.session(session_id)):
                    return
            except httpx.TransportError:
                if listening.tired(time.monotonic()):
                    raise
            await asyncio.sleep(PAUSE_S)

    async def events(
        self, path: str, headers: Mapping[str, str] | None = None
    ) -> AsyncIterator[tuple[str, Message]]:
        """Yield (type, data) of the server-sent events at ``/v1{path}``."""
        async for event in self._events(path, headers or {}):
            yield event.kind, event.data

    def stream(self, model: str, **start: Any) -> AsyncStream:
        """Return a stream to enter by ``async with``; start: the arguments of ``AsyncStream``."""
        return AsyncStream(self.url, model, **start)

    async def ask(self, request: Request) -> Any:
        """Send a request and return its answer: see ``request``."""
        return await self.request(*request)

    async def _events(self, path: str, headers: Mapping[str, str]) -> AsyncIterator[ServerEvent]:
        async with self._http.stream("GET", f"/v1{path}", headers=dict(headers)) as response:
            if response.is_error:
                await response.aread()
                _parsed(response)
            lines = EventLines()
            async for line in response.aiter_lines():
                if (event := lines.feed(line)) is not None:
                    yield event


def _parsed(response: httpx.Response) -> Any:
    if response.is_error:
        is_problem = response.headers.get("content-type", "").startswith("application/problem+json")
        raise ApiError(
            response.status_code, response.json() if is_problem else {"detail": response.text[:200]}
        )
    kind = response.headers.get("content-type", "").partition(";")[0]
    if not response.content or kind.endswith("json"):
        return response.json() if response.content else {}
    return response.text if kind.startswith("text/") else response.content


def _result(job: Message) -> Message:
    if job["state"] != "succeeded":
        raise JobFailed(job)
    result: Message = job["result"]
    return result
