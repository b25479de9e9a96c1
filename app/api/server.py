"""The server itself: ``/v1/server``."""

from __future__ import annotations

from ipaddress import ip_address
from typing import Literal

from fastapi import APIRouter, Request
from starlette.responses import JSONResponse, Response

from app.api.problems import problem
from app.api.schemas import Answer, refusals

router = APIRouter(prefix="/v1", tags=["server"])


class Draining(Answer):
    """The server goes."""

    state: Literal["draining"] = "draining"


@router.post(
    "/server:drain",
    status_code=202,
    summary="Drain the server, and stop it",
    response_model=Draining,
    responses=refusals(403),
)
async def drain(request: Request) -> Response:
    """What SIGTERM does: no more connections, requests are finished, streams go on elsewhere.

    With several server processes all of them leave. Only from the server's own machine, by its loopback
    address, and not from a page in a browser: 403, `loopback_only`.
    """
    if not _is_near(request):
        detail = "only a program on the server's own machine may stop it"
        return problem(403, "loopback_only", detail, request_id=request.state.request_id)
    request.state.leave()
    return JSONResponse(Draining().model_dump(), 202)


def _is_near(request: Request) -> bool:
    """Whether a client is on this machine; what a browser sends for anybody's page has an ``Origin``."""
    if request.client is None or "origin" in request.headers:
        return False
    try:
        return ip_address(request.client.host).is_loopback
    except ValueError:
        return False
