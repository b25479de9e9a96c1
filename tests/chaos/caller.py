"""A client of the REST API that asks until it is answered."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Self
from urllib.parse import quote

import httpx

from tests.talking import Message

RETRY_S = 0.05
PATIENCE_S = 60.0
"""How long an answer is waited for, and asked for again and again [s]."""


class Refused(Exception):
    """The server has refused what it should take, or cannot work for longer than a client waits."""


class Left(Exception):
    """The client was told to leave before it was answered."""


class Caller:
    """Asks the server that ``url()`` names, again where it is away or says that it cannot work."""

    def __init__(
        self, url: Callable[[], str], leaving: threading.Event | None = None, patience: float = PATIENCE_S
    ) -> None:
        self._url, self._leaving, self.patience = url, leaving or threading.Event(), patience
        self._http = httpx.Client(timeout=PATIENCE_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let the connections go."""
        self._http.close()

    def insist(
        self, method: str, path: str, body: Any = None, headers: Mapping[str, str] | None = None
    ) -> Message:
        """Return the answer of ``/v1{path}``, however often it has to be asked for. Raises Refused, Left."""
        until, heard = time.monotonic() + self.patience, ""
        while time.monotonic() < until:
            try:
                answer = self._http.request(
                    method, self._address(path), json=body, headers=dict(headers or {})
                )
            except httpx.TransportError as error:
                heard = repr(error)
            else:
                if answer.status_code < 400:
                    told: Message = answer.json() if answer.content else {}
                    return told
                heard = f"{answer.status_code} {answer.text}"
                if answer.status_code < 500:
                    break
            if self._leaving.wait(RETRY_S):
                raise Left
        raise Refused(f"{method} {path}: {heard}")

    @contextmanager
    def stream(self, path: str, headers: Mapping[str, str], silence: float) -> Iterator[httpx.Response]:
        """Give an answer that is read as it comes; silence: longest time without a word [s]."""
        with self._http.stream("GET", self._address(path), headers=dict(headers), timeout=silence) as answer:
            yield answer

    def _address(self, path: str) -> str:
        return f"{self._url()}/v1{path}"

    def pages(self, path: str, field: str) -> Iterator[Message]:
        """Yield every item of a paged list."""
        token, joint = "", "&" if "?" in path else "?"
        while True:
            page = self.insist("GET", f"{path}{joint}page_size=100{token}")
            yield from page[field]
            if page["next_page_token"] is None:
                return
            token = f"&page_token={quote(page['next_page_token'], safe='')}"
