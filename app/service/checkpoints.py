"""Checkpoints: a recogniser's state as bytes, from which another process goes on.

A line of JSON says the name, the type and the shape of every array; their values follow, one after the other.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

from app.motion.errors import InvalidState
from app.motion.state import State
from app.registry.records import Checkpoint

TYPES = ("<f8", "<i8", "|b1")
"""What a state is made of; nothing else is read."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of a session's recogniser after so many frames, which gave so many events."""

    n_frames: int
    n_events: int
    n_segments: int
    state: State

    def packed(self) -> Checkpoint:
        """Return it as it is kept."""
        heading = [(name, array.dtype.str, array.shape) for name, array in self.state.items()]
        parts = [json.dumps(heading).encode(), *(array.tobytes() for array in self.state.values())]
        return Checkpoint(
            self.n_frames, self.n_events, self.n_segments, parts[0] + b"\n" + b"".join(parts[1:])
        )


def state_of(checkpoint: Checkpoint) -> State:
    """Return the state that was packed. Raises InvalidState for bytes that are none."""
    heading, _, values = checkpoint.state.partition(b"\n")
    state, begin = State(), 0
    try:
        for name, kind, shape in json.loads(heading):
            if kind not in TYPES:
                raise InvalidState(f"has a {name} of type {kind!r}")
            n_values = int(np.prod(shape, dtype=np.int64))
            array = np.frombuffer(values, kind, n_values, begin)
            state[name], begin = array.reshape(shape).copy(), begin + array.nbytes
    except (ValueError, TypeError) as error:
        raise InvalidState(f"cannot be read: {error}") from error
    return state
