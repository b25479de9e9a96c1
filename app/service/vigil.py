"""Vigil: every worker shows that it lives, and watches the others.

A worker counts its beats in the registry. The others look at the number by their own monotonic clocks: it is
dead whose number has stood still for DEAD_S. No wall clock is asked, and a worker that was only paused does
no harm when it wakes: what it took on has a later attempt by then.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Mapping
from contextlib import suppress
from types import TracebackType
from typing import Self

from app.registry import workers
from app.registry.errors import Unavailable
from app.service.lab import Lab

BEAT_S = 1.0
DEAD_S = 6.0
"""How long a living worker may not beat [s]: a kernel that lets no other thread run, a slow disk."""
COUNTS_S = 1.5
"""How much of the time between two looks counts at most [s]."""

log = logging.getLogger(__name__)


class Heart:
    """Beats for a worker for as long as the block lasts; at its end the worker has left."""

    def __init__(self, lab: Lab, worker: str) -> None:
        self._lab = lab
        self._worker = worker
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._beat, name="heart", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopped.set()
        self._thread.join(BEAT_S)
        with suppress(Unavailable), self._lab.database.transaction() as tx:
            workers.leave(tx, self._worker)

    def _beat(self) -> None:
        while not self._stopped.wait(BEAT_S):
            try:
                with self._lab.database.transaction() as tx:
                    workers.beat(tx, self._worker)
            except Unavailable as error:
                log.warning("no beat: %s", error)


class Pulses:
    """The beats of all workers as one of them sees them; a time in which it could not look counts little."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[int, float]] = {}
        self._looked = math.inf

    def dead(self, beats: Mapping[str, int], now: float) -> set[str]:
        """Return whose beats have stood still for too long; now: of a monotonic clock [s]."""
        passed = min(max(now - self._looked, 0.0), COUNTS_S)
        known, self._seen, self._looked = self._seen, {}, now
        for id_, number in beats.items():
            before, still = known.get(id_, (None, 0.0))
            self._seen[id_] = (number, still + passed if number == before else 0.0)
        return {id_ for id_, (_, still) in self._seen.items() if still > DEAD_S}
