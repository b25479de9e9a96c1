"""What was a session of another process, ready to go on in this one.

It goes on where its durable frames end. Its recogniser starts from the newest checkpoint and sees the frames
behind it once more. The events of these are durable already; what follows is what would have followed without
a break, bit for bit.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from app.motion.model import Model
from app.motion.recogniser import Recogniser
from app.motion.trajectory import Floats
from app.registry import sessions
from app.registry.records import Checkpoint, SessionRecord
from app.service.checkpoints import state_of
from app.service.lab import Lab
from app.service.session import Pinned, Standing
from app.service.session_start import pinned_before, recogniser_of

PART = 1000
"""Frames that a recogniser sees at once where it sees them again."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Opened:
    """A session that begins to live in this process."""

    pinned: Pinned
    recogniser: Recogniser
    token_digest: str
    standing: Standing


def restored(lab: Lab, record: SessionRecord, model: Model) -> Opened:
    """Return a session that this process has taken on, or one that is over."""
    pinned, newest = pinned_before(record, model), np.empty(0)
    recogniser, seen = recogniser_of(model, pinned), Checkpoint(0, 0, 0, b"")
    if record.state == "active":
        with lab.database.reading() as tx:
            checkpoint = sessions.checkpoint(tx, record.id)
        if checkpoint is not None and (ready := _at(checkpoint, model, pinned)) is not None:
            recogniser, seen = ready, checkpoint
        newest, n_events = _see_again(lab, record, recogniser, seen.n_frames)
        if seen.n_events + n_events != record.n_events:
            log.error("session %s: %d events once more, not %d", record.id, n_events, record.n_events)
    standing = Standing(
        epoch=record.epoch,
        n_frames=record.n_frames,
        n_events=record.n_events,
        n_segments=record.n_segments,
        newest=newest,
        ended=record.state != "active",
    )
    return Opened(pinned, recogniser, record.token_hash, standing)


def _at(checkpoint: Checkpoint, model: Model, pinned: Pinned) -> Recogniser | None:
    """Return a recogniser at a checkpoint; None where that cannot be, for one of another release."""
    recogniser = recogniser_of(model, pinned)
    try:
        recogniser.restore(state_of(checkpoint))
    except (ValueError, KeyError) as error:
        log.warning("session %s: all its frames are seen again: %s", pinned.session_id, error)
        return None
    return recogniser


def _see_again(lab: Lab, record: SessionRecord, recogniser: Recogniser, start: int) -> tuple[Floats, int]:
    """Let a recogniser see the durable frames from ``start`` on; return the last, and how many events."""
    with lab.database.reading() as tx:
        chunks = sessions.chunks(tx, record.id, start=max(start - 1, 0), stop=record.n_frames)
    rows = np.frombuffer(b"".join(chunk.rows for chunk in chunks), "<f8").reshape(-1, len(record.channels))
    if len(rows) == 0:
        return np.empty(0), 0
    fresh, n_events = rows[start - chunks[0].first_seq :], 0
    for begin in range(0, len(fresh), PART):
        part = fresh[begin : begin + PART]
        n_events += len(recogniser.take(part[:, 0], part[:, 1:].reshape(len(part), -1, 3)))
    return rows[-1], n_events
