"""``gesta segment``: an archive becomes jobs, once, and its segments a file or a table."""

from __future__ import annotations

import csv
import io
import json
import os
import pty
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from typer.testing import CliRunner, Result

from app.cli import cli
from app.client import METRES, GestaClient, trajectory
from app.commands import segment
from app.commands.archive import recordings
from app.commands.recordings import Reading
from app.commands.segment import COLUMNS, Archive
from app.motion.model import Model
from app.motion.simulation import recording
from app.motion.trajectory import Trajectory
from tests.api.conftest import working
from tests.commands.conftest import GESTA
from tests.serving import ROOT, Server

MOTIONS = [recording(seed, 3).trajectory for seed in (31, 32, 33)]
METRIC = ("--unit", "m", "--up", "z")
HEADER = "t,hand.x,hand.y,hand.z,object.x,object.y,object.z"


def as_body(motion: Trajectory) -> dict[str, Any]:
    return {"geometry": METRES, "trajectory": trajectory(motion.times, motion.hand, motion.objects)}


def write_csv(path: Path, motion: Trajectory, scale: float = 1.0) -> None:
    columns = [motion.times[:, None], scale * motion.hand, scale * motion.objects["object"]]
    rows = [",".join(map(repr, row)) for row in np.hstack(columns).tolist()]
    path.write_text("\n".join([HEADER, *rows]) + "\n")


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """A directory of three recordings, two of them below it."""
    folder = tmp_path / "archive"
    (folder / "day 2").mkdir(parents=True)
    (folder / "one.json").write_text(json.dumps(as_body(MOTIONS[0])))
    (folder / "day 2" / "two.json").write_text(json.dumps(as_body(MOTIONS[1])))
    write_csv(folder / "day 2" / "three.csv", MOTIONS[2])
    (folder / "notes.txt").write_text("not a recording")
    return folder


def gesta(*words: object) -> Result:
    return CliRunner().invoke(cli, ["segment", *map(str, words)])


def at_terminal(*words: object) -> list[Any]:
    """Return the lines of JSON that a command tells whose progress is shown at a terminal."""
    near, far = pty.openpty()
    try:
        ran = subprocess.run(
            [*GESTA, *map(str, words)], cwd=ROOT, check=True, stdout=subprocess.PIPE, stderr=far, timeout=60
        )
        assert "3/3" in os.read(near, 1 << 16).decode()
    finally:
        os.close(near)
        os.close(far)
    return [json.loads(line) for line in ran.stdout.splitlines()]


def found(client: GestaClient, model: str, motion: Trajectory) -> list[dict[str, Any]]:
    body = as_body(motion)
    segments: list[dict[str, Any]] = client.segment(model, "latest", body["trajectory"])["segments"]
    return segments


@pytest.fixture
def client(server: Server) -> Iterator[GestaClient]:
    with GestaClient(server.url) as opened:
        yield opened


@pytest.fixture
def model(server: Server, trained: Model, request: pytest.FixtureRequest) -> str:
    """The name of a model of the test's own."""
    return server.teach(trained, request.node.originalname)


def jobs_of(client: GestaClient, model: str) -> list[dict[str, Any]]:
    return list(client.pages(f"/jobs?model={model}", "jobs"))


def test_every_recording_is_a_job_and_the_same_again_does_nothing_twice(
    server: Server, client: GestaClient, model: str, trained: Model, archive: Path, tmp_path: Path
) -> None:
    output = tmp_path / "found.jsonl"
    asked = (
        archive,
        archive / "one.json",
        "--model",
        model,
        *METRIC,
        "--url",
        server.url,
        "--output",
        output,
    )
    with working(server):
        first = gesta(*asked)
    assert first.exit_code == 0, first.output
    assert "3/3" in first.output
    told = [json.loads(line) for line in output.read_text().splitlines()]
    paths = [archive / name for name in ("day 2/three.csv", "day 2/two.json", "one.json")]
    assert [line["recording"] for line in told] == [str(path) for path in paths]
    assert [line["segments"] for line in told] == [found(client, model, motion) for motion in MOTIONS[::-1]]
    assert len(jobs_of(client, model)) == 3
    assert gesta(*asked).exit_code == 0, "no worker is there, none is needed"
    assert [json.loads(line) for line in output.read_text().splitlines()] == told
    assert len(jobs_of(client, model)) == 3
    assert at_terminal("segment", archive, "--model", model, *METRIC, "--url", server.url, "--json") == told
    server.teach(trained, model)
    with working(server):
        assert gesta(*asked).exit_code == 0
    assert len(jobs_of(client, model)) == 6, "another version"


