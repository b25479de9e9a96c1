"""The benchmarks at their smallest, so that they still run when they are wanted."""

from __future__ import annotations

import pytest

from app.motion.model import Model
from app.motion.simulation import recording
from benchmarks import stream
from benchmarks.recognition import through_server


def test_a_server_finds_the_same() -> None:
    section, [goal] = through_server(2)
    assert (goal.measured, goal.met) == ("2 of 2", True)
    assert "| 2 | 6 | 6 | 2 |" in section


def test_both_searches_find_the_same(trained: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "REPETITIONS", 1)
    monkeypatch.setattr(stream, "SHORT_ACTIONS", 2)
    assert "**hmmlearn / compiled**" in stream.ratio_section(trained)


def test_every_frame_has_its_cost(trained: Model) -> None:
    motion = recording(1, 2).trajectory
    for costs in stream.push_costs(trained, motion):
        assert costs.shape == (len(motion),)
        assert (costs >= 0).all()
