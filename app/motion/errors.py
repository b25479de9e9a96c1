"""What the core refuses.

::

    MotionError
    ├── InvalidTrajectory     times, positions or a scene that are none; names the field and the frame
    ├── InvalidSegment        a segment that does not lie in its trajectory
    ├── RoleMissing           an object that the feature specification needs is not there
    ├── UnusableDemonstration a demonstration from which nothing can be learned; names it
    ├── FitFailed             training gave no usable action model
    ├── UnknownAction         an action class that the model does not have
    ├── InvalidRequest        a generation that cannot be asked for
    └── InvalidState          a state that a recogniser cannot go on from
"""

from __future__ import annotations


class MotionError(ValueError):
    """Root of everything that the core refuses."""


class InvalidTrajectory(MotionError):
    """Times or positions that are no trajectory, or a scene that is none.

    ``field`` is ``times``, ``hand``, ``objects.<name>`` or ``table_height``; ``frame`` counts from
    0, None where it is no single frame that is wrong; ``code`` is stable: ``malformed``, ``non_finite``,
    ``times_not_increasing`` or ``wrong_unit``.
    """

    def __init__(self, field: str, frame: int | None, detail: str, code: str = "malformed") -> None:
        self.field = field
        self.frame = frame
        self.detail = detail
        self.code = code
        super().__init__(f"{field}{'' if frame is None else f', frame {frame}'}: {detail}")


class InvalidSegment(MotionError):
    """A segment that does not lie in its trajectory; ``index`` is its place in the list."""

    def __init__(self, index: int, detail: str) -> None:
        self.index = index
        super().__init__(f"segment {index}: {detail}")


class RoleMissing(MotionError):
    """An object that the feature specification needs is not in the trajectory."""

    def __init__(self, role: str, present: tuple[str, ...]) -> None:
        self.role = role
        super().__init__(f"no object is named {role!r}; there are {', '.join(present) or 'none'}")


class UnusableDemonstration(MotionError):
    """A demonstration from which nothing can be learned; ``index`` is its place in the list."""

    def __init__(self, index: int, action: str, detail: str) -> None:
        self.index = index
        self.action = action
        super().__init__(f"demonstration {index} ({action}): {detail}")


class FitFailed(MotionError):
    """Training gave no usable action model for ``action``."""

    def __init__(self, action: str, detail: str) -> None:
        self.action = action
        super().__init__(f"action {action!r}: {detail}")


class UnknownAction(MotionError):
    """An action class that the model does not have."""

    def __init__(self, action: str, known: tuple[str, ...]) -> None:
        self.action = action
        super().__init__(f"no action {action!r}; the model knows {', '.join(known)}")


class InvalidRequest(MotionError):
    """A generation that cannot be asked for; ``field`` names the argument."""

    def __init__(self, field: str, detail: str) -> None:
        self.field = field
        self.detail = detail
        super().__init__(f"{field}: {detail}")


class InvalidState(MotionError):
    """A state that a recogniser cannot go on from: its frames have to be seen again."""

    def __init__(self, detail: str) -> None:
        super().__init__(f"the state {detail}")
