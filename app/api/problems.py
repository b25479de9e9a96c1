"""Errors on the wire: RFC 9457 problems. One table says which error has which status."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse, Response

from app.motion import errors as motion
from app.registry import errors as registry
from app.service import errors as service
from app.service import session_errors

PROBLEM = "application/problem+json"

TABLE: tuple[tuple[type[Exception], int, str], ...] = (
    (registry.AlreadyExists, 409, "already_exists"),
    (registry.PreconditionFailed, 412, "precondition_failed"),
    (registry.InvalidName, 422, "invalid_name"),
    (registry.InvalidPageToken, 422, "invalid_page_token"),
    (registry.KeyReused, 409, "idempotency_key_reused"),
    (registry.DatabaseUnavailable, 503, "database_unavailable"),
    (registry.StoreUnavailable, 503, "store_unavailable"),
    (registry.ArtifactInvalid, 422, "artifact_invalid"),
    (registry.ArtifactMissing, 503, "artifact_missing"),
    (registry.ArtifactAltered, 503, "artifact_altered"),
    (service.ContentRefused, 422, "content_refused"),
    (service.NothingToTrain, 409, "nothing_to_train"),
    (service.ReadersBusy, 503, "readers_busy"),
    (service.RecordingGone, 410, "recording_gone"),
    (service.FramesNotDurable, 409, "frames_not_durable"),
    (session_errors.WriteFailed, 503, "write_failed"),
    (motion.UnknownAction, 404, "action_not_found"),
    (motion.InvalidRequest, 422, "invalid_request"),
    (motion.RoleMissing, 422, "role_missing"),
    (motion.FitFailed, 422, "fit_failed"),
    (motion.MotionError, 422, "motion_refused"),
)
"""The first that fits counts. NotFound, whose code names what was not found, stands apart."""

CODES = {
    400: "malformed",
    404: "not_found",
    405: "method_not_allowed",
    406: "not_acceptable",
    413: "too_large",
    415: "unsupported_media_type",
}

WIRE_NAMES = {
    "rate": "rate_hz",
    "duration": "duration_s",
    "std": "std_m",
    "velocity": "velocity_m_s",
    "acceleration": "acceleration_m_s2",
}
"""Fields of requests that the core, which writes units into its docstrings, calls otherwise."""

log = logging.getLogger(__name__)


def problem(
    status: int,
    code: str,
    detail: str,
    errors: Sequence[Mapping[str, str]] = (),
    headers: Mapping[str, str] | None = None,
    request_id: str = "",
) -> JSONResponse:
    """Return a problem as a response."""
    body: dict[str, Any] = {
        "type": "about:blank",
        "title": HTTPStatus(status).phrase,
        "status": status,
        "detail": detail,
        "code": code,
        "errors": list(errors),
        "request_id": request_id,
    }
    return JSONResponse(body, status, dict(headers or {}), media_type=PROBLEM)


def install(app: FastAPI) -> None:
    """Let every error of the app become a problem."""
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _http)
    for kind in (
        registry.RegistryError,
        service.ServiceError,
        session_errors.SessionError,
        motion.MotionError,
    ):
        app.add_exception_handler(kind, _refused)
    app.add_exception_handler(Exception, _failed)


def _invalid(request: Request, error: Exception) -> Response:
    """A request that does not fit its schema: 422, or 400 where it is not even JSON."""
    if not isinstance(error, RequestValidationError):
        raise error
    found = error.errors()
    if found[0]["loc"] == ("body",) and not _declares_json(request):
        detail = "the body must be JSON, declared as `Content-Type: application/json`"
        return problem(415, CODES[415], detail, request_id=_id(request))
    malformed = any(item["type"] == "json_invalid" for item in found)
    places = [
        {"pointer": _pointer(item["loc"]), "code": str(item["type"]), "detail": _detail(item["msg"])}
        for item in found[:20]
    ]
    status, code = (400, "malformed") if malformed else (422, "invalid")
    detail = "; ".join(f"{place['pointer'] or 'the body'}: {place['detail']}" for place in places[:3])
    return problem(status, code, detail, places, request_id=_id(request))


def _declares_json(request: Request) -> bool:
    kind = request.headers.get("content-type", "").partition(";")[0].strip()
    return kind == "application/json" or kind.endswith("+json")


def _detail(message: str) -> str:
    return message.removeprefix("Value error, ")


def _pointer(place: Sequence[str | int]) -> str:
    """A JSON pointer for what is in the body; for the rest where it stands and what it is called."""
    where, *path = place
    steps = "".join(f"/{str(step).replace('~', '~0').replace('/', '~1')}" for step in path)
    return steps if where == "body" else f"{where}{steps}"


def _http(request: Request, error: Exception) -> Response:
    if not isinstance(error, HTTPException):
        raise error
    code = CODES.get(error.status_code, "http_error")
    return problem(error.status_code, code, str(error.detail), headers=error.headers, request_id=_id(request))


def _refused(request: Request, error: Exception) -> Response:
    if isinstance(error, registry.NotFound):
        return problem(404, f"{error.kind}_not_found", str(error), request_id=_id(request))
    for kind, status, code in TABLE:
        if isinstance(error, kind):
            headers = {"Retry-After": "5"} if status == 503 else None
            return problem(status, code, str(error), _places(error), headers, _id(request))
    return _failed(request, error)


def _places(error: Exception) -> list[dict[str, str]]:
    if isinstance(error, service.ContentRefused):
        return [vars(issue) for issue in error.issues]
    if isinstance(error, motion.InvalidRequest):
        pointer = "".join(f"/{WIRE_NAMES.get(name, name)}" for name in error.field.split("."))
        return [{"pointer": pointer, "code": "invalid_request", "detail": str(error)}]
    return []


def _failed(request: Request, error: Exception) -> Response:
    log.error("request %s failed", _id(request), exc_info=error)
    detail = "the server has failed; this is not the client's fault"
    return problem(500, "internal", detail, request_id=_id(request))


def _id(request: Request) -> str:
    return str(getattr(request.state, "request_id", ""))
