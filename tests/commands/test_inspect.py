"""``gesta inspect``: what is in a file, and a mapping for it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from app.motion.trajectory import Trajectory
from tests.commands.conftest import MOTION, gesta, write_table

METRIC = ("--unit", "m", "--up", "z")


def test_what_is_in_a_file_is_told(tmp_path: Path) -> None:
    hand = MOTION.hand[:200].copy()
    hand[50:60] = hand[100:105] = np.nan
    motion = Trajectory(MOTION.times[:200], hand, {"object": MOTION.objects["object"][:200]})
    file = write_table(tmp_path / "seen.csv", motion, "t,Hand.x,Hand.y,Hand.z", "red cup")
    mapping = tmp_path / "mapping.json"
    shown = gesta("inspect", file, *METRIC, "--write", mapping)
    assert shown.exit_code == 0, shown.output
    assert f"{file}: csv, 200 frames at 100 Hz, 1.99 s" in shown.stdout
    row = next(line for line in shown.stdout.splitlines() if line.startswith(" Hand "))
    assert row.split()[1:4] == ["7.5%", "2", "0.100"]
    assert "hand: 'Hand', by its name" in shown.stdout
    told = json.loads(gesta("inspect", file, *METRIC, "--json").stdout)
    assert told["mapping"] == json.loads(mapping.read_text())
    assert told["mapping"] == {"hand": ["Hand"], "objects": {"object": ["red cup"]}}
    assert (told["n_frames"], round(told["rate_hz"])) == (200, 100)
    assert told["tracks"][0]["max"] == np.nanmax(hand, axis=0).tolist()
    again = gesta("inspect", file, *METRIC, "--write", mapping)
    assert (again.exit_code, "is there already" in again.stderr) == (1, True)


def test_what_cannot_be_read_says_why(tmp_path: Path) -> None:
    table = write_table(tmp_path / "seen.csv", MOTION, "t,a.x,a.y,a.z", "b")
    (tmp_path / "notes.txt").write_text("no recording")
    (tmp_path / "empty.c3d").write_text("")
    for words, why in (
        ((tmp_path / "none.c3d",), "none.c3d: No such file"),
        ((tmp_path / "notes.txt",), "in no format that is known"),
        ((tmp_path / "empty.c3d",), "empty.c3d: "),
        ((table,), "--unit"),
        ((table, *METRIC, "--write", tmp_path / "mapping.json"), "no mapping to write"),
    ):
        outcome = gesta("inspect", *words)
        assert outcome.exit_code == 1
        assert why in outcome.stderr
