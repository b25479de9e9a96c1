"""How long sessions are kept: those of dead processes expire, the frames of finished ones are dropped."""

from __future__ import annotations

import asyncio
import logging
from datetime import UTC, datetime, timedelta

from app.service.live import LiveSessions

PERIOD = 60.0
"""Time between two looks [s]; a session is seen at least as often while its process lives."""

log = logging.getLogger(__name__)


async def tidy(live: LiveSessions, retention: timedelta, now: datetime) -> tuple[int, int]:
    """Expire and drop what is due at ``now``; return how many sessions expired, how many lost their frames.

    retention: how long the frames of a session are kept after it was last seen.
    """
    living = live.touch()
    unseen_since = now - timedelta(seconds=live.limits.resume)
    expired = await asyncio.to_thread(live.store.expire, unseen_since, living)
    dropped = await asyncio.to_thread(live.store.drop_frames, now - retention)
    return expired, dropped


async def keep_tidy(live: LiveSessions, retention: timedelta) -> None:
    """Tidy up every ``PERIOD`` for as long as the process lives."""
    while True:
        try:
            expired, dropped = await tidy(live, retention, datetime.now(UTC))
        except Exception:
            log.exception("old sessions could not be tidied up")
        else:
            if expired or dropped:
                log.info("%d sessions expired, the frames of %d dropped", expired, dropped)
        await asyncio.sleep(PERIOD)
