"""The requests of the REST API, one function each: what to send, and nothing of how."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np
from numpy.typing import ArrayLike

from app.client.wire import METRES, Message


class Request(NamedTuple):
    """What to ask ``/v1{path}``."""

    method: str
    path: str
    body: Any = None
    headers: Mapping[str, str] = {}


def create_model(name: str, objects: Sequence[str] = (), **fields: Any) -> Request:
    """Create a model; fields: table_height_m, description, features."""
    return Request("POST", "/models", {"name": name, "objects": list(objects), **fields})


def model(name: str) -> Request:
    """Return a model."""
    return Request("GET", _path("models", name))


def change_model(name: str, if_match: str | None = None, **fields: Any) -> Request:
    """Change a model; fields: description, table_height_m; if_match: the ETag it must still have."""
    headers = {} if if_match is None else {"If-Match": if_match}
    return Request("PATCH", _path("models", name), fields, headers)


def delete_model(name: str) -> Request:
    """Delete a model with all that belongs to it."""
    return Request("DELETE", _path("models", name))


def add_demonstrations(
    model: str,
    demonstrations: Sequence[tuple[str, Mapping[str, Any]]],
    geometry: Mapping[str, str] | None = None,
    scene: Mapping[str, float] | None = None,
) -> Request:
    """Upload (action, trajectory) pairs; returns created and duplicate ids."""
    items = [{"action": action, "trajectory": motion} for action, motion in demonstrations]
    return _upload(model, {"demonstrations": items}, geometry, scene)


def add_recording(
    model: str,
    motion: Mapping[str, Any],
    segments: Sequence[Mapping[str, Any]],
    geometry: Mapping[str, str] | None = None,
    scene: Mapping[str, float] | None = None,
) -> Request:
    """Upload a labelled recording; segments: {action, start_s, end_s}."""
    recording = {"trajectory": motion, "segments": [dict(segment) for segment in segments]}
    return _upload(model, {"recording": recording}, geometry, scene)


def demonstration(model: str, demonstration_id: str) -> Request:
    """Return a demonstration with its trajectory."""
    return Request("GET", _path("models", model, "demonstrations", demonstration_id))


def delete_demonstration(model: str, demonstration_id: str) -> Request:
    """Delete a demonstration; versions made of it stay."""
    return Request("DELETE", _path("models", model, "demonstrations", demonstration_id))


def train(model: str, idempotency_key: str | None = None, **fields: Any) -> Request:
    """Queue a training and return its job; fields: options, demonstrations, base."""
    return Request("POST", _path("models", model, "versions"), fields, _asking(idempotency_key))


def job(job_id: str) -> Request:
    """Return the state of a job."""
    return Request("GET", _path("jobs", job_id))


def cancel(job_id: str) -> Request:
    """Ask a job to stop."""
    return Request("DELETE", _path("jobs", job_id))


def version(model: str, ref: str | int = "latest") -> Request:
    """Return a version by number, alias or ``latest``."""
    return Request("GET", _path("models", model, "versions", ref))


def promote(model: str, alias: str, version: int) -> Request:
    """Let an alias name a version."""
    return Request("PUT", _path("models", model, "aliases", alias), {"version": version})


def delete_alias(model: str, alias: str) -> Request:
    """Delete an alias; its history stays."""
    return Request("DELETE", _path("models", model, "aliases", alias))


def generate(
    model: str, ref: str | int, action: str, start: ArrayLike, goal: ArrayLike, **fields: Any
) -> Request:
    """Return a trajectory between two points [m]; fields: rate_hz, duration_s, limits, via, …"""
    ends = {"start": np.asarray(start, float).tolist(), "goal": np.asarray(goal, float).tolist()}
    path = _path("models", model, "versions", ref, "actions", action, "trajectories")
    return Request("POST", path, {**ends, **fields})


def generate_task(
    model: str, ref: str | int, start: ArrayLike, steps: Sequence[Mapping[str, Any]], **fields: Any
) -> Request:
    """Return one trajectory through steps ``{action, goal, …}``; fields as in ``generate``."""
    body = {"start": np.asarray(start, float).tolist(), "steps": list(steps), **fields}
    return Request("POST", _path("models", model, "versions", ref, "trajectories"), body)


def segment(
    model: str,
    ref: str | int,
    motion: Mapping[str, Any],
    *,
    as_job: bool = False,
    idempotency_key: str | None = None,
    **fields: Any,
) -> Request:
    """Return the segments of a recording, or the job that finds them; fields: geometry, scene.

    as_job: a job however short the recording is; idempotency_key: the same gives the same job.
    """
    body = {"geometry": METRES, "trajectory": motion, **fields}
    path = _path("models", model, "versions", ref, "segmentations")
    return Request("POST", path, body, _asking(idempotency_key, as_job))


def evaluate(
    model: str,
    ref: str | int,
    *,
    as_job: bool = False,
    idempotency_key: str | None = None,
    **body: Any,
) -> Request:
    """Return the measures on a labelled recording, or the job that takes them: see ``segment``."""
    path = _path("models", model, "versions", ref, "evaluations")
    return Request("POST", path, {"geometry": METRES, **body}, _asking(idempotency_key, as_job))


def session(session_id: str) -> Request:
    """Return a session."""
    return Request("GET", _path("sessions", session_id))


def end_session(session_id: str) -> Request:
    """End a session, whoever feeds it, and return it."""
    return Request("DELETE", _path("sessions", session_id))


def segments(session_id: str, after: int = -1) -> Request:
    """Return ``{"segments": […]}`` recognised in a session, those after number ``after``."""
    return Request("GET", f"{_path('sessions', session_id, 'segments')}?after={after}")


def learn(
    session_id: str,
    segment: int,
    action: str,
    start_seq: int | None = None,
    end_seq: int | None = None,
) -> Request:
    """Make a reviewed segment a demonstration of the session's model; returns created, duplicates, model.

    start_seq, end_seq: its first frame and its goal where they differ from the segment's own.
    """
    path = f"{_path('sessions', session_id, 'segments', segment)}:learn"
    span = {"start_seq": start_seq, "end_seq": end_seq}
    given = {name: seq for name, seq in span.items() if seq is not None}
    return Request("POST", path, {"action": action, **given})


def recording(session_id: str) -> Request:
    """Return the frames of a session: its ``trajectory`` can be uploaded or segmented again."""
    return Request("GET", _path("sessions", session_id, "recording"))


def _upload(
    model: str, body: Message, geometry: Mapping[str, str] | None, scene: Mapping[str, float] | None
) -> Request:
    body = {"geometry": dict(geometry or METRES), **body} | ({"scene": dict(scene)} if scene else {})
    return Request("POST", _path("models", model, "demonstrations"), body)


def page_path(path: str, token: str | None) -> str:
    """Return the path of the page of a list that ``token`` asks for, None for the first."""
    if token is None:
        return path
    return f"{path}{'&' if '?' in path else '?'}page_token={quote(token, safe='')}"


def session_events_path(session_id: str, include: str) -> str:
    """Return where the events of a session are; include: ``frames``, ``hypotheses`` or both."""
    return _path("sessions", session_id, "events") + (f"?include={quote(include)}" if include else "")


def _asking(idempotency_key: str | None, as_job: bool = False) -> dict[str, str]:
    key = {} if idempotency_key is None else {"Idempotency-Key": idempotency_key}
    return key | ({"Prefer": "respond-async"} if as_job else {})


def _path(*parts: str | int) -> str:
    return "".join(f"/{quote(str(part), safe='')}" for part in parts)
