"""Some sessions streamed side by side, and judged."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache

from app.motion.simulation import Conditions, recording
from app.motion.trajectory import Trajectory
from tests.chaos.caller import Caller
from tests.chaos.house import House
from tests.chaos.judge import Judge
from tests.chaos.rounds import taught
from tests.chaos.streamer import Habits, Streamer
from tests.chaos.told import Fault, Told

WAIT_S = 60.0


@cache
def short_motion(seed: int = 0, n_actions: int = 12) -> Trajectory:
    """Return some seconds of motion with dropouts."""
    return recording(50 + seed, n_actions, Conditions(gap_share=0.2)).trajectory


@contextmanager
def streaming(url: Callable[[], str], every: Sequence[tuple[Told, Habits]]) -> Iterator[None]:
    """Stream each to its end while the block is at work, and after it."""
    leaving, failures = threading.Event(), list[Exception]()

    def go(streamer: Streamer) -> None:
        try:
            streamer.run()
        except Exception as error:
            failures.append(error)

    threads = [
        threading.Thread(target=go, args=(Streamer(url, told, habits, seed, leaving),))
        for seed, (told, habits) in enumerate(every)
    ]
    for thread in threads:
        thread.start()
    try:
        yield
        for thread in threads:
            thread.join(WAIT_S)
    finally:
        leaving.set()
        for thread in threads:
            thread.join()
    if failures:
        raise failures[0]


def await_that(holds: Callable[[], object]) -> None:
    """Wait until something holds."""
    until = time.monotonic() + WAIT_S
    while not holds():
        if time.monotonic() > until:
            raise TimeoutError
        time.sleep(0.005)


def faults(house: House, every: Sequence[Told]) -> list[Fault]:
    """Return what is wrong with sessions, which must have ended."""
    with Caller(house.url) as caller:
        court = Judge(caller, taught())
        found = [fault for told in every for fault in court.of_session(told)]
    return [*found, *(Fault("lost", "session", told.session_id) for told in every if not told.ended)]
