"""Whether the server lives, and whether it can work."""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter
from pydantic import BaseModel
from starlette.responses import JSONResponse

from app.api.dependencies import LabOf, LiveOf

router = APIRouter(tags=["health"])


class Alive(BaseModel):
    """The process answers."""

    status: Literal["ok"] = "ok"


class Ready(BaseModel):
    """What the server needs, each ``ok`` or what is wrong with it."""

    database: str
    store: str
    sessions: str


@router.get("/livez", summary="Does the process answer?")
async def livez() -> Alive:
    """Answer, whatever the state of database and store."""
    return Alive()


@router.get("/readyz", summary="Can the server work?", responses={503: {"model": Ready}})
def readyz(lab: LabOf, live: LiveOf) -> JSONResponse:
    """Answer 200 where database, store and sessions are at work, else 503."""
    found = {**lab.health(), "sessions": "draining" if live.draining.is_set() else "ok"}
    ready = all(state == "ok" for state in found.values())
    return JSONResponse(found, 200 if ready else 503)
