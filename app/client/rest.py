"""The requests of the REST API, one method each; how they are sent is for the clients of ``clients.py``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Generic, TypeVar
from urllib.parse import quote

import numpy as np
from numpy.typing import ArrayLike

from app.client.wire import METRES, Message

Answer = TypeVar("Answer")


class Rest(ABC, Generic[Answer]):
    """Every method returns the server's answer, or the coroutine of it; ApiError where it refuses."""

    @abstractmethod
    def _message(
        self, method: str, path: str, body: Any = None, headers: Mapping[str, str] | None = None
    ) -> Answer:
        """Ask ``/v1{path}`` for an object, ``{}`` where the answer is empty."""

    def create_model(self, name: str, objects: Sequence[str] = (), **fields: Any) -> Answer:
        """Create a model; fields: table_height_m, description, features."""
        return self._message("POST", "/models", {"name": name, "objects": list(objects), **fields})

    def model(self, name: str) -> Answer:
        """Return a model."""
        return self._message("GET", _path("models", name))

    def change_model(self, name: str, if_match: str | None = None, **fields: Any) -> Answer:
        """Change a model; fields: description, table_height_m; if_match: the ETag it must still have."""
        headers = {} if if_match is None else {"If-Match": if_match}
        return self._message("PATCH", _path("models", name), fields, headers)

    def delete_model(self, name: str) -> Answer:
        """Delete a model with all that belongs to it."""
        return self._message("DELETE", _path("models", name))

    def add_demonstrations(
        self,
        model: str,
        demonstrations: Sequence[tuple[str, Message]],
        geometry: Mapping[str, str] | None = None,
        scene: Mapping[str, float] | None = None,
    ) -> Answer:
        """Upload (action, trajectory) pairs; returns created and duplicate ids."""
        items = [{"action": action, "trajectory": motion} for action, motion in demonstrations]
        return self._upload(model, {"demonstrations": items}, geometry, scene)

    def add_recording(
        self,
        model: str,
        motion: Message,
        segments: Sequence[Mapping[str, Any]],
        geometry: Mapping[str, str] | None = None,
        scene: Mapping[str, float] | None = None,
    ) -> Answer:
        """Upload a labelled recording; segments: {action, start_s, end_s}."""
        recording = {"trajectory": motion, "segments": [dict(segment) for segment in segments]}
        return self._upload(model, {"recording": recording}, geometry, scene)

    def demonstration(self, model: str, demonstration_id: str) -> Answer:
        """Return a demonstration with its trajectory."""
        return self._message("GET", _path("models", model, "demonstrations", demonstration_id))

    def delete_demonstration(self, model: str, demonstration_id: str) -> Answer:
        """Delete a demonstration; versions made of it stay."""
        return self._message("DELETE", _path("models", model, "demonstrations", demonstration_id))

    def train(self, model: str, idempotency_key: str | None = None, **fields: Any) -> Answer:
        """Queue a training and return its job; fields: options, demonstrations, base."""
        return self._message("POST", _path("models", model, "versions"), fields, _asking(idempotency_key))

    def job(self, job_id: str) -> Answer:
        """Return the state of a job."""
        return self._message("GET", _path("jobs", job_id))

    def cancel(self, job_id: str) -> Answer:
        """Ask a job to stop."""
        return self._message("DELETE", _path("jobs", job_id))

    def version(self, model: str, ref: str | int = "latest") -> Answer:
        """Return a version by number, alias or ``latest``."""
        return self._message("GET", _path("models", model, "versions", ref))

    def promote(self, model: str, alias: str, version: int) -> Answer:
        """Let an alias name a version."""
        return self._message("PUT", _path("models", model, "aliases", alias), {"version": version})

    def delete_alias(self, model: str, alias: str) -> Answer:
        """Delete an alias; its history stays."""
        return self._message("DELETE", _path("models", model, "aliases", alias))

    def generate(
        self, model: str, ref: str | int, action: str, start: ArrayLike, goal: ArrayLike, **fields: Any
    ) -> Answer:
        """Return a trajectory between two points [m]; fields: rate_hz, duration_s, limits, via, …"""
        ends = {"start": np.asarray(start, float).tolist(), "goal": np.asarray(goal, float).tolist()}
        path = _path("models", model, "versions", ref, "actions", action, "trajectories")
        return self._message("POST", path, {**ends, **fields})

    def generate_task(
        self, model: str, ref: str | int, start: ArrayLike, steps: Sequence[Message], **fields: Any
    ) -> Answer:
        """Return one trajectory through steps ``{action, goal, …}``; fields as in ``generate``."""
        body = {"start": np.asarray(start, float).tolist(), "steps": list(steps), **fields}
        return self._message("POST", _path("models", model, "versions", ref, "trajectories"), body)

    def segment(
        self,
        model: str,
        ref: str | int,
        motion: Message,
        *,
        as_job: bool = False,
        idempotency_key: str | None = None,
        **fields: Any,
    ) -> Answer:
        """Return the segments of a recording, or the job that finds them; fields: geometry, scene.

        as_job: a job however short the recording is; idempotency_key: the same gives the same job.
        """
        body = {"geometry": METRES, "trajectory": motion, **fields}
        path = _path("models", model, "versions", ref, "segmentations")
        return self._message("POST", path, body, _asking(idempotency_key, as_job))

    def evaluate(
        self,
        model: str,
        ref: str | int,
        *,
        as_job: bool = False,
        idempotency_key: str | None = None,
        **body: Any,
    ) -> Answer:
        """Return the measures on a labelled recording, or the job that takes them: see ``segment``."""
        path = _path("models", model, "versions", ref, "evaluations")
        return self._message("POST", path, {"geometry": METRES, **body}, _asking(idempotency_key, as_job))

    def session(self, session_id: str) -> Answer:
        """Return a session."""
        return self._message("GET", _path("sessions", session_id))

    def end_session(self, session_id: str) -> Answer:
        """End a session, whoever feeds it, and return it."""
        return self._message("DELETE", _path("sessions", session_id))

    def segments(self, session_id: str, after: int = -1) -> Answer:
        """Return ``{"segments": […]}`` recognised in a session, those after number ``after``."""
        return self._message("GET", f"{_path('sessions', session_id, 'segments')}?after={after}")

    def learn(
        self,
        session_id: str,
        segment: int,
        action: str,
        start_seq: int | None = None,
        end_seq: int | None = None,
    ) -> Answer:
        """Make a reviewed segment a demonstration of the session's model; returns created, duplicates, model.

        start_seq, end_seq: its first frame and its goal where they differ from the segment's own.
        """
        path = f"{_path('sessions', session_id, 'segments', segment)}:learn"
        span = {"start_seq": start_seq, "end_seq": end_seq}
        given = {name: seq for name, seq in span.items() if seq is not None}
        return self._message("POST", path, {"action": action, **given})

    def recording(self, session_id: str) -> Answer:
        """Return the frames of a session: its ``trajectory`` can be uploaded or segmented again."""
        return self._message("GET", _path("sessions", session_id, "recording"))

    def _upload(
        self, model: str, body: Message, geometry: Mapping[str, str] | None, scene: Mapping[str, float] | None
    ) -> Answer:
        body = {"geometry": dict(geometry or METRES), **body} | ({"scene": dict(scene)} if scene else {})
        return self._message("POST", _path("models", model, "demonstrations"), body)


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
