"""What a recogniser decides, as the numbered durable events of its session."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from app.motion.recogniser import Event, SegmentEvent
from app.registry.records import StoredEvent
from app.service import messages


class Decisions:
    """Counts the events and the segments of a session, and gives each event its text."""

    def __init__(self, model: str, version: int, n_events: int = 0, n_segments: int = 0) -> None:
        self.n_events = n_events
        self.n_segments = n_segments
        self._model = model
        self._version = version

    def take(self, events: Sequence[Event]) -> list[StoredEvent]:
        """Return what follows from events of the recogniser."""
        return [self._stored(event) for event in events]

    def end(self, n_frames: int) -> StoredEvent:
        """Return the last event of all."""
        return self._add("ended", {"segments": self.n_segments, "frames": n_frames})

    def _stored(self, event: Event) -> StoredEvent:
        if not isinstance(event, SegmentEvent):
            return self._add("gap", messages.gap(event))
        self.n_segments += 1
        return self._add("segment", messages.segment(event, self.n_segments - 1, self._model, self._version))

    def _add(self, kind: str, fields: dict[str, Any]) -> StoredEvent:
        text = messages.as_json({"type": kind, "event": self.n_events, **fields})
        self.n_events += 1
        return StoredEvent(self.n_events - 1, kind, text)
