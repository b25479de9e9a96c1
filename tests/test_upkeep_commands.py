"""``gesta backup``, ``restore`` and ``sweep``, as an operator runs them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from app.client import GestaClient, trajectory
from app.motion.simulation import demonstrations, recording
from tests.serving import ROOT

GESTA = [sys.executable, "-W", "error", "-m", "app.cli"]
RUN_S = 120


@dataclass(frozen=True)
class House:
    """A folder in which gesta runs, on a database."""

    folder: Path
    database_url: str

    @property
    def environment(self) -> dict[str, str]:
        return {
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "GESTA_DATABASE_URL": self.database_url,
            "GESTA_STORE_URL": str(self.folder / "store"),
        }

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run a command to its end; it shows nobody a traceback."""
        ran = subprocess.run(
            [*GESTA, *arguments],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=RUN_S,
            check=False,
        )
        assert "Traceback" not in ran.stderr, ran.stderr
        return ran

    @contextmanager
    def serving(self, worker: str = "embedded") -> Iterator[GestaClient]:
        """Run a server, with its worker or with none, which is killed in the end."""
        with (self.folder / "log").open("ab") as log:
            process = subprocess.Popen(
                [*GESTA, "serve", "--port", "0"],
                cwd=self.folder,
                env={**self.environment, "GESTA_JOB_WORKER": worker},
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
            )
        assert process.stdout is not None
        found = re.search(r"http://[\d.:]+", process.stdout.readline())
        assert found is not None, (self.folder / "log").read_text()
        try:
            with GestaClient(found[0]) as client:
                yield client
        finally:
            process.kill()
            process.wait(RUN_S)
            process.stdout.close()


@pytest.fixture(params=["sqlite", "postgresql"])
def new_house(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[], House]:
    """Make folders with an empty database each, all of one kind."""

    def make() -> House:
        folder = tmp_path / f"house-{len(list(tmp_path.iterdir()))}"
        folder.mkdir()
        if request.param == "sqlite":
            return House(folder, f"sqlite:///{folder / 'gesta.db'}")
        return House(folder, request.getfixturevalue("new_postgresql_database")())

    return make


@pytest.fixture
def house(tmp_path: Path) -> House:
    return House(tmp_path, f"sqlite:///{tmp_path / 'gesta.db'}")


def sent(motion: Any) -> dict[str, Any]:
    return trajectory(motion.times, motion.hand, motion.objects)


def teach(client: GestaClient) -> None:
    client.create_model("table-top", ["object"], description="for “all”")
    shown = demonstrations(3)[::6]
    client.add_demonstrations("table-top", [(each.action, sent(each.trajectory)) for each in shown])
    client.result(client.train("table-top", options={"n_states": 4})["id"])
    client.promote("table-top", "production", 1)


def stream(client: GestaClient) -> str:
    motion = recording(2, 2).trajectory
    with client.stream("table-top", rate_hz=100) as streamed:
        streamed.send(None, motion.hand, motion.objects)
        streamed.end()
        assert [message for message in streamed if message["type"] == "segment"]
    [session] = client.request("GET", "/sessions")["sessions"]
    return str(session["id"])


def told(client: GestaClient, session_id: str) -> Mapping[str, Any]:
    """Return what a server tells of all that it has."""
    paths = {
        "demonstrations": "/models/table-top/demonstrations",
        "versions": "/models/table-top/versions",
        "history": "/models/table-top/aliases/production/history",
    }
    found = {name: client.request("GET", path) for name, path in paths.items()}
    ids = [each["id"] for each in found["demonstrations"]["demonstrations"]]
    return {
        **found,
        "model": client.model("table-top"),
        "shown": [client.demonstration("table-top", id_) for id_ in ids],
        "session": client.session(session_id),
        "segments": client.segments(session_id),
        "recording": client.recording(session_id),
        "generated": client.generate("table-top", "production", "grasp", [0, 0, 0.02], [0.1, 0.35, 0.04]),
    }


def test_a_backup_restored_elsewhere_serves_the_same_and_goes_on_with_the_job(
    new_house: Callable[[], House], tmp_path: Path
) -> None:
    house, other, tar = new_house(), new_house(), str(tmp_path / "backup.tar")
    house.run("migrate")
    with house.serving() as client:
        teach(client)
        session_id = stream(client)
        before = told(client, session_id)
    with house.serving(worker="none") as client:
        job = client.train("table-top")["id"]
        backed_up = house.run("backup", tar)
        assert client.job(job)["state"] == "queued"
    assert (backed_up.returncode, backed_up.stderr) == (0, "")
    restored = other.run("restore", tar)
    assert (restored.returncode, restored.stderr) == (0, "")
    with other.serving() as client:
        after = told(client, session_id)
        assert {name: after[name] for name in before if name != "versions"} == {
            name: before[name] for name in before if name != "versions"
        }
        assert after["versions"]["versions"][-1:] == before["versions"]["versions"]
        assert client.result(job)["version"] == 2
    again = other.run("restore", tar)
    assert again.returncode == 2
    assert "the database has models already" in again.stderr
    assert other.run("sweep", "--older-than", "0").returncode == 0


def test_what_is_no_backup_is_refused_by_name(house: House) -> None:
    tar = house.folder / "backup.tar"
    missing = house.run("restore", str(tar))
    assert missing.returncode == 2
    assert "backup.tar" in missing.stderr
    house.run("migrate")
    house.run("backup", str(tar))
    tar.write_bytes(tar.read_bytes()[:100_000])
    refused = house.run("restore", str(tar))
    assert refused.returncode == 2
    assert "backup.tar: is cut off" in refused.stderr


def test_a_backup_that_cannot_be_made_says_why(house: House) -> None:
    empty = house.run("backup", "backup.tar")
    assert (empty.returncode, "there is no" in empty.stderr) == (2, True)
    house.run("migrate")
    nowhere = house.run("backup", "nowhere/backup.tar")
    assert (nowhere.returncode, "nowhere" in nowhere.stderr) == (2, True)


def test_a_sweep_tells_what_it_did_and_what_is_lost(house: House) -> None:
    with house.serving() as client:
        teach(client)
        digest = client.version("table-top")["digest"]
    store = house.folder / "store"
    orphan = store / "ab" / ("c" * 62)
    orphan.parent.mkdir(exist_ok=True)
    orphan.write_bytes(b"orphan")
    assert house.run("sweep").stdout.splitlines()[0] == "0 objects set aside, 0 bytes"
    dry = house.run("sweep", "--older-than", "PT0S", "--dry-run")
    assert (dry.returncode, dry.stdout.splitlines()[0]) == (0, "1 objects would be set aside, 6 bytes")
    assert orphan.exists()
    [path] = store.rglob(digest.removeprefix("sha256:")[2:])
    path.unlink()
    swept = house.run("sweep", "--older-than", "0")
    assert not orphan.exists()
    assert (swept.returncode, swept.stdout.splitlines()[0]) == (1, "1 objects set aside, 6 bytes")
    assert f"version 1 of model 'table-top': the store does not hold {digest}" in swept.stderr
    assert house.run("sweep", "--older-than", "soon").returncode == 2
