"""Servers, worker and database are killed under clients at work: nothing is lost, nothing is there twice.

The long form, with hundreds of rounds, is ``benchmarks/chaos.py``.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.chaos.house import Postgres, housing
from tests.chaos.rounds import play

ROUNDS = 5
AT_LEAST = ("resumptions", "segments", "events listened to", "alias moves", "versions", "demonstrations")


@pytest.mark.parametrize("n_servers", [1, 2])
def test_nothing_is_lost_on_sqlite(tmp_path: Path, n_servers: int) -> None:
    with housing(tmp_path, n_servers=n_servers, n_workers=2) as house:
        act = play(house, "sqlite", ROUNDS, seed=1)
    assert act.faults == []
    assert all(act.counts[what] for what in AT_LEAST), act.counts


@pytest.mark.parametrize("n_servers", [1, 2])
def test_nothing_is_lost_on_postgresql(tmp_path: Path, mortal_postgresql: Postgres, n_servers: int) -> None:
    with housing(tmp_path, mortal_postgresql, n_servers, n_workers=2) as house:
        act = play(house, "postgresql", ROUNDS, seed=1)
    assert act.faults == []
    assert all(act.counts[what] for what in AT_LEAST), act.counts
