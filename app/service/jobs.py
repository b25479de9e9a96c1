"""Jobs as their clients see them: looked up, watched, cancelled."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

from app.registry import jobs
from app.registry.records import JobRecord, JobState, Page
from app.service.lab import Lab

POLL = 0.2
"""How often a watched job is looked at [s]."""


def get(lab: Lab, id_: str) -> JobRecord:
    """Return a job. Raises NotFound."""
    with lab.database.reading() as tx:
        return jobs.get(tx, id_)


def page(
    lab: Lab, *, size: int, after: str | None, state: JobState | None, model: str | None
) -> Page[JobRecord]:
    """List jobs, newest first. Raises InvalidPageToken."""
    with lab.database.reading() as tx:
        return jobs.page(tx, size=size, after=after, state=state, model=model)


def cancel(lab: Lab, id_: str) -> JobRecord:
    """Ask a job to end: a queued one does at once, a running one at its next step. Raises NotFound."""
    with lab.database.transaction() as tx:
        return jobs.request_cancel(tx, id_)


async def watch(lab: Lab, id_: str, leaving: asyncio.Event) -> AsyncIterator[JobRecord]:
    """Yield a job whenever it has changed, until it is finished or the server leaves. Raises NotFound."""
    seen = None
    while not (leaving.is_set() or (seen is not None and seen.finished)):
        job = await asyncio.to_thread(get, lab, id_)
        if job != seen:
            yield job
            seen = job
        else:
            await asyncio.sleep(POLL)
