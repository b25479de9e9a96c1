"""``gesta replay``: a recording streamed, at any speed, gives what the recogniser gives."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from app.client import GestaClient
from app.motion.model import Model
from app.motion.simulation import recording
from tests.client.cutting import Wire
from tests.commands.conftest import (
    MOTION,
    SEEN,
    Run,
    Start,
    write_body,
    write_table,
)
from tests.talking import expected

METRIC = ("--unit", "m", "--up", "z")
pytestmark = pytest.mark.usefixtures("table_top")


@pytest.fixture
def body(tmp_path: Path) -> Path:
    return write_body(tmp_path / "seen.json", SEEN)


def test_at_full_speed(run: Run, trained: Model, client: GestaClient, body: Path, tmp_path: Path) -> None:
    table = write_table(tmp_path / "seen.csv", MOTION)
    for words in ((body, "--name", "mine"), (table, *METRIC)):
        outcome = run("replay", *words, "--model", "table-top", "--speed", 0, "--json")
        told = [json.loads(line) for line in outcome.stdout.splitlines()]
        assert told[:-1] == expected(trained, MOTION)
        assert (told[-1]["type"], told[-1]["frames"]) == ("ended", len(MOTION))
    for name in ("mine", "seen.csv"):
        assert len(list(client.pages(f"/sessions?name={name}", "sessions"))) == 1


def test_in_words(run: Run, trained: Model, body: Path) -> None:
    outcome = run("replay", body, "--model", "table-top", "--speed", 0, "--version", 1)
    actions = [event["action"] for event in expected(trained, MOTION) if event["type"] == "segment"]
    assert [line.split()[3] for line in outcome.stdout.splitlines()] == actions
    assert f"{len(actions)} segments in {len(MOTION)} frames" in outcome.stderr


def test_at_the_pace_of_its_times(run: Run, trained: Model, body: Path) -> None:
    begin = time.monotonic()
    outcome = run("replay", body, "--model", "table-top", "--speed", 4, "--json")
    took = time.monotonic() - begin
    assert [json.loads(line) for line in outcome.stdout.splitlines()][:-1] == expected(trained, MOTION)
    assert took > (MOTION.times[-1] - MOTION.times[0]) / 4


def test_over_a_way_that_breaks(start: Start, trained: Model, wire: Wire, tmp_path: Path) -> None:
    seen = recording(6, 12)
    body = write_body(tmp_path / "long.json", seen)
    process = start("replay", body, "--model", "table-top", "--speed", 5, "--json", url=wire.url)
    told = [process.first()]
    for _ in range(3):
        time.sleep(0.3)
        wire.cut()
    further, _ = process.finished()
    assert [*told, *further][:-1] == expected(trained, seen.trajectory)


def test_ctrl_c_ends_it_early_and_in_order(start: Start, trained: Model, body: Path) -> None:
    process = start("replay", body, "--model", "table-top", "--json")
    told = [process.first()]
    process.interrupt()
    further, _ = process.finished()
    told += further
    assert (told[-1]["type"], told[-1]["frames"] < len(MOTION)) == ("ended", True)
    assert told[:-1] == expected(trained, MOTION.part(0, told[-1]["frames"]))


def test_what_cannot_be_streamed_says_why(run: Run, body: Path, tmp_path: Path) -> None:
    table = write_table(tmp_path / "seen.csv", MOTION, "t,left.x,left.y,left.z")
    broken = json.loads(body.read_text())
    broken["trajectory"]["hand"] = [[1, 2]]
    (tmp_path / "broken.json").write_text(json.dumps(broken))
    (tmp_path / "mapping.json").write_text('{"hand": "right"}')
    mapped = ("--mapping", tmp_path / "mapping.json")
    for words, why in (
        ((tmp_path / "none.json",), "none.json: No such file"),
        ((tmp_path / "none.csv",), "none.csv: No such file"),
        ((table,), "--unit"),
        ((table, "--unit", "m"), "--up"),
        ((table, *METRIC), "no track is called 'hand'"),
        ((table, *METRIC, *mapped), "no track 'right'"),
        ((table, *METRIC, "--mapping", body), "seen.json: needs the form"),
        ((tmp_path / "broken.json",), "the trajectory needs"),
        ((body, "--version", 7), "version_not_found"),
    ):
        told = run("replay", *words, "--model", "table-top", "--speed", 0, code=1)
        assert why in told.stderr
        assert told.stdout == ""
