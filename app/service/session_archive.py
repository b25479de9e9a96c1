"""What is known of sessions, live or over: records, segments, and the frames for as long as they are kept."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.motion.trajectory import Floats, Trajectory
from app.registry import sessions
from app.registry.errors import NotFound
from app.registry.records import Chunk, Page, SessionRecord, SessionState, StoredEvent
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


def segment(lab: Lab, session_id: str, number: int) -> dict[str, Any]:
    """Return the fields of a segment of a session. Raises NotFound."""
    with lab.database.reading() as tx:
        found = sessions.segments(tx, session_id, after=number - 1, limit=1)
    fields: dict[str, Any] = json.loads(found[0].text) if found else {}
    if fields.get("segment") != number:
        raise NotFound("segment", f"{session_id}/{number}")
    return fields


def recording(lab: Lab, session_id: str) -> SessionRecording:
    """Return the durable frames of a session. Raises NotFound, RecordingGone."""
    with lab.database.reading() as tx:
        record = sessions.get(tx, session_id)
        chunks = sessions.chunks(tx, session_id)
    times, tracks = _frames(record, chunks)
    return SessionRecording(record, times, tracks)


def part(lab: Lab, session_id: str, start: int, stop: int) -> Trajectory:
    """Return the durable ones of frames ``start..stop-1``, at least one. Raises NotFound, RecordingGone."""
    with lab.database.reading() as tx:
        record = sessions.get(tx, session_id)
        chunks = sessions.chunks(tx, session_id, start=start, stop=stop)
    times, tracks = _frames(record, chunks)
    offset = chunks[0].first_seq
    hand, *objects = (track[start - offset : stop - offset] for track in tracks.values())
    named = dict(zip(objects_of(record), objects, strict=True))
    return Trajectory(times[start - offset : stop - offset], hand, named)


def _frames(record: SessionRecord, chunks: Sequence[Chunk]) -> tuple[Floats, dict[str, Floats]]:
    """Return times (n,) and tracks, name -> (n, 3), the hand's first. Raises RecordingGone."""
    if not record.frames_kept:
        raise RecordingGone(record.id)
    rows = np.frombuffer(b"".join(chunk.rows for chunk in chunks), "<f8").reshape(-1, len(record.channels))
    names = ("hand", *objects_of(record))
    return rows[:, 0], {name: rows[:, 1 + 3 * index : 4 + 3 * index] for index, name in enumerate(names)}


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
