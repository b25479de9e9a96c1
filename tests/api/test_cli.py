"""The command ``gesta``, as a user runs it."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from app.client import GestaClient
from app.registry import models
from app.registry.database import Database
from tests.api.conftest import Sent
from tests.serving import ROOT

GESTA = [sys.executable, "-m", "app.cli"]


def environment(folder: Path) -> dict[str, str]:
    return {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "GESTA_DATABASE_URL": f"sqlite:///{folder}/gesta.db",
        "GESTA_STORE_URL": str(folder / "store"),
    }


@contextmanager
def serve(folder: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run ``gesta serve`` on a free port; give the process and its address."""
    process = subprocess.Popen(
        [*GESTA, "serve", "--port", "0"],
        cwd=folder,
        env=environment(folder),
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    found = re.search(r"http://[\d.:]+", process.stdout.readline())
    assert found is not None
    try:
        yield process, found[0]
    finally:
        if process.poll() is None:
            process.kill()
        process.wait(30)
        process.stdout.close()


def test_serve_needs_nothing_but_a_folder_and_trains_by_itself(tmp_path: Path, sent: list[Sent]) -> None:
    with serve(tmp_path) as (process, url), GestaClient(url) as client:
        client.create_model("table-top", ["object"])
        client.add_demonstrations("table-top", sent)
        assert client.result(client.train("table-top", options={"n_states": 4})["id"])["version"] == 1
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0
    with serve(tmp_path) as (_, url), GestaClient(url) as client:
        assert client.version("table-top")["version"] == 1
    assert {path.name for path in tmp_path.iterdir()} >= {"gesta.db", "gesta-jobs.db", "store"}


def test_a_server_that_is_killed_takes_its_worker_along(tmp_path: Path) -> None:
    with serve(tmp_path) as (process, url):
        assert httpx.get(f"{url}/readyz", timeout=60).status_code == 200
        process.kill()
        process.wait(30)
        assert process.stdout is not None
        assert process.stdout.read() == "", "the worker holds the output open until it ends"


def test_a_port_that_is_taken_is_told(tmp_path: Path) -> None:
    with serve(tmp_path) as (_, url):
        command = [*GESTA, "serve", "--port", url.rpartition(":")[2]]
        second = subprocess.run(
            command,
            cwd=tmp_path,
            env=environment(tmp_path),
            check=False,
            capture_output=True,
            text=True,
            timeout=60,
        )
    assert second.returncode == 2
    assert "in use" in second.stderr
    assert "Traceback" not in second.stderr


def test_migrate_makes_the_tables(tmp_path: Path) -> None:
    subprocess.run([*GESTA, "migrate"], cwd=tmp_path, env=environment(tmp_path), check=True, timeout=60)
    database = Database(f"sqlite:///{tmp_path}/gesta.db")
    with database.reading() as tx:
        assert models.page(tx, size=1).records == ()
    database.close()


@pytest.mark.parametrize(
    ("variable", "value"),
    [
        ("GESTA_PORT", "many"),
        ("GESTA_JOB_WORKER", "x"),
        ("GESTA_DATABASE_URL", "mysql://u:hidden@h/d"),
        ("GESTA_STORE_URL", "s3://key:hidden@bucket"),
    ],
)
def test_a_setting_that_is_none_is_named_without_a_traceback(
    tmp_path: Path, variable: str, value: str
) -> None:
    refused = subprocess.run(
        [*GESTA, "serve"],
        cwd=tmp_path,
        env={**environment(tmp_path), variable: value},
        check=False,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert refused.returncode == 2
    assert variable in refused.stderr
    assert "Traceback" not in refused.stderr
    assert "hidden" not in refused.stderr
