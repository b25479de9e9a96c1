"""Runs ``gesta`` with a wall clock that is wrong: ``python -m tests.chaos.clock SECONDS serve …``.

What asks for the time of day is told another; monotonic clocks, timers and the database are left alone.
"""

from __future__ import annotations

import datetime
import sys
import time


class Shifted(datetime.datetime):
    """A datetime whose ``now`` is wrong by ``shift``."""

    shift = datetime.timedelta()

    @classmethod
    def now(cls, tz: datetime.tzinfo | None = None) -> Shifted:
        """Return the wrong time."""
        return super().now(tz) + cls.shift


def main(seconds: str, *words: str) -> None:
    """Shift the clock and run the command."""
    shift, right = float(seconds), time.time
    Shifted.shift = datetime.timedelta(seconds=shift)
    vars(datetime)["datetime"] = Shifted
    time.time = lambda: right() + shift
    time.time_ns = lambda: int((right() + shift) * 1e9)

    from app.cli import main as gesta  # noqa: PLC0415 (only now: whoever imports the clock gets the wrong one)

    sys.argv = ["gesta", *words]
    gesta()


if __name__ == "__main__":
    main(*sys.argv[1:])
