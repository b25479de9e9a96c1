"""Jobs: ``/v1/jobs``."""

from __future__ import annotations

from collections.abc import AsyncIterator
from datetime import datetime
from typing import Annotated, Any, Self

from fastapi import APIRouter, Depends
from fastapi.sse import EventSourceResponse, ServerSentEvent
from pydantic import Field

from app.api.dependencies import LabOf, LiveOf
from app.api.schemas import Answer, PageSize, PageToken, refusals
from app.registry.records import JobRecord, JobState
from app.service import jobs

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])


class Progress(Answer):
    """How far a job is."""

    done: int
    total: int
    message: str


class JobTold(Answer):
    """A job."""

    id: str
    kind: str
    model: str | None
    state: JobState
    progress: Progress
    result: dict[str, Any] | None = Field(description="Once it has succeeded.")
    error: dict[str, Any] | None = Field(description="`code` and `detail` of why it failed.")
    created_at: datetime
    updated_at: datetime

    @classmethod
    def of(cls, record: JobRecord) -> Self:
        """Return what is told of a job."""
        return cls(
            id=record.id,
            kind=record.kind,
            model=record.model,
            state=record.state,
            progress=Progress(done=record.done, total=record.total, message=record.message),
            result=record.result,
            error=record.error,
            created_at=record.created_at,
            updated_at=record.updated_at,
        )


class JobsTold(Answer):
    """A page of jobs, the newest first."""

    jobs: list[JobTold]
    next_page_token: str | None


def _known(job: str, lab: LabOf) -> str:
    """Look the job up before the stream begins: an unknown one is a problem, not an event."""
    return jobs.get(lab, job).id


@router.get("", summary="List jobs, the newest first", responses=refusals())
def listing(
    lab: LabOf,
    state: JobState | None = None,
    model: str | None = None,
    page_size: PageSize = 50,
    page_token: PageToken = None,
) -> JobsTold:
    """All of them, or those in one state or of one model."""
    page = jobs.page(lab, size=page_size, after=page_token, state=state, model=model)
    return JobsTold(jobs=[JobTold.of(job) for job in page.records], next_page_token=page.next_token)


@router.get("/{job}", summary="Look a job up", responses=refusals(404))
def get(job: str, lab: LabOf) -> JobTold:
    """Its state, its progress, and its result or error."""
    return JobTold.of(jobs.get(lab, job))


@router.delete("/{job}", summary="Cancel a job", responses=refusals(404))
def cancel(job: str, lab: LabOf) -> JobTold:
    """A queued job ends at once, a running one at its next step; one that has ended stays so."""
    return JobTold.of(jobs.cancel(lab, job))


@router.get(
    "/{job}/events",
    summary="Watch a job",
    response_class=EventSourceResponse,
    responses=refusals(404),
)
async def events(
    known: Annotated[str, Depends(_known)], lab: LabOf, live: LiveOf
) -> AsyncIterator[ServerSentEvent]:
    """Server-sent events called `job`, each with the job as it is now; the last when it has ended."""
    async for job in jobs.watch(lab, known, live.draining):
        yield ServerSentEvent(event="job", data=JobTold.of(job))
