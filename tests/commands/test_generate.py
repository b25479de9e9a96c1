"""``gesta generate``: a movement as table, JSON or bag, and what is told of it."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import pytest

from tests.commands.conftest import Run

ENDS = ("--start", "0,0,0.02", "--goal", "0.1,0.35,0.04")
pytestmark = pytest.mark.usefixtures("table_top")


def test_a_movement_is_shown(run: Run) -> None:
    lines = run("generate", "table-top", "grasp", *ENDS).stdout.splitlines()
    assert lines[0].startswith("grasp, version 1 of table-top: ")
    assert lines[3].split() == ["0.000", "0.000", "0.000", "0.020", "0.000"]
    assert lines[-1].split()[1:] == ["0.100", "0.350", "0.040", "0.000"]
    assert len(lines) == 14


def test_a_file_has_the_form_of_its_name(run: Run, tmp_path: Path) -> None:
    asked = ("generate", "table-top", "grasp", *ENDS, "--rate", 50, "--json")
    told = json.loads(run(*asked, "--output", tmp_path / "way.csv").stdout)
    run(*asked, "--output", tmp_path / "way.json")
    run(*asked, "--output", tmp_path / "way.mcap")
    rows = list(csv.DictReader(io.StringIO((tmp_path / "way.csv").read_text())))
    assert [[float(row[axis]) for axis in "xyz"] for row in rows] == told["position"]
    assert json.loads((tmp_path / "way.json").read_text()) == told
    assert (tmp_path / "way.mcap").read_bytes().startswith(b"\x89MCAP")


def test_what_stands_against_it_is_told(run: Run, tmp_path: Path) -> None:
    asked = (
        "--start",
        "-0.1,0,0.02",
        "--goal",
        "-1.1,0.35,-0.4",
        "--via",
        "0,0.1,0.3,0.5",
        "--via",
        "0,0,0,0.7,0.5",
    )
    output = tmp_path / "way.csv"
    outcome = run("generate", "table-top", "grasp", *asked, "--velocity", 0.3, "--output", output, code=1)
    for word in ("goal_far: ", "slowed: ", "via: ", "table: -0.4 at ", "not feasible"):
        assert word in outcome.stderr
    assert output.exists()
    told = json.loads(run("generate", "table-top", "grasp", *asked, "--json", code=1).stdout)
    assert not told["feasibility"]["feasible"]


def test_what_is_refused_is_told(run: Run) -> None:
    assert "action_not_found" in run("generate", "table-top", "wave", *ENDS, code=1).stderr
    refused = run("generate", "table-top", "grasp", *ENDS, "--acceleration", -1, code=1).stderr
    assert "/limits/acceleration_m_s2: Input should be greater than 0" in refused


@pytest.mark.parametrize(
    "words",
    [
        ("--start", "0,0", "--goal", "0,0,0"),
        ("--start", "0,0,high", "--goal", "0,0,0"),
        ("--goal", "0,0,0"),
        (*ENDS, "--via", "0,0,0"),
        (*ENDS, "--via", "0,0,0,0.5,0.1,7"),
        (*ENDS, "--output", "way.txt"),
    ],
)
def test_what_cannot_be_asked_is_wrong_usage(run: Run, words: tuple[str, ...]) -> None:
    assert "Usage: " in run("generate", "table-top", "grasp", *words, code=2).stderr
