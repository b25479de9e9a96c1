"""Compares what clients were told with what the server has afterwards, and with an undisturbed run."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice

from app.motion.model import Model
from tests.chaos.caller import Caller, Refused
from tests.chaos.reader import heard
from tests.chaos.teacher import Mover, Teacher, as_sent
from tests.chaos.told import Fault, Kind, Told
from tests.talking import Message, expected, positions

READ = 5
"""Demonstrations of which every frame is looked at."""


class Judge:
    """Asks a server that nobody disturbs any more; models: what sessions were recognised with, by version."""

    def __init__(self, caller: Caller, models: Mapping[int, Model]) -> None:
        self._caller, self._models = caller, models
        self._truths: dict[tuple[int, int], list[Message]] = {}

    def of_session(self, told: Told) -> Iterator[Fault]:
        """Find what a session has lost, or has twice; of one that has not ended only the beginning counts."""
        yield from told.faults
        if told.session_id:
            yield from _heeded("session", self._of_session(told))

    def _of_session(self, told: Told) -> Iterator[Fault]:
        truth = self._truth(told)
        if not told.ended:
            yield from differing("event", told.session_id, told.events, truth[: len(told.events)])
            yield from self._of_frames(told, told.durable + 1)
            return
        yield from differing("event", told.session_id, told.events, truth)
        yield from differing("stored event", told.session_id, heard(self._caller, told.session_id), truth)
        path, segments = f"/sessions/{told.session_id}", [each for each in truth if each["type"] == "segment"]
        found = self._caller.insist("GET", f"{path}/segments")["segments"]
        yield from differing("segment", told.session_id, found, segments)
        record = self._caller.insist("GET", path)
        counts = record["state"], record["frames"], record["events"], record["segments"]
        if counts != ("ended", len(told.motion), len(truth), len(segments)):
            yield Fault("contradicted", "session", f"{told.session_id} is told as {counts}")
        yield from self._of_frames(told, len(told.motion))

    def of_listener(self, told: Told) -> Iterator[Fault]:
        """Find what somebody who listened to a session was told otherwise."""
        truth = self._truth(told)
        yield from told.faults
        yield from differing(
            "event", f"listening to {told.session_id}", told.events, truth[: len(told.events)]
        )

    def _of_frames(self, told: Told, at_least: int) -> Iterator[Fault]:
        """Find frames that were told to be durable and are not there, or not as they were sent."""
        kept = self._caller.insist("GET", f"/sessions/{told.session_id}/recording")["trajectory"]
        if (n_kept := len(kept["t"])) < at_least:
            yield Fault("lost", "frames", f"{told.session_id} keeps {n_kept} of {at_least}")
        motion = told.motion.part(0, n_kept)
        objects = {name: positions(track) for name, track in motion.objects.items()}
        sent = {"t": motion.times.tolist(), "hand": positions(motion.hand), "objects": objects}
        if any(kept[name] != track for name, track in sent.items()):
            yield Fault("contradicted", "frames", f"{told.session_id} keeps others than were sent")

    def of_teacher(self, teacher: Teacher) -> Iterator[Fault]:
        """Find demonstrations, jobs and versions that are missing, or there twice."""
        yield from _heeded("demonstration", self._of_demonstrations(teacher))
        yield from _heeded("version", self._of_versions(teacher))

    def _of_versions(self, teacher: Teacher) -> Iterator[Fault]:
        jobs = {job["id"]: job for job in self._caller.pages(f"/jobs?model={teacher.model}", "jobs")}
        yield from (Fault("lost", "job", each) for each in teacher.jobs if each not in jobs)
        if len(jobs) > len(teacher.jobs) + teacher.unsure:
            yield Fault("doubled", "job", f"{len(jobs)} jobs of {len(teacher.jobs)} trainings")
        versions = list(self._caller.pages(f"/models/{teacher.model}/versions", "versions"))
        numbers = sorted(version["version"] for version in versions)
        if numbers != list(range(1, len(numbers) + 1)):
            yield Fault("lost", "version", f"numbers are {numbers}")
        made_by: dict[str, list[int]] = {}
        for version in versions:
            made_by.setdefault(version["job_id"], []).append(version["version"])
        for job, told in teacher.jobs.items():
            yield from _of_job(jobs.get(job, {}), made_by.get(job, []), told)

    def _of_demonstrations(self, teacher: Teacher) -> Iterator[Fault]:
        path = f"/models/{teacher.model}/demonstrations"
        shown = list(self._caller.pages(path, "demonstrations"))
        ids, digests = Counter(each["id"] for each in shown), Counter(each["digest"] for each in shown)
        yield from (Fault("lost", "demonstration", each) for each in teacher.demonstrations if not ids[each])
        yield from (Fault("doubled", "demonstration", each) for each, n in digests.items() if n > 1)
        for each, sent in islice(reversed(teacher.demonstrations.items()), READ):
            kept = self._caller.insist("GET", f"{path}/{each}")["trajectory"]
            if any(kept[name] != track for name, track in as_sent(sent.trajectory).items()):
                yield Fault("contradicted", "demonstration", each)

    def of_moves(self, mover: Mover) -> Iterator[Fault]:
        """Find moves of an alias that are missing, there twice, or out of order."""
        if mover.moves:
            yield from _heeded("alias move", self._of_moves(mover))

    def _of_moves(self, mover: Mover) -> Iterator[Fault]:
        path = f"/models/{mover.model}/aliases/{mover.alias}/history"
        found = [move["version"] for move in self._caller.pages(path, "history")][::-1]
        if found != [*mover.moves, mover.unsure]:
            yield from differing("alias move", f"{mover.model}/{mover.alias}", found, mover.moves)

    def _truth(self, told: Told) -> list[Message]:
        """Return what an undisturbed run tells."""
        key = id(told.motion), told.version
        if key not in self._truths:
            events = expected(self._models[told.version], told.motion, version=told.version)
            segments = sum(event["type"] == "segment" for event in events)
            counts = {"segments": segments, "frames": len(told.motion)}
            self._truths[key] = [*events, {"type": "ended", "event": len(events), **counts}]
        return self._truths[key]


def _heeded(of: str, found: Iterator[Fault]) -> Iterator[Fault]:
    """Yield what is found, and where the server knows nothing of what is asked for, that."""
    try:
        yield from found
    except Refused as refusal:
        yield Fault("lost", of, str(refusal))


def _of_job(job: Message, made: Sequence[int], told: int | None) -> Iterator[Fault]:
    """Find what is wrong with a training that was acknowledged; told: the version that it was told to be."""
    if job.get("state") != "succeeded":
        yield Fault("lost", "job", f"{job}")
    if len(made) != 1:
        yield Fault("doubled" if made else "lost", "version", f"job {job.get('id')} made {made}")
    elif told is not None and made != [told]:
        yield Fault("contradicted", "version", f"job {job['id']} made {made}, not {told}")


def differing(of: str, where: str, found: Sequence[object], wanted: Sequence[object]) -> Iterator[Fault]:
    """Find what of a list is missing, there twice, or different."""
    texts, truth = ([json.dumps(each, sort_keys=True) for each in some] for some in (found, wanted))
    if texts == truth:
        return
    pairs = enumerate(zip(texts, truth, strict=False))
    at = next((at for at, (text, true) in pairs if text != true), min(len(texts), len(truth)))
    kind: Kind = (
        "lost" if len(texts) < len(truth) else "doubled" if len(texts) > len(truth) else "contradicted"
    )
    yield Fault(
        kind,
        of,
        f"{where}: {len(texts)}, not {len(truth)}; at {at} {texts[at : at + 1]}, not {truth[at : at + 1]}",
    )
