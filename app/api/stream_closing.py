"""How a stream ends: every refusal with its close code; the ``error`` message says the rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from app.registry.errors import NotFound, Unavailable
from app.service import session_errors as refused
from app.service.session_errors import Code, SessionError

RETRYABLE = frozenset({1011, 1012, 1013, 4429})


class TooBig(SessionError):
    """A message longer than the limits told in ``started``."""

    def __init__(self, detail: str) -> None:
        super().__init__("too_big", detail)


class Idle(SessionError):
    """No message for too long."""

    def __init__(self, seconds: float) -> None:
        super().__init__("idle", f"no message for {seconds:g} s")


class NotReading(SessionError):
    """The client does not read what it is sent."""

    def __init__(self) -> None:
        super().__init__("not_reading", "the client does not read what it is sent")


CODES: tuple[tuple[type[SessionError], int], ...] = (
    (refused.MessageMalformed, 4400),
    (refused.FramesRefused, 4422),
    (refused.StartRefused, 4422),
    (refused.SessionGone, 4410),
    (refused.TokenRefused, 4403),
    (refused.TakenOver, 4409),
    (refused.TooManySessions, 1013),
    (refused.Overloaded, 1013),
    (refused.Restarting, 1012),
    (refused.WriteFailed, 1011),
    (TooBig, 1009),
    (Idle, 4408),
    (NotReading, 4429),
)


@dataclass(frozen=True)
class Closing:
    """A close code, its short reason, and the fields of the ``error`` before it (None: all is well)."""

    code: int
    reason: str
    error: dict[str, Any] | None


def closing_of(error: Exception | None) -> Closing:
    """Return how a stream closes that was ended by ``error``, or by nothing."""
    if error is None:
        return Closing(1000, "ended", None)
    if isinstance(error, NotFound):
        name: Code = "model_not_found" if error.kind == "model" else "version_not_found"
        return _closing(4404, name, str(error), None)
    if isinstance(error, Unavailable):
        return _closing(1013, "unavailable", f"{error}; come back in a moment", None)
    if isinstance(error, SessionError):
        code = next(code for kind, code in CODES if isinstance(error, kind))
        return _closing(code, error.code, error.detail, error.at_seq)
    return _closing(1011, "internal", "the server has failed; this is not the client's fault", None)


def _closing(code: int, name: Code, detail: str, at_seq: int | None) -> Closing:
    error: dict[str, Any] = {"code": name, "detail": detail, "fatal": True, "retryable": code in RETRYABLE}
    if at_seq is not None:
        error["at_seq"] = at_seq
    return Closing(code, name, error)
