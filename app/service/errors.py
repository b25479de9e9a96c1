"""What the use cases refuse.

::

    ServiceError
    ├── ContentRefused      an upload that is no motion; names every place and what is wrong there
    ├── NothingToTrain      a training without demonstrations
    ├── ReadersBusy         more files to read at a time than the server has memory for
    ├── JobCancelled        the job was asked to end
    ├── RecordingGone       the frames of a session are no longer kept
    └── FramesNotDurable    frames of a session that has not come, or not been written, so far
    SessionError            what a session refuses: see ``session_errors.py``
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


class ServiceError(Exception):
    """Root of what the use cases refuse, sessions apart."""


@dataclass(frozen=True)
class Issue:
    """One thing wrong with an upload; ``pointer`` is the JSON pointer of its place in the request."""

    pointer: str
    code: str
    detail: str


class ContentRefused(ServiceError):
    """An upload that is no motion."""

    def __init__(self, issues: Sequence[Issue]) -> None:
        self.issues = tuple(issues)
        first = self.issues[0]
        super().__init__(f"{first.pointer}: {first.detail}" if first.pointer else first.detail)


class NothingToTrain(ServiceError):
    """A training without demonstrations."""

    def __init__(self, model: str) -> None:
        super().__init__(f"model {model!r} has no demonstrations to train on; upload some first")


class ReadersBusy(ServiceError):
    """More files to read at a time than the server has memory for."""

    def __init__(self) -> None:
        super().__init__("the server reads as many files as it can; come back in a moment")


class JobCancelled(ServiceError):
    """The job was asked to end."""


class RecordingGone(ServiceError):
    """The frames of a session are no longer kept."""

    def __init__(self, session_id: str) -> None:
        super().__init__(f"the frames of session {session_id!r} are no longer kept")


class FramesNotDurable(ServiceError):
    """Frames of a live session that has not come, or not been written, so far."""

    def __init__(self, session_id: str, wanted: int, durable: int) -> None:
        held = f"up to {durable - 1}" if durable else "none"
        super().__init__(f"frame {wanted} of session {session_id!r} is not durable yet, {held} are")
