"""Clients that upload, train and promote, and write down what was acknowledged."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from itertools import count

from app.client import trajectory
from app.motion.simulation import demonstrations
from app.motion.trajectory import Demonstration, Trajectory
from tests.chaos.caller import Caller, Left
from tests.talking import METRES, Message

WATCH_S = 0.1
"""Between two looks at a job [s]."""
EACH = 3
"""Demonstrations of a class in an upload."""
DONE = ("succeeded", "failed", "cancelled")


class Mover:
    """Moves an alias to and fro."""

    def __init__(self, caller: Caller, model: str, alias: str) -> None:
        self._caller, self.model, self.alias = caller, model, alias
        self.moves: list[int] = []
        """Acknowledged, in order."""
        self.unsure: int | None = None
        """Asked for and not answered."""

    def move(self, version: int) -> None:
        """Let the alias name a version; to name the same twice in a row is no move. Raises Left."""
        self.unsure = version
        self._caller.insist("PUT", f"/models/{self.model}/aliases/{self.alias}", {"version": version})
        self.moves.append(version)
        self.unsure = None

    def run(self, leaving: threading.Event, pause: float = 0.05) -> None:
        """Move between versions 1 and 2."""
        for number in count(len(self.moves)):
            if leaving.wait(pause):
                return
            try:
                self.move(1 + number % 2)
            except Left:
                return


class Teacher:
    """Uploads some demonstrations, trains on them, promotes the version, and begins again."""

    def __init__(self, caller: Caller, seed: int, model: str = "lessons") -> None:
        self._caller, self.model = caller, model
        self._shown = batches(seed)
        self.demonstrations: dict[str, Demonstration] = {}
        """Acknowledged, by id."""
        self.jobs: dict[str, int | None] = {}
        """Acknowledged, and the version of each once that was told."""
        self.unsure = 0
        """Jobs asked for and not answered."""
        self.promoted = Mover(caller, model, "production")
        self._cycles = count()

    def run(self, closing: threading.Event, leaving: threading.Event) -> None:
        """Teach; closing: begin no other lesson; leaving: end at once."""
        while not closing.is_set():
            try:
                self.teach(leaving)
            except Left:
                return

    def create(self) -> None:
        """Make the model."""
        self._caller.insist("POST", "/models", {"name": self.model, "objects": ["object"]})

    def teach(self, leaving: threading.Event) -> None:
        """Go round once. Raises Left."""
        batch = next(self._shown)
        ids = self._upload(batch)
        self.demonstrations.update(zip(ids, batch, strict=True))
        job = self._train(ids)
        while job["state"] not in DONE:
            if leaving.wait(WATCH_S):
                raise Left
            job = self._caller.insist("GET", f"/jobs/{job['id']}")
        if job["state"] == "succeeded":
            self.jobs[job["id"]] = job["result"]["version"]
            self.promoted.move(job["result"]["version"])

    def _upload(self, batch: list[Demonstration]) -> list[str]:
        answer = self._caller.insist("POST", f"/models/{self.model}/demonstrations", upload_of(batch))
        return [*answer["created"], *answer["duplicates"]]

    def _train(self, ids: list[str]) -> Message:
        body = {"options": {"n_states": 3}, "demonstrations": ids}
        self.unsure = 1
        headers = {"Idempotency-Key": f"lesson-{next(self._cycles)}"}
        job = self._caller.insist("POST", f"/models/{self.model}/versions", body, headers)
        self.unsure = 0
        self.jobs[job["id"]] = None
        return job


def as_sent(motion: Trajectory) -> Message:
    """Return a trajectory as it is uploaded, and as it is told again."""
    return trajectory(motion.times, motion.hand, motion.objects)


def upload_of(batch: Sequence[Demonstration]) -> Message:
    """Return the body of an upload."""
    sent = [{"action": each.action, "trajectory": as_sent(each.trajectory)} for each in batch]
    return {"geometry": METRES, "demonstrations": sent}


def batches(seed: int) -> Iterator[list[Demonstration]]:
    """Yield uploads, no demonstration twice."""
    for pool in count(1000 * seed):
        shown = demonstrations(pool)
        grasps, retracts = (
            [each for each in shown if each.action == action] for action in ("grasp", "retract")
        )
        for at in range(0, len(grasps) - EACH, EACH):
            yield [*grasps[at : at + EACH], *retracts[at : at + EACH]]
