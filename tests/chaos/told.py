"""What clients were told, written down as they hear it, and what in it cannot be true.

A fault is found where it is heard: a number left out, told twice unasked, or told differently the second
time. What can only be seen in the end is for ``judge``.
"""

from __future__ import annotations

import threading
from collections import Counter
from dataclasses import dataclass
from typing import Literal

from app.motion.trajectory import Trajectory
from tests.talking import Message

Kind = Literal["lost", "doubled", "contradicted", "refused", "broken"]
"""broken: a client of the test itself did not work; it has found nothing, and no round counts with it."""


@dataclass(frozen=True)
class Fault:
    """What is wrong: of what kind, with what, and the words that show it."""

    kind: Kind
    of: str
    text: str

    def __str__(self) -> str:
        return f"{self.kind} {self.of}: {self.text}"


class Told:
    """What the clients of one session were told; several may write here."""

    def __init__(self, motion: Trajectory) -> None:
        self.motion = motion
        self.session_id, self.token, self.version = "", "", 0
        self.durable = -1
        self.events: list[Message] = []
        self.faults: list[Fault] = []
        self.closings: Counter[int] = Counter()
        self.resumed = 0
        self.gone = False
        self.over = threading.Event()
        """Set where nobody goes on with it although it has not ended."""
        self._lock = threading.Lock()

    @property
    def ended(self) -> bool:
        """Whether a client has heard the last event."""
        return bool(self.events) and self.events[-1]["type"] == "ended"

    def started(self, message: Message, durable: int) -> None:
        """Take ``started``; a resumed session has to be the same, with all that was ``durable`` before."""
        with self._lock:
            pinned = message["session_id"], message["resume_token"], message["version"]
            if not self.session_id:
                self.session_id, self.token, self.version = pinned
                if message["next_seq"] != 0:
                    self.fault("contradicted", "frames", f"a new session begins at {message['next_seq']}")
                return
            self.resumed += 1
            if pinned != (self.session_id, self.token, self.version):
                self.fault("contradicted", "session", f"resumed as {pinned}")
            if message["next_seq"] <= self.durable:
                self.fault(
                    "lost", "frames", f"next_seq {message['next_seq']}, durable_seq was {self.durable}"
                )

    def accepted(self, message: Message) -> None:
        """Take ``accepted``."""
        with self._lock:
            if message["durable_seq"] > message["through_seq"]:
                self.fault("contradicted", "frames", f"durable, but not accepted: {message}")
            self.durable = max(self.durable, message["durable_seq"])

    def event(self, message: Message, wanted: int) -> None:
        """Take a durable event; wanted: its number, if none is left out or told twice on the connection."""
        number: int = message["event"]
        with self._lock:
            if number != wanted:
                kind: Kind = "lost" if number > wanted else "doubled"
                self.fault(kind, "event", f"number {number} instead of {wanted}: {message}")
            if number == len(self.events):
                self.events.append(message)
            elif number < len(self.events) and self.events[number] != message:
                self.fault("contradicted", "event", f"{self.events[number]} became {message}")

    def fault(self, kind: Kind, of: str, text: str) -> None:
        """Note what is wrong."""
        self.faults.append(Fault(kind, of, f"session {self.session_id}: {text}"))