def test_a_table_has_a_row_for_each_segment(
    server: Server, client: GestaClient, model: str, tmp_path: Path
) -> None:
    folder, output = tmp_path, tmp_path / "found.csv"
    write_csv(folder / "in mm.csv", MOTIONS[0], 1000.0)
    with working(server):
        for _ in range(2):
            outcome = gesta(
                folder,
                "--model",
                model,
                "--version",
                1,
                "--url",
                server.url,
                "--unit",
                "mm",
                "--up",
                "z",
                "--output",
                output,
            )
            assert outcome.exit_code == 0, outcome.output
        shown = gesta(
            folder / "in mm.csv", "--model", model, "--url", server.url, "--unit", "mm", "--up", "z"
        )
    rows = list(csv.DictReader(io.StringIO(output.read_text())))
    assert tuple(rows[0]) == COLUMNS
    expected = found(client, model, MOTIONS[0])
    assert [row["action"] for row in rows] == [each["action"] for each in expected]
    assert [int(row["end_seq"]) for row in rows] == [each["end_seq"] for each in expected]
    assert {row["objects"] for row in rows} == {"object=object"}
    assert {row["recording"] for row in rows} == {str(folder / "in mm.csv")}
    lines = [line.split() for line in shown.stdout.splitlines()[2:]]
    assert [line[-3] for line in lines] == [row["action"] for row in rows]


def test_what_fails_is_named_and_the_rest_goes_on(
    server: Server, client: GestaClient, model: str, archive: Path
) -> None:
    (archive / "broken.json").write_text("{")
    (archive / "empty.csv").write_text("")
    refused = as_body(MOTIONS[0])
    refused["trajectory"]["hand"] = refused["trajectory"]["hand"][1:]
    (archive / "refused.json").write_text(json.dumps(refused))
    with working(server):
        outcome = gesta(archive, "--model", model, "--url", server.url, "--json", *METRIC)
    assert outcome.exit_code == 1
    assert "Traceback" not in outcome.output
    assert "3 of 6 recordings failed" in outcome.stderr
    for name, why in (("broken.json", "no JSON"), ("empty.csv", "needs a column t"), ("refused.json", "422")):
        assert any(name in line and why in line for line in outcome.stderr.splitlines()), outcome.stderr
    assert len(outcome.stdout.splitlines()) == 3


def test_a_job_that_was_done_in_vain_is_asked_for_anew(
    server: Server, client: GestaClient, model: str, archive: Path
) -> None:
    asked = (archive / "one.json", "--model", model, "--url", server.url)

    def cancel_all() -> None:
        for job in jobs_of(client, model):
            client.cancel(job["id"])

    with cancelling(client, cancel_all):
        assert gesta(*asked).exit_code == 1
    assert len(jobs_of(client, model)) == 1
    with working(server):
        outcome = gesta(*asked)
    assert outcome.exit_code == 0, outcome.output
    assert [job["state"] for job in jobs_of(client, model)] == ["succeeded", "cancelled"]


@contextmanager
def cancelling(client: GestaClient, cancel_all: Callable[[], None]) -> Iterator[None]:
    """Cancel whatever is waited for."""
    waited = GestaClient.result

    def result(self: GestaClient, job_id: str, *given: Any) -> Any:
        cancel_all()
        return waited(self, job_id, *given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(GestaClient, "result", result)
        yield


def test_what_cannot_begin_says_why(server: Server, model: str, archive: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    at = ("--url", server.url)
    for words, why in (
        ((tmp_path / "none", "--model", model, *at), "no such file"),
        ((tmp_path / "empty", "--model", model, *at), "no recordings (.bag"),
        ((archive, "--model", "nobody", *at), "model_not_found"),
        ((archive, "--model", model, "--version", "best", *at), "version_not_found"),
        ((archive, "--model", model, "--url", "http://127.0.0.1:9"), "http://127.0.0.1:9 does not answer"),
    ):
        outcome = gesta(*words)
        assert (outcome.exit_code, outcome.stdout) == (1, "")
        assert why in outcome.stderr
        assert "Traceback" not in outcome.stderr


def test_folders_are_searched_for_recordings_alone(archive: Path, tmp_path: Path) -> None:
    output, mapping = archive / "one.json", archive / "mapping.json"
    (archive / "one.labels.json").write_text("[]")
    mapping.write_text("{}")
    (archive / "bag").mkdir()
    for name in ("metadata.yaml", "bag_0.db3"):
        (archive / "bag" / name).touch()
    assert [path.name for path in recordings([archive], output, mapping)] == ["bag", "three.csv", "two.json"]
    assert recordings([archive / "bag"]) == [archive / "bag"]
    assert len(recordings([archive, archive / "day 2"], mapping)) == 4


def test_a_server_that_is_away_for_a_moment_is_asked_again(
    archive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers: list[Any] = [httpx.ConnectError("away"), {"id": "job", "state": "queued"}]

    def answer(*_: Any, **__: Any) -> Any:
        if isinstance(given := answers.pop(0), Exception):
            raise given
        return given

    monkeypatch.setattr(segment, "PAUSE_S", 0.0)
    with GestaClient() as client:
        monkeypatch.setattr(client, "segment", answer)
        assert Archive(client, "table-top", 1, Reading()).submit(archive / "one.json") == "job"
