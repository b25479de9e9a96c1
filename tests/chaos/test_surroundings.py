"""What a server stands on gives way for a while: nothing acknowledged is lost, and then all goes on."""

from __future__ import annotations

import os
import resource
import sqlite3
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.chaos.caller import Caller
from tests.chaos.house import GESTA, House, Postgres, housing
from tests.chaos.judge import Judge
from tests.chaos.rounds import MODEL, register, taught
from tests.chaos.streamer import Habits
from tests.chaos.streams import await_that, faults, short_motion, streaming
from tests.chaos.teacher import Mover, Teacher, batches, upload_of
from tests.chaos.told import Told

AWAY_S, FULL_S = 10.0, 2.0
"""How long a database is away, and a disk full [s]."""
TOLD_S = 1.0
"""How long after it has become durable something is told at the latest, with some to spare [s]."""
BACK = timedelta(hours=1)
"""How far the clock is set back."""
UNPRIVILEGED = ("setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-all")
"""Makes even root heed what a file lets its owner do."""


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    """A service on SQLite."""
    with housing(tmp_path) as built:
        register(built)
        yield built


@contextmanager
def midway(house: House) -> Iterator[Told]:
    """Stream a session: the block begins when some of it is durable, and in the end all of it is right."""
    told = Told(short_motion(0, 24))
    with streaming(house.url, [(told, Habits(pace=500.0))]):
        await_that(lambda: told.durable > 100)
        yield told
    assert faults(house, [told]) == []


def asked(house: House, method: str, path: str, body: Any = None) -> tuple[int, str]:
    """Ask once; return the status, and the code and detail of a problem."""
    answer = httpx.request(method, f"{house.url()}/v1{path}", json=body, timeout=60.0)
    told = answer.json()
    return answer.status_code, f"{told['code']}: {told['detail']}" if answer.is_error else ""


def uploaded(house: House) -> tuple[int, str]:
    """Upload demonstrations to the model of the streams; return what ``asked`` returns."""
    return asked(house, "POST", f"/models/{MODEL}/demonstrations", upload_of(next(batches(7))))


def all_goes_on(house: House, moves: int = 3) -> None:
    """A lesson is taught, an alias moved, and all of it is there once."""
    with Caller(house.url) as caller:
        teacher, mover = Teacher(caller, seed=1), Mover(caller, MODEL, "production")
        for number in range(moves):
            mover.move(1 + number % 2)
        teacher.create()
        teacher.teach(threading.Event())
        court = Judge(caller, taught())
        assert [*court.of_teacher(teacher), *court.of_moves(mover), *court.of_moves(teacher.promoted)] == []


def nothing_more_durable(told: Told, seconds: float) -> int:
    """Let the time pass; return what is durable, of which nothing more may be told."""
    time.sleep(TOLD_S)
    durable = told.durable
    time.sleep(seconds - TOLD_S)
    assert told.durable == durable
    return durable


def ready(house: House) -> bool:
    return httpx.get(f"{house.url()}/readyz", timeout=60.0).status_code == 200


def test_the_disk_is_full(house: House) -> None:
    """No file may grow, and none be written to; the limit is that of the server's process."""
    process = house.servers[0].running.pid
    usual = resource.prlimit(process, resource.RLIMIT_FSIZE)
    with midway(house) as told:
        resource.prlimit(process, resource.RLIMIT_FSIZE, (0, usual[1]))
        assert uploaded(house)[0] == 503
        assert not ready(house)
        durable = nothing_more_durable(told, FULL_S)
        resource.prlimit(process, resource.RLIMIT_FSIZE, usual)
        await_that(lambda: told.durable > durable)
        assert uploaded(house)[0] == 201
    all_goes_on(house)


def test_the_store_is_read_only(house: House) -> None:
    """What is there can be had, what is new is refused, streams go on."""
    if os.geteuid() == 0:
        house.servers[0].restart(*UNPRIVILEGED, *GESTA)
        house.await_ready()
    folders = [house.folder / "store", *(house.folder / "store").iterdir()]
    with midway(house):
        for folder in folders:
            folder.chmod(0o555)
        assert uploaded(house)[0] == 503
        assert uploaded(house)[1].startswith("store_unavailable")
        assert not ready(house)
        assert asked(house, "GET", f"/models/{MODEL}/versions/1/artifact")[0] == 200
        for folder in folders:
            folder.chmod(0o755)
        assert ready(house)
        assert uploaded(house)[0] == 201
    all_goes_on(house)


def test_an_altered_artifact_is_never_served(house: House) -> None:
    """A version that is damaged is named, others go on, and healed it is as it was."""
    with Caller(house.url) as caller:
        Mover(caller, MODEL, "production").move(1)
        digest = caller.insist("GET", f"/models/{MODEL}/versions/1")["digest"].removeprefix("sha256:")
    path = house.folder / "store" / digest[:2] / digest[2:]
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"grasp", b"grasq", 1))
    house.servers[0].restart()
    house.await_ready()
    told = Told(short_motion())
    with streaming(house.url, [(told, Habits(pace=4000.0))]):
        status, problem = asked(house, "GET", f"/models/{MODEL}/versions/1/artifact")
        assert (status, problem.partition(":")[0]) == (503, "artifact_altered")
        assert MODEL in problem
        assert "1" in problem
        assert asked(house, "GET", f"/models/{MODEL}/versions/2/artifact")[0] == 200
        await_that(lambda: told.closings[1011])
        assert not told.session_id
        path.write_bytes(whole)
    assert faults(house, [told]) == []
    assert told.version == 1


def test_sqlite_is_locked_by_another(house: House) -> None:
    with midway(house) as told:
        with closing(sqlite3.connect(house.folder / "gesta.db", isolation_level=None)) as other:
            other.execute("BEGIN IMMEDIATE")
            durable = nothing_more_durable(told, AWAY_S)
            other.execute("ROLLBACK")
        await_that(lambda: told.durable > durable)
    all_goes_on(house)


def test_postgresql_is_away(tmp_path: Path, mortal_postgresql: Postgres) -> None:
    """First it says nothing, then it is not there."""
    with housing(tmp_path, mortal_postgresql) as house:
        register(house)
        with midway(house) as told:
            mortal_postgresql.freeze()
            try:
                durable = nothing_more_durable(told, AWAY_S / 2)
            finally:
                mortal_postgresql.kill()
            try:
                assert uploaded(house)[1].startswith("database_unavailable")
                assert not ready(house)
                assert nothing_more_durable(told, AWAY_S / 2) == durable
            finally:
                mortal_postgresql.start()
            await_that(lambda: told.durable > durable)
            house.await_ready()
        all_goes_on(house)


def test_the_clock_is_set_back(house: House) -> None:
    """Server and worker are killed and come back an hour earlier, under a session that is streamed."""
    early = (sys.executable, "-m", "tests.chaos.clock", str(-BACK.total_seconds()))
    with midway(house) as told:
        for process in (*house.servers, *house.workers):
            process.restart(*early)
        house.await_ready()
    assert told.resumed >= 1
    all_goes_on(house)
    with Caller(house.url) as caller:
        made = datetime.fromisoformat(caller.insist("GET", "/models/lessons/versions/1")["created_at"])
    assert datetime.now(UTC) - made > BACK / 2
