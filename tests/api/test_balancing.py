"""The balancer of docker-compose.yml, by its own configuration, before two servers on one set of data."""

from __future__ import annotations

import shutil
import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from app.client import GestaClient
from app.motion.model import Model
from app.motion.simulation import RATE, recording
from app.registry.artifacts import dump_model
from benchmarks.cluster import cluster
from benchmarks.parts import ROOT, Part, part
from tests.talking import Message, expected

CONFIGURATION = ROOT / "deploy" / "haproxy.cfg"
HAPROXY = shutil.which("haproxy") or shutil.which("haproxy", path="/usr/sbin")
MOTION = recording(5, 6).trajectory


@contextmanager
def balancing(folder: Path, servers: Sequence[Part]) -> Iterator[str]:
    """Run the balancer before servers; give its address."""
    assert HAPROXY is not None
    balancer = part(folder, "haproxy")
    text = CONFIGURATION.read_text().replace("bind :8000", f"bind 127.0.0.1:{balancer.port}")
    for number, server in enumerate(servers, start=1):
        text = text.replace(f" server-{number}:8000", f" 127.0.0.1:{server.port}")
    assert ":8000" not in text
    (folder / "haproxy.cfg").write_text(text)
    balancer.command = (HAPROXY, "-W", "-db", "-f", str(folder / "haproxy.cfg"))
    balancer.start()
    try:
        balancer.await_answer()
        yield balancer.url
    finally:
        balancer.end()


def teach(client: GestaClient, model: Model) -> None:
    client.create_model("table-top", ["object"])
    answer = httpx.post(
        f"{client.url}/v1/models/table-top/versions:import",
        content=dump_model(model),
        headers={"Content-Type": "application/vnd.gesta.model+json"},
    )
    assert answer.status_code == 201


@pytest.mark.skipif(HAPROXY is None, reason="HAProxy is not installed")
def test_streams_and_listeners_go_through_a_rolling_restart(
    tmp_path: Path, trained: Model, postgresql_database_url: str
) -> None:
    """No request is refused; who streams and who listens hear everything once."""
    statuses: list[int] = []
    rolled = threading.Event()
    heard: list[Message] = []
    first = threading.Event()
    with (
        cluster(tmp_path, workers=0, database_url=postgresql_database_url) as running,
        balancing(tmp_path, running.servers) as url,
        GestaClient(url) as client,
    ):
        teach(client, trained)

        def ask() -> None:
            while not rolled.is_set():
                statuses.append(httpx.get(f"{url}/v1/models").status_code)

        def listen(session_id: str) -> None:
            for event in client.session_events(session_id):
                heard.append(event)
                first.set()

        with client.stream("table-top", rate_hz=RATE) as stream:
            session_id = stream.state.started["session_id"]
            others = [threading.Thread(target=listen, args=[session_id]), threading.Thread(target=ask)]
            for other in others:
                other.start()
            stream.send(None, MOTION.part(0, 400).hand, MOTION.part(0, 400).objects)
            assert first.wait(20), "an event comes when it is said, not when the response is over"
            for server in running.servers:
                server.restart()
                server.await_answer()
            rolled.set()
            rest = MOTION.part(400, len(MOTION))
            stream.send(None, rest.hand, rest.objects)
            stream.end()
            told = [message for message in stream if "event" in message]
        for other in others:
            other.join()
    assert told[:-1] == expected(trained, MOTION, RATE)
    assert heard == told
    assert (len(statuses) > 10, set(statuses)) == (True, {200})


@pytest.mark.skipif(HAPROXY is None, reason="HAProxy is not installed")
def test_the_configuration_is_one_without_a_warning(tmp_path: Path) -> None:
    text = CONFIGURATION.read_text().replace(" server-1:", " 127.0.0.1:").replace(" server-2:", " 127.0.0.1:")
    (tmp_path / "haproxy.cfg").write_text(text)
    command = [str(HAPROXY), "-c", "-dW", "-f", str(tmp_path / "haproxy.cfg")]
    subprocess.run(command, check=True, capture_output=True, text=True, timeout=20)
