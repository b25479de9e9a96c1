"""Checkpoints: a recogniser's state as bytes, from which another process goes on."""

from __future__ import annotations

import io
from dataclasses import dataclass
from zipfile import BadZipFile

import numpy as np

from app.motion.errors import InvalidState
from app.motion.state import State
from app.registry.records import Checkpoint


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of a session's recogniser after so many frames, which gave so many events."""

    n_frames: int
    n_events: int
    n_segments: int
    state: State

    def packed(self) -> Checkpoint:
        """Return it as it is kept."""
        file = io.BytesIO()
        np.savez(file, **self.state)  # type: ignore[arg-type]  # every name is that of an array
        return Checkpoint(self.n_frames, self.n_events, self.n_segments, file.getvalue())


def state_of(checkpoint: Checkpoint) -> State:
    """Return the state that was packed. Raises InvalidState for bytes that are none."""
    try:
        with np.load(io.BytesIO(checkpoint.state)) as arrays:
            return dict(arrays)
    except (BadZipFile, EOFError, ValueError) as error:
        raise InvalidState(f"cannot be read: {error}") from error
