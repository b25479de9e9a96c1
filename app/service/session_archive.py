"""What is known of sessions, live or over: records, segments, and the frames for as long as they are kept."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.motion.trajectory import Floats
from app.registry import sessions
from app.registry.records import Page, SessionRecord, SessionState, StoredEvent
from app.service.errors import RecordingGone
from app.service.lab import Lab

PIECE = 4096
"""Frames that are written as text at once."""


@dataclass(frozen=True, eq=False)
class SessionRecording:
    """The durable frames of a session.

    times: (n_frames,) [s]; tracks: name -> (n_frames, 3) [m], Z up, the hand's first.
    """

    record: SessionRecord
    times: Floats
    tracks: dict[str, Floats]

    def trajectory(self) -> Iterator[str]:
        """Yield the frames as the JSON text of a trajectory, piece by piece; a dropout is null."""
        hand, *objects = self.tracks.items()
        yield '{"t":'
        yield from _list(self.times)
        yield f',"{hand[0]}":'
        yield from _list(hand[1])
        yield ',"objects":{'
        for index, (name, track) in enumerate(objects):
            yield f"{',' if index else ''}{json.dumps(name)}:"
            yield from _list(track)
        yield "}}"


def page(
    lab: Lab, *, size: int, after: str | None, state: SessionState | None, name: str | None
) -> Page[SessionRecord]:
    """List sessions, newest first. Raises InvalidPageToken."""
    with lab.database.reading() as tx:
        return sessions.page(tx, size=size, after=after, state=state, name=name)


def get(lab: Lab, session_id: str) -> SessionRecord:
    """Return a session. Raises NotFound."""
    with lab.database.reading() as tx:
        return sessions.get(tx, session_id)


def objects_of(record: SessionRecord) -> tuple[str, ...]:
    """Return the names of the objects in the frames of a session."""
    return tuple(channel.removesuffix(".x") for channel in record.channels[4::3])


def segments(lab: Lab, session_id: str, after: int) -> tuple[StoredEvent, ...]:
    """Return the segments of a session after number ``after``. Raises NotFound."""
    with lab.database.reading() as tx:
        return sessions.segments(tx, session_id, after=after)


def recording(lab: Lab, session_id: str) -> SessionRecording:
    """Return the durable frames of a session. Raises NotFound, RecordingGone."""
    with lab.database.reading() as tx:
        record = sessions.get(tx, session_id)
        chunks = sessions.chunks(tx, session_id)
    if not record.frames_kept:
        raise RecordingGone(session_id)
    rows = np.frombuffer(b"".join(chunk.rows for chunk in chunks), "<f8").reshape(-1, len(record.channels))
    names = ("hand", *objects_of(record))
    tracks = {name: rows[:, 1 + 3 * index : 4 + 3 * index] for index, name in enumerate(names)}
    return SessionRecording(record, rows[:, 0], tracks)


def _list(values: Floats) -> Iterator[str]:
    """Yield the JSON text of times (n,) or positions (n, 3)."""
    yield "["
    for begin in range(0, len(values), PIECE):
        piece = values[begin : begin + PIECE].tolist()
        if values.ndim > 1:
            piece = [None if position[0] != position[0] else position for position in piece]
        text = json.dumps(piece, separators=(",", ":"), allow_nan=False)
        yield f"{',' if begin else ''}{text[1:-1]}"
    yield "]"
