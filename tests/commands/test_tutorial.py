"""The tutorial's commands, in its order, do what it says, on files as a lab has them."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from subprocess import Popen

import pytest

from app.motion.simulation import recording
from tests.api.conftest import working
from tests.serving import ROOT, Server
from tests.takes import write_take

TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text()
COMMANDS = [
    line
    for block in re.findall(r"^```bash\n(.*?)^```", TUTORIAL, re.DOTALL | re.MULTILINE)
    for line in block.splitlines()
]
TIMEOUT_S = 120


@pytest.fixture(scope="module")
def worker(server: Server) -> Iterator[Popen[bytes]]:
    with working(server) as process:
        yield process


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with labelled recordings, new ones, and frames as lines of JSON."""
    folder = tmp_path_factory.mktemp("lab")
    for number in range(1, 9):
        write_take(recording(number, 6), folder / "recordings", f"take{number}")
    new = recording(9, 6)
    write_take(new, folder / "new", "take9", labelled=False)
    lines = [
        json.dumps({"hand": hand.tolist(), "objects": {"object": thing.tolist()}})
        for hand, thing in zip(new.trajectory.hand, new.trajectory.objects["object"], strict=True)
    ]
    (folder / "frames.jsonl").write_text("\n".join([*lines, ""]))
    return folder


@pytest.fixture(scope="module")
def done(server: Server, worker: Popen[bytes], lab: Path) -> list[str]:
    """What the commands printed, one after the other."""
    beside = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    told = []
    for command in COMMANDS:
        ran = subprocess.run(
            ["bash", "-c", f"set -o pipefail; {command}"],
            cwd=lab,
            env={**os.environ, "PATH": beside, "GESTA_URL": server.url},
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
        assert ran.returncode == 0, (command, ran.stdout, ran.stderr)
        told.append(ran.stdout + ran.stderr)
    return told


def test_the_mapping_is_the_one_that_is_shown(done: list[str], lab: Path) -> None:
    [shown] = re.findall(r"^```json\n(.*?)^```", TUTORIAL, re.DOTALL | re.MULTILINE)
    assert json.loads((lab / "mapping.json").read_text()) == json.loads(shown)


def test_the_demonstrations_are_classified_right(done: list[str]) -> None:
    [share] = re.findall(r"([\d.]+)% of \d+ demonstrations classified right", done[1])
    assert float(share) > 90.0
    assert "production" in done[1]


def test_new_recordings_are_segmented_as_they_were_done(done: list[str], lab: Path) -> None:
    truth = [segment.action for segment in recording(9, 6).segments]
    with (lab / "segments.csv").open(newline="") as file:
        assert [row["action"] for row in csv.DictReader(file)] == truth
    assert [line.split()[3] for line in done[3].splitlines() if re.match(r"\s+\d+ +[\d.]+", line)] == truth


def test_the_movement_is_written(done: list[str], lab: Path) -> None:
    with (lab / "grasp.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(rows[-1][axis]) for axis in "xyz"] == [0.2, 0.3, 0.05]


def test_what_is_printed_is_what_is_run() -> None:
    assert len(COMMANDS) == 6
    assert all("gesta " in command for command in COMMANDS)
