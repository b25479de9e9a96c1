"""Two servers and two workers on one database and one store: what comes and goes loses nothing."""

from __future__ import annotations

import pytest

from benchmarks import cluster


def test_nothing_is_lost_when_servers_and_workers_are_restarted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "SETTLE_S", 1.0)
    found = cluster.measure(streams=4, seconds=20.0)
    assert (found.right, found.contiguous, found.jobs) == (4, 4, cluster.N_JOBS)
    assert found.segments > 4
    section, goals = cluster.section(found)
    assert "| pause of a client, rolling restart |" in section
    assert [goal.met for goal in goals[:3]] == [True] * 3
