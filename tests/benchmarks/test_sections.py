"""The benchmarks at their smallest, so that they still run when they are wanted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.motion.model import Model
from app.motion.simulation import STYLES, Conditions, recording
from app.motion.trajectory import Recording
from benchmarks import stream
from benchmarks.recognition import on_folder
from benchmarks.served import server

CARRYING = Conditions(styles={action: STYLES[action] for action in ("grasp", "displace", "retract")})


def test_a_folder_is_recognised_from_person_to_person(tmp_path: Path) -> None:
    folder = tmp_path / "carrying"
    (folder / "sequences").mkdir(parents=True)
    lines = ["sequence,start_row,end_row,action"]
    for seed in range(8):
        name = f"{('anna', 'bela')[seed % 2]}_{seed}"
        lines += _write(folder / "sequences" / f"{name}.csv", recording(seed, 3, CARRYING))
    (folder / "segments.csv").write_text("\n".join(lines) + "\n")
    with server() as client:
        section, [goal] = on_folder(client, folder)
    assert [line.split("|")[1].strip() for line in section.splitlines() if "| Steps 1-3 |" in line] == [
        "anna, sequences",
        "bela, sequences",
        "**mean of sequences**",
    ]
    assert section.count("| greedy |") == 3
    assert float(goal.measured) > 0.5


def test_both_searches_find_the_same(trained: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "REPETITIONS", 1)
    monkeypatch.setattr(stream, "SHORT_ACTIONS", 2)
    assert "**hmmlearn / compiled**" in stream.ratio_section(trained)


def test_every_frame_has_its_cost(trained: Model) -> None:
    motion = recording(1, 2).trajectory
    for costs in stream.push_costs(trained, motion):
        assert costs.shape == (len(motion),)
        assert (costs >= 0).all()


def _write(file: Path, labelled: Recording) -> list[str]:
    """Write a sequence; return the rows of its segments."""
    motion = labelled.trajectory
    table = np.column_stack([motion.times, motion.hand, motion.objects["object"]])
    names = ["time_s", *(f"{track}_{axis}" for track in ("hand", "object") for axis in "xyz")]
    rows = [",".join(f"{value:.5f}" for value in row) for row in table]
    file.write_text("\n".join([",".join(names), *rows]) + "\n")
    return [f"{file.stem},{each.start},{each.end},{each.action}" for each in labelled.segments]
