"""Reviews: a recognised segment, confirmed or put right by somebody who knows, becomes a demonstration."""

from __future__ import annotations

from typing import Any

from app.motion.trajectory import Demonstration, Scene, Trajectory
from app.registry import models
from app.registry.records import Added, SessionRecord
from app.service import session_archive
from app.service.errors import ContentRefused, FramesNotDurable, Issue, RecordingGone
from app.service.lab import Lab
from app.service.uploads import keep, specification_of


def learn_segment(
    lab: Lab, session_id: str, number: int, action: str, start_seq: int | None, end_seq: int | None
) -> tuple[str, Added]:
    """Add a segment to the demonstrations of its session's model; return the model and what became of it.

    start_seq, end_seq: its first frame and its goal, None: the segment's own. Raises NotFound,
    RecordingGone, FramesNotDurable, ContentRefused.
    """
    record = session_archive.get(lab, session_id)
    segment = session_archive.segment(lab, session_id, number)
    with lab.database.reading() as tx:
        specification = specification_of(models.get(tx, record.model))
    if not record.frames_kept:
        raise RecordingGone(session_id)
    start, goal = _span(record, segment, start_seq, end_seq)
    motion = session_archive.part(lab, session_id, start, goal + 1)
    shown = Demonstration(
        action, _by_roles(motion, segment, specification.objects), Scene(record.start["table_height_m"])
    )
    meta = {"session": session_id, "segment": number, "start_seq": start, "end_seq": goal}
    return record.model, keep(lab, record.model, [shown], specification, [""], meta)


def _span(
    record: SessionRecord, segment: dict[str, Any], start_seq: int | None, end_seq: int | None
) -> tuple[int, int]:
    """Return the first and the last frame; a segment that ends where the frames do has its goal in the last.

    Raises FramesNotDurable, ContentRefused.
    """
    start = segment["start_seq"] if start_seq is None else start_seq
    end = segment["end_seq"] if end_seq is None else end_seq
    if record.state == "active" and end >= record.n_frames and end != segment["end_seq"]:
        raise FramesNotDurable(record.id, end, record.n_frames)
    if end > record.n_frames:
        detail = f"lies beyond the {record.n_frames} frames of the session"
        raise ContentRefused([Issue("/end_seq", "out_of_range", detail)])
    if start >= end:
        detail = f"the first frame, {start}, must lie before the goal, frame {end}"
        raise ContentRefused([Issue("/start_seq" if end_seq is None else "/end_seq", "out_of_range", detail)])
    return start, min(end, record.n_frames - 1)


def _by_roles(motion: Trajectory, segment: dict[str, Any], roles: tuple[str, ...]) -> Trajectory:
    """Return the motion with the objects that filled the roles, by the names of these.

    A role that nothing is known to have filled gets the object of its own name, if there is one.
    """
    names = {role: segment["objects"].get(role, role) for role in roles}
    objects = {role: motion.objects[name] for role, name in names.items() if name in motion.objects}
    return Trajectory(motion.times, motion.hand, objects)
