"""Server-sent events, line by line."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ServerEvent:
    """One event: what it is called, its data, its id if it has one."""

    kind: str
    data: Any
    id: str | None


class EventLines:
    """Makes events of the lines of a response."""

    def __init__(self) -> None:
        self._kind = "message"
        self._id: str | None = None
        self._data: list[str] = []

    def feed(self, line: str) -> ServerEvent | None:
        """Take the next line, without its end; return the event that it completes."""
        field, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if field == "event":
            self._kind = value
        elif field == "id":
            self._id = value
        elif field == "data":
            self._data.append(value)
        elif not line and self._data:
            event = ServerEvent(self._kind, json.loads("\n".join(self._data)), self._id)
            self._kind, self._id, self._data = "message", None, []
            return event
        return None


class Listening:
    """Where a listener to a session is; it comes back where it was cut off, for a while."""

    def __init__(self, after: int, patience_s: float) -> None:
        self.last = after
        self.ended = False
        self._patience = patience_s
        self._heard_at = 0.0

    @property
    def headers(self) -> dict[str, str]:
        """What asks for the events not heard yet."""
        return {"Last-Event-ID": str(self.last)}

    def hear(self, event: ServerEvent, now: float) -> Any:
        """Note an event and return its data."""
        self._heard_at = now
        if event.id is not None:
            self.last = int(event.id)
        self.ended = event.kind == "ended"
        return event.data

    def begin(self, now: float) -> None:
        """Begin to wait."""
        self._heard_at = now

    def tired(self, now: float) -> bool:
        """Whether nothing has been heard for too long."""
        return now - self._heard_at > self._patience

    def over(self, session: Mapping[str, Any]) -> bool:
        """Whether nothing more can come from a session."""
        return session["state"] != "active" and int(session["events"]) <= self.last + 1
