"""What a session refuses; part of the tree of ``errors.py``.

::

    SessionError             `code` is stable snake_case, `at_seq` the frame it is about
    ├── MessageMalformed     a message that cannot be read, or is not allowed here
    │   └── FramesMissing    frames beyond the next wanted, or an end beyond the last received
    ├── FramesRefused        frames that are no motion: not finite, unsorted, in a wrong unit
    ├── StartRefused         a start that the model cannot serve
    ├── SessionGone          no session to resume: ended, expired or never there
    ├── TokenRefused         the resume token is not the session's
    ├── TakenOver            a newer connection has resumed the session
    ├── TooManySessions      the process holds as many sessions as it can
    ├── Overloaded           the process has more to compute than it can
    ├── Restarting           the server is going away
    └── WriteFailed          what was decided could not be made durable
"""

from __future__ import annotations

from typing import Literal

Code = Literal[
    "already_started",
    "binary_cut_short",
    "binary_not_declared",
    "binary_too_long",
    "f32_needs_rate",
    "frames_missing",
    "goals_invalid",
    "idle",
    "internal",
    "malformed",
    "model_not_found",
    "non_finite",
    "not_reading",
    "objects_ambiguous",
    "objects_invalid",
    "overloaded",
    "restarting",
    "resume_mismatch",
    "role_missing",
    "session_gone",
    "start_expected",
    "taken_over",
    "times_not_increasing",
    "token_refused",
    "too_big",
    "unavailable",
    "unknown_type",
    "version_not_found",
    "version_unusable",
    "write_failed",
    "wrong_channels",
    "wrong_objects",
    "wrong_unit",
]
"""What an ``error`` of the stream can be about; stable."""


class SessionError(Exception):
    """Root of what a session refuses."""

    def __init__(self, code: Code, detail: str, at_seq: int | None = None) -> None:
        self.code = code
        self.detail = detail
        self.at_seq = at_seq
        super().__init__(detail)


class MessageMalformed(SessionError):
    """A message that cannot be read, or is not allowed here."""


class FramesMissing(MessageMalformed):
    """Frames before ``at_seq`` were never received."""

    def __init__(self, wanted: int, got: int) -> None:
        super().__init__("frames_missing", f"frame {wanted} is wanted next, got {got}", at_seq=wanted)


class FramesRefused(SessionError):
    """Frames that are no motion; ``detail`` names the field and the frame."""


class StartRefused(SessionError):
    """A start that the model cannot serve."""


class SessionGone(SessionError):
    """No session to resume."""

    def __init__(self, session_id: str) -> None:
        self.session_id = session_id
        super().__init__("session_gone", f"session {session_id!r} has ended, has expired or never was")


class TokenRefused(SessionError):
    """The resume token is not the session's."""

    def __init__(self) -> None:
        super().__init__("token_refused", "the resume token is not that of the session")


class TakenOver(SessionError):
    """A newer connection has resumed the session."""

    def __init__(self) -> None:
        super().__init__("taken_over", "a newer connection has resumed the session")


class TooManySessions(SessionError):
    """The process holds as many sessions as it can."""

    def __init__(self, limit: int) -> None:
        super().__init__("overloaded", f"the server holds {limit} sessions, as many as it can")


class Overloaded(SessionError):
    """The process has more to compute than it can."""

    def __init__(self) -> None:
        super().__init__("overloaded", "the server has more to compute than it can; come back in a moment")


class Restarting(SessionError):
    """The server is going away."""

    def __init__(self) -> None:
        super().__init__("restarting", "the server is restarting; resume in a moment")


class WriteFailed(SessionError):
    """What was decided could not be made durable."""

    def __init__(self) -> None:
        super().__init__("write_failed", "the session could not be written to the database")
