"""Patience: what fails only for the moment is tried again, ever more seldom."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from app.registry.errors import Unavailable

FIRST_S, LONGEST_S = 0.1, 5.0
"""The first pause and the longest [s]; each is twice the one before."""
BOUND_S = 300.0
"""How long something is tried in all [s]."""

Result = TypeVar("Result")

log = logging.getLogger(__name__)


class Leaving(BaseException):
    """The worker is asked to leave. No error: nothing of it is recorded, the job is for another worker."""


def patiently(action: Callable[[], Result], leaving: threading.Event) -> Result:
    """Return what ``action`` returns; where database or store are away, or files fail, call it again.

    Raises what it raises otherwise, and in the end also that; Leaving.
    """
    pause, deadline = FIRST_S, time.monotonic() + BOUND_S
    while True:
        try:
            return action()
        except (Unavailable, OSError) as error:
            if time.monotonic() + pause > deadline:
                raise
            log.warning("tried again in %.1f s: %s", pause, error)
        if leaving.wait(pause):
            raise Leaving
        pause = min(2 * pause, LONGEST_S)
