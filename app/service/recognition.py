"""Recordings through the recogniser: what a stream of the same frames gives, at once or as a job."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from app.motion.errors import InvalidRequest
from app.motion.evaluation import evaluate
from app.motion.recogniser import Event, Recogniser, SegmentEvent
from app.motion.trajectory import Recording, Scene, Segment
from app.registry import jobs, models
from app.registry.artifacts import dump_recording, load_recording
from app.registry.records import JobRecord
from app.service import messages
from app.service.errors import ContentRefused, Issue
from app.service.geometry import Geometry
from app.service.lab import Lab, Version
from app.service.training import Json, Progress, Stage
from app.service.uploads import SentSegment, SentTrajectory, read_recording, read_trajectory

SEGMENTATION = "segmentation"
EVALUATION = "evaluation"

LONG = 30_000
"""Frames from which on a recording becomes a job."""

PART = 3_000
"""Frames between two reports of progress."""


@dataclass(frozen=True)
class Asked:
    """A recording to be recognised by a version."""

    kind: str
    model: str
    version: Version
    recording: Recording

    def recogniser(self) -> Recogniser:
        """Return what recognises it. Raises RoleMissing, ContentRefused."""
        trajectory = self.recording.trajectory
        try:
            return Recogniser(self.version.model, self.recording.scene, objects=tuple(trajectory.objects))
        except InvalidRequest as error:
            pointer = "/trajectory" if self.kind == SEGMENTATION else "/recording/trajectory"
            issue = Issue(f"{pointer}/{error.field}", "objects_ambiguous", str(error))
            raise ContentRefused([issue]) from error


def ask_segmentation(
    lab: Lab, model: str, ref: str, sent: SentTrajectory, geometry: Geometry, scene: Scene | None
) -> Asked:
    """Return a checked request for segments. Raises NotFound, ContentRefused."""
    version = lab.version(model, ref)
    trajectory = read_trajectory(sent, geometry, "/trajectory")
    return Asked(SEGMENTATION, model, version, Recording(trajectory, (), _scene(lab, model, scene)))


def ask_evaluation(
    lab: Lab,
    model: str,
    ref: str,
    sent: SentTrajectory,
    labels: Sequence[SentSegment],
    geometry: Geometry,
    scene: Scene | None,
) -> Asked:
    """Return a checked request for an evaluation. Raises NotFound, ContentRefused."""
    version = lab.version(model, ref)
    recording = read_recording(sent, labels, geometry, _scene(lab, model, scene))
    return Asked(EVALUATION, model, version, recording)


def answer(
    lab: Lab, asked: Asked, *, later: bool = False, idempotency_key: str | None = None
) -> Json | JobRecord:
    """Return the result, or the job that will have it: for a long recording, and where it may come ``later``.

    idempotency_key: of the job. Raises RoleMissing and ContentRefused where the objects cannot fill the
    roles, KeyReused, NotFound.
    """
    recogniser = asked.recogniser()
    if len(asked.recording.trajectory) < LONG and not later:
        return _recognise(asked, recogniser, lambda *_: None)
    request = {
        "version": asked.version.record.number,
        "recording": lab.store.put(dump_recording(asked.recording)),
    }
    with lab.database.transaction() as tx:
        models.lock(tx, asked.model)
        job, _ = jobs.create(
            tx,
            kind=asked.kind,
            request=request,
            model=asked.model,
            idempotency_key=idempotency_key,
            scope=asked.model,
        )
        return job


def recognise(lab: Lab, job: JobRecord, _: Json, progress: Progress) -> Json:
    """Do the work of a job. Raises what the core, the registry and ``progress`` raise."""
    version = lab.version(str(job.model), str(job.request["version"]))
    recording = load_recording(lab.store.get(job.request["recording"]))
    asked = Asked(job.kind, str(job.model), version, recording)
    return _recognise(asked, asked.recogniser(), progress)


STAGES: tuple[tuple[str, Stage], ...] = (("recognise", recognise),)


def _scene(lab: Lab, model: str, scene: Scene | None) -> Scene:
    if scene is not None:
        return scene
    with lab.database.reading() as tx:
        return Scene(models.get(tx, model).table_height_m)


def _recognise(asked: Asked, recogniser: Recogniser, progress: Progress) -> Json:
    trajectory, events = asked.recording.trajectory, list[Event]()
    for start in range(0, len(trajectory), PART):
        progress(start, len(trajectory), "recognising")
        events += recogniser.push(trajectory.part(start, start + PART))
    events += recogniser.finish()
    found = [event for event in events if isinstance(event, SegmentEvent)]
    record = asked.version.record
    if asked.kind == EVALUATION:
        seen = [Segment(event.start, event.end, event.action) for event in found]
        measures = evaluate([(trajectory.times, asked.recording.segments, seen)])
        return {"model": asked.model, "version": record.number, **asdict(measures)}
    segments = [
        messages.segment(event, number, asked.model, record.number) for number, event in enumerate(found)
    ]
    told: Json = json.loads(messages.as_json({"segments": segments}))
    return told
