"""What can go wrong for a client.

::

    GestaError
    ├── ApiError      the server refused a request; carries the problem
    ├── JobFailed     a job ended otherwise than by success
    └── StreamError   a stream ended before its time; carries the close code and the last ``error`` message
"""

from __future__ import annotations

from typing import Any


class GestaError(Exception):
    """Root of what can go wrong."""


class ApiError(GestaError):
    """The server refused a request; ``problem`` is the body of RFC 9457."""

    def __init__(self, status: int, problem: dict[str, Any]) -> None:
        self.status = status
        self.problem = problem
        self.code = str(problem.get("code", "unknown"))
        super().__init__(f"{status} {self.code}: {problem.get('detail', '')}")

    @property
    def is_passing(self) -> bool:
        """Whether the server, or what it needs, is only away for the moment."""
        return self.status in (502, 503, 504)


class JobFailed(GestaError):
    """A job ended otherwise than by success; ``job`` is its last state."""

    def __init__(self, job: dict[str, Any]) -> None:
        self.job = job
        error = job.get("error") or {}
        super().__init__(f"job {job['id']} {job['state']}: {error.get('detail', '')}")


class StreamError(GestaError):
    """A stream ended before its time; ``error`` is the server's last ``error`` message, if one came."""

    def __init__(self, close_code: int, error: dict[str, Any] | None) -> None:
        self.close_code = close_code
        self.error = error
        self.code = str(error["code"]) if error else "connection_lost"
        super().__init__(
            f"{close_code} {self.code}: {error['detail'] if error else 'the connection was lost'}"
        )
