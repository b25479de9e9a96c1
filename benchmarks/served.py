"""A real server, taught and asked as any client does it."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from app.client import GestaClient, Message, trajectory
from app.demo import serving
from app.motion.model import Model
from app.motion.trajectory import Demonstration, Recording, Segment, Trajectory
from app.registry.artifacts import load_model


@dataclass(frozen=True)
class Taught:
    """A trained version: where it is, and the model in it."""

    client: GestaClient
    name: str
    version: int
    model: Model

    def recognise(self, motion: Trajectory) -> list[Segment]:
        """Stream frames as fast as they are taken; return the segments that come back."""
        options = {"hypotheses": False}
        with self.client.stream(self.name, version=self.version, options=options) as stream:
            stream.send(motion.times, motion.hand, motion.objects)
            stream.end()
            return [as_segment(message) for message in stream if message["type"] == "segment"]


@contextmanager
def server() -> Iterator[GestaClient]:
    """Run a server of its own on a database of its own, both gone at the end."""
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        serving(Path(folder)) as url,
        GestaClient(url) as client,
    ):
        yield client


def teach_demonstrations(client: GestaClient, name: str, shown: Sequence[Demonstration]) -> Taught:
    """Upload demonstrations as a model of this name and train it."""
    client.create_model(name, _roles(shown[0].trajectory))
    client.add_demonstrations(name, [(each.action, as_json(each.trajectory)) for each in shown])
    return _train(client, name)


def teach_recordings(client: GestaClient, name: str, shown: Sequence[Recording]) -> Taught:
    """Upload the labelled segments of recordings as a model of this name and train it."""
    client.create_model(name, _roles(shown[0].trajectory))
    for recording in shown:
        times = recording.trajectory.times.tolist()
        labels = [
            {
                "action": segment.action,
                "start_s": times[segment.start],
                "end_s": times[min(segment.end, len(times) - 1)],
            }
            for segment in recording.segments
        ]
        client.add_recording(name, as_json(recording.trajectory), labels)
    return _train(client, name)


def as_segment(message: Message) -> Segment:
    """Return the segment that a message tells of."""
    return Segment(message["start_seq"], message["end_seq"], message["action"])


def as_json(motion: Trajectory) -> Message:
    """Return motion as the wire carries it."""
    return trajectory(motion.times, motion.hand, motion.objects)


def _roles(motion: Trajectory) -> list[str]:
    return list(motion.objects)


def _train(client: GestaClient, name: str) -> Taught:
    version = client.result(client.train(name)["id"])["version"]
    artifact = client.request("GET", f"/models/{name}/versions/{version}/artifact")
    return Taught(client, name, version, load_model(json.dumps(artifact).encode()))
