"""Jobs: watched, cancelled, and finished whatever happens to the worker."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace

import httpx
import numpy as np
import pytest

from app.client import ApiError, GestaClient, JobFailed
from app.motion.trajectory import Demonstration
from tests.api.conftest import Sent, as_sent, working
from tests.serving import Server, serving

SLOW = {"n_states": 12}


@pytest.fixture(params=["sqlite", "postgresql"], scope="module")
def server(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server on either kind of database."""
    url = None
    if request.param == "postgresql":
        make = request.getfixturevalue("new_postgresql_database")
        url = make()
    with serving(tmp_path_factory.mktemp("server"), database_url=url) as running:
        yield running


@pytest.fixture
def filled(client: GestaClient, new_model: Callable[..., str], sent: list[Sent]) -> str:
    """A model with demonstrations."""
    model = new_model()
    client.add_demonstrations(model, sent)
    return model


@pytest.fixture
def plenty(client: GestaClient, new_model: Callable[..., str], shown: list[Demonstration]) -> str:
    """A model with so many classes that its training lasts some seconds."""
    model = new_model()
    for number in range(24):
        moved = np.array([0.01 * number, 0.0, 0.0])
        shifted = [replace(each.trajectory, hand=each.trajectory.hand + moved) for each in shown]
        of_number = [
            Demonstration(f"{each.action}-{number}", motion)
            for each, motion in zip(shown, shifted, strict=True)
        ]
        client.add_demonstrations(model, [as_sent(each) for each in of_number])
    return model


def test_a_job_is_watched_to_its_end(client: GestaClient, server: Server, filled: str) -> None:
    job = client.train(filled, options=SLOW)
    with (
        working(server),
        httpx.stream("GET", f"{client.url}/v1/jobs/{job['id']}/events", timeout=60) as events,
    ):
        assert events.headers["Content-Type"].startswith("text/event-stream")
        seen = [json.loads(line[6:]) for line in events.iter_lines() if line.startswith("data: ")]
    assert [seen[0]["state"], seen[-1]["state"]] == ["queued", "succeeded"]
    assert seen[-1] == client.job(job["id"])
    assert seen[-1]["result"] == {"model": filled, "version": 1}
    listed = client.request("GET", f"/jobs?model={filled}&state=succeeded")["jobs"]
    assert [item["id"] for item in listed] == [job["id"]]
    if server.database.embedded:
        assert (server.log.parent / "gesta-jobs.db").is_file()


def test_a_queued_job_is_cancelled_at_once(client: GestaClient, server: Server, filled: str) -> None:
    first, second = (client.train(filled, options=SLOW) for _ in range(2))
    client.cancel(first["id"])
    assert client.job(first["id"])["state"] == "cancelled"
    with working(server):
        assert client.result(second["id"])["version"] == 1
    assert client.job(first["id"])["state"] == "cancelled"


def test_a_running_job_is_cancelled_at_its_next_step(
    client: GestaClient, server: Server, plenty: str
) -> None:
    job = client.train(plenty)

    def cancel_when_running(state: dict[str, object]) -> None:
        if state["state"] == "running":
            client.cancel(job["id"])

    with working(server), pytest.raises(JobFailed) as raised:
        client.result(job["id"], cancel_when_running)
    assert raised.value.job["state"] == "cancelled"
    assert client.request("GET", f"/models/{plenty}/versions")["versions"] == []


def test_a_worker_killed_in_mid_job_does_it_once_when_it_is_back(
    client: GestaClient, server: Server, plenty: str
) -> None:
    job = client.train(plenty)
    with working(server) as worker:
        states = client.events(f"/jobs/{job['id']}/events")
        next(state for _, state in states if state["progress"]["total"] > 0)
        worker.send_signal(signal.SIGKILL)
        assert worker.wait(30) == -signal.SIGKILL
    assert client.job(job["id"])["state"] == "running"
    with working(server):
        assert client.result(job["id"]) == {"model": plenty, "version": 1}
    versions = client.request("GET", f"/models/{plenty}/versions")["versions"]
    assert [(version["version"], version["job_id"]) for version in versions] == [(1, job["id"])]


def test_a_model_is_deleted_with_its_jobs_and_its_keys(
    client: GestaClient, server: Server, plenty: str, sent: list[Sent]
) -> None:
    running = client.train(plenty, idempotency_key="once")
    with working(server):
        events = client.events(f"/jobs/{running['id']}/events")
        next(state for _, state in events if state["state"] == "running")
        queued = client.train(plenty)
        client.delete_model(plenty)
        assert client.job(queued["id"])["state"] == "cancelled"
        *_, (_, last) = events
        assert last["state"] == "cancelled"
        client.create_model(plenty, ["object"])
        client.add_demonstrations(plenty, sent)
        anew = client.train(plenty, idempotency_key="once", options=SLOW)
        assert anew["id"] != running["id"]
        assert client.result(anew["id"]) == {"model": plenty, "version": 1}


@pytest.mark.parametrize("path", ["", "/events"])
def test_an_unknown_job_is_not_found(client: GestaClient, path: str) -> None:
    with pytest.raises(ApiError, match="404 job_not_found"):
        client.request("GET", f"/jobs/none{path}")
