"""PostgreSQL goes away under a worker in the midst of a training: the job is not lost, and goes on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from app.client import GestaClient
from tests.api.test_job_adoption import in_the_midst, plenty, versions_of, when, worker_of
from tests.chaos.house import Postgres
from tests.serving import Server, serving

__all__ = ["plenty"]


@pytest.fixture(scope="module")
def postgres() -> Iterator[Postgres]:
    with TemporaryDirectory(prefix="gesta-") as folder:
        running = Postgres(Path(folder))
        yield running
        running.stop()


@pytest.fixture(scope="module")
def server(postgres: Postgres, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with serving(tmp_path_factory.mktemp("server"), database_url=postgres.new_database()) as running:
        yield running


def test_a_database_that_is_away_loses_no_job(
    client: GestaClient, server: Server, plenty: str, postgres: Postgres
) -> None:
    with worker_of(server) as worker:
        job_id, *_ = in_the_midst(client, server, plenty, (worker, worker))
        postgres.kill()
        worker.says("cannot look for jobs")
        worker.says("no beat")
        postgres.start()
        ended = when(server, job_id, lambda job: job.finished)
        assert ended.state == "succeeded"
        assert client.result(job_id) == {"model": plenty, "version": 1}
        assert versions_of(client, plenty) == [(1, job_id)]
