"""A number that only grows, and that tasks wait for."""

from __future__ import annotations

import asyncio


class Mark:
    """A number that only grows; ``fail`` ends the wait of everybody with an error."""

    def __init__(self, value: int) -> None:
        self.value = value
        self._error: Exception | None = None
        self._waiting: list[asyncio.Future[None]] = []

    def advance(self, value: int) -> None:
        """Move to ``value`` and wake those who wait."""
        if value > self.value:
            self.value = value
            self._wake()

    def fail(self, error: Exception) -> None:
        """Let everybody who waits, now or later, get ``error``."""
        self._error = error
        self._wake()

    async def beyond(self, value: int) -> int:
        """Return the number once it is greater than ``value``."""
        while self.value <= value:
            if self._error is not None:
                raise self._error
            moved = asyncio.get_running_loop().create_future()
            self._waiting.append(moved)
            await moved
        return self.value

    def _wake(self) -> None:
        waiting, self._waiting = self._waiting, []
        for moved in waiting:
            if not moved.done():
                moved.set_result(None)
