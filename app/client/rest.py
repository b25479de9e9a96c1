"""The requests of the REST API, one method each."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import TracebackType
from typing import Any, Self

import httpx
import numpy as np
from numpy.typing import ArrayLike

from app.client.errors import ApiError, JobFailed
from app.client.stream import Stream
from app.client.wire import METRES, Message


class GestaClient:
    """A Gesta server at ``url``; every method raises ApiError where the server refuses."""

    def __init__(self, url: str = "http://127.0.0.1:8000") -> None:
        self.url = url.rstrip("/")
        self._http = httpx.Client(base_url=self.url, timeout=60.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let the connections go."""
        self._http.close()

    def request(
        self, method: str, path: str, body: Any = None, headers: Mapping[str, str] | None = None
    ) -> Any:
        """Ask ``/v1{path}`` and return the parsed answer, None where it is empty."""
        response = self._http.request(method, f"/v1{path}", json=body, headers=dict(headers or {}))
        _check(response)
        return response.json() if response.content else None

    def create_model(self, name: str, objects: Sequence[str] = (), **fields: Any) -> Message:
        """Create a model; fields: table_height_m, description, features."""
        return self._message("POST", "/models", {"name": name, "objects": list(objects), **fields})

    def add_demonstrations(
        self,
        model: str,
        demonstrations: Sequence[tuple[str, Message]],
        geometry: Mapping[str, str] | None = None,
        scene: Mapping[str, float] | None = None,
    ) -> Message:
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
    ) -> Message:
        """Upload a labelled recording; segments: {action, start_s, end_s}."""
        recording = {"trajectory": motion, "segments": [dict(segment) for segment in segments]}
        return self._upload(model, {"recording": recording}, geometry, scene)

    def train(self, model: str, idempotency_key: str | None = None, **fields: Any) -> Message:
        """Queue a training and return its job; fields: options, demonstrations, base."""
        headers = {} if idempotency_key is None else {"Idempotency-Key": idempotency_key}
        return self._message("POST", f"/models/{model}/versions", fields, headers)

    def job(self, job_id: str) -> Message:
        """Return the state of a job."""
        return self._message("GET", f"/jobs/{job_id}")

    def cancel(self, job_id: str) -> None:
        """Ask a job to stop."""
        self.request("DELETE", f"/jobs/{job_id}")

    def result(self, job_id: str, watch: Callable[[Message], object] = bool) -> Message:
        """Wait for a job and return its result; ``watch`` gets every state. Raises JobFailed."""
        job: Message = {}
        for _, job in self.events(f"/jobs/{job_id}/events"):
            watch(job)
        if job["state"] != "succeeded":
            raise JobFailed(job)
        result: Message = job["result"]
        return result

    def version(self, model: str, ref: str | int = "latest") -> Message:
        """Return a version by number, alias or ``latest``."""
        return self._message("GET", f"/models/{model}/versions/{ref}")

    def promote(self, model: str, alias: str, version: int) -> Message:
        """Let an alias name a version."""
        return self._message("PUT", f"/models/{model}/aliases/{alias}", {"version": version})

    def generate(
        self, model: str, ref: str | int, action: str, start: ArrayLike, goal: ArrayLike, **fields: Any
    ) -> Message:
        """Return a trajectory between two points [m]; fields: rate_hz, duration_s, method, …"""
        ends = {"start": np.asarray(start, float).tolist(), "goal": np.asarray(goal, float).tolist()}
        path = f"/models/{model}/versions/{ref}/actions/{action}/trajectories"
        return self._message("POST", path, {**ends, **fields})

    def segment(self, model: str, ref: str | int, motion: Message, **fields: Any) -> Message:
        """Return the segments of a recording; fields: geometry, scene."""
        body = {"geometry": METRES, "trajectory": motion, **fields}
        return self._message("POST", f"/models/{model}/versions/{ref}/segmentations", body)

    def evaluate(self, model: str, ref: str | int, **body: Any) -> Message:
        """Return the measures on a labelled recording."""
        return self._message(
            "POST", f"/models/{model}/versions/{ref}/evaluations", {"geometry": METRES, **body}
        )

    def session(self, session_id: str) -> Message:
        """Return a session."""
        return self._message("GET", f"/sessions/{session_id}")

    def segments(self, session_id: str, after: int = -1) -> list[Message]:
        """Return the segments recognised in a session after number ``after``."""
        found: list[Message] = self.request("GET", f"/sessions/{session_id}/segments?after={after}")[
            "segments"
        ]
        return found

    def session_events(
        self, session_id: str, after: int = -1, include: str = ""
    ) -> Iterator[tuple[str, Message]]:
        """Yield a session's (type, message) as they come, until it ends; include: frames, hypotheses."""
        query = f"?include={include}" if include else ""
        yield from self.events(f"/sessions/{session_id}/events{query}", {"Last-Event-ID": str(after)})

    def events(self, path: str, headers: Mapping[str, str] | None = None) -> Iterator[tuple[str, Message]]:
        """Yield (type, data) of the server-sent events at ``/v1{path}``."""
        with self._http.stream("GET", f"/v1{path}", headers=dict(headers or {})) as response:
            if response.is_error:
                response.read()
            _check(response)
            kind, data = "message", ""
            for line in response.iter_lines():
                field, _, value = line.partition(": ")
                if field == "event":
                    kind = value
                elif field == "data":
                    data += value
                elif not line and data:
                    yield kind, json.loads(data)
                    kind, data = "message", ""

    def stream(self, model: str, **start: Any) -> Stream:
        """Return a stream to enter by ``with``; start: the arguments of ``start_message``."""
        return Stream(self.url, model, **start)

    def pages(self, path: str, field: str) -> Iterator[Message]:
        """Yield every item of a paged list: ``field`` of the answers of ``/v1{path}``."""
        query = ""
        while True:
            page = self._message("GET", f"{path}{query}")
            yield from page[field]
            if (token := page.get("next_page_token")) is None:
                return
            query = f"?page_token={token}"

    def _upload(
        self, model: str, body: Message, geometry: Mapping[str, str] | None, scene: Mapping[str, float] | None
    ) -> Message:
        body = {"geometry": dict(geometry or METRES), **body} | ({"scene": dict(scene)} if scene else {})
        return self._message("POST", f"/models/{model}/demonstrations", body)

    def _message(
        self, method: str, path: str, body: Any = None, headers: Mapping[str, str] | None = None
    ) -> Message:
        answer: Message = self.request(method, path, body, headers)
        return answer


def _check(response: httpx.Response) -> None:
    if response.is_error:
        is_problem = response.headers.get("content-type", "").startswith("application/problem+json")
        raise ApiError(
            response.status_code, response.json() if is_problem else {"detail": response.text[:200]}
        )
