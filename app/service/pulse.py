"""How late the event loop is: whether there is more to do than time."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable

BEAT = 0.1
"""Time between two looks [s]."""
BEATS = 5
"""A loop is as late as it was at the least of so many looks: one long step is no overload."""


class Pulse:
    """Looks how late it is; ``each`` is called after every look."""

    def __init__(self, each: Callable[[], None]) -> None:
        self._each = each
        self._seen = deque([0.0] * BEATS, maxlen=BEATS)

    @property
    def late(self) -> float:
        """How late the event loop has been for a while [s]."""
        return min(self._seen)

    def note(self, late: float) -> None:
        """Take a look's lateness [s]."""
        self._seen.append(late)
        self._each()

    async def beat(self) -> None:
        """Look again and again."""
        loop = asyncio.get_running_loop()
        while True:
            due = loop.time() + BEAT
            await asyncio.sleep(BEAT)
            self.note(loop.time() - due)
