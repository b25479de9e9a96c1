"""What a recogniser is in the midst of, as named arrays: all that the frames before have left behind.

Put back into a new recogniser of the same stream it goes on bit for bit, as if it had seen them.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from app.motion.errors import InvalidState

FORMAT = 1
"""Counted up whenever a state of before cannot be gone on with, be it that the arithmetic has changed."""

State = dict[str, NDArray[Any]]


class Stateful(Protocol):
    """What frames leave something behind in."""

    def state(self) -> State:
        """Return what was left behind; what comes later does not change it."""

    def restore(self, state: State) -> None:
        """Go on from a state."""


def gathered(**parts: Stateful) -> State:
    """Return the states of the parts in one, each name behind that of its part; inverted by ``scatter``."""
    return {f"{name}.{key}": array for name, part in parts.items() for key, array in part.state().items()}


def scatter(state: State, **parts: Stateful) -> None:
    """Let every part go on from what ``gathered`` has of it."""
    for name, part in parts.items():
        part.restore(
            {
                key.removeprefix(f"{name}."): array
                for key, array in state.items()
                if key.startswith(f"{name}.")
            }
        )


def marked(state: State) -> State:
    """Return a state with its format."""
    return {"format": np.array(FORMAT), **state}


def check_format(state: State) -> None:
    """Raise InvalidState unless a state has this format."""
    if "format" not in state or int(state["format"]) != FORMAT:
        raise InvalidState(f"is not of format {FORMAT}")
