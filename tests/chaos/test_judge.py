"""The judge sees what it is there for: what is told wrongly, and what is missing or there twice."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
from sqlalchemy import text

from tests.chaos.caller import Caller
from tests.chaos.house import House
from tests.chaos.judge import Judge
from tests.chaos.rounds import MODEL, taught
from tests.chaos.streamer import Habits
from tests.chaos.streams import short_motion, streaming
from tests.chaos.teacher import Mover, Teacher
from tests.chaos.told import Fault, Told

STARTED = {"session_id": "a", "resume_token": "b", "version": 1, "next_seq": 0}


class Court:
    """A session, a lesson and some moves of an alias, and what is found wrong with them."""

    def __init__(self, house: House, caller: Caller) -> None:
        self._house, self._judge = house, Judge(caller, taught())
        self.told, self.mover = Told(short_motion()), Mover(caller, MODEL, "production")
        for number in range(4):
            self.mover.move(1 + number % 2)
        self.teacher = Teacher(caller, seed=1)
        self.teacher.create()
        self.teacher.teach(threading.Event())
        with streaming(house.url, [(self.told, Habits(pace=4000))]):
            pass

    def faults(self) -> set[tuple[str, str]]:
        found: list[Fault] = [*self._judge.of_session(self.told), *self._judge.of_teacher(self.teacher)]
        found += [*self._judge.of_moves(self.mover), *self._judge.of_moves(self.teacher.promoted)]
        return {(fault.kind, fault.of) for fault in found}

    def tamper(self, statement: str) -> None:
        values = {"session": self.told.session_id, "shown": next(iter(self.teacher.demonstrations))}
        with self._house.database.transaction() as tx:
            used = {name: value for name, value in values.items() if f":{name}" in statement}
            assert tx.execute(text(statement), used).rowcount  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def court(house: House) -> Iterator[Court]:
    with Caller(house.url, patience=2.0) as caller:
        yield Court(house, caller)


TAMPERINGS = [
    ("UPDATE sessions SET n_frames = n_frames - 1 WHERE id = :session", ("contradicted", "session")),
    ("DELETE FROM session_frames WHERE session_id = :session AND first_seq > 0", ("lost", "frames")),
    (
        "UPDATE session_events SET text = replace(text, 'start_seq', 'stop_seq')"
        " WHERE session_id = :session AND event = 0",
        ("contradicted", "segment"),
    ),
    (
        "DELETE FROM session_events WHERE session_id = :session AND type = 'segment' AND event > 5",
        ("lost", "segment"),
    ),
    ("DELETE FROM demonstrations WHERE id = :shown", ("lost", "demonstration")),
    ("UPDATE jobs SET state = 'failed'", ("lost", "job")),
    (
        "INSERT INTO alias_changes (model, alias, version, at) SELECT model, alias, version, at"
        " FROM alias_changes WHERE model = 'table-top' LIMIT 1",
        ("doubled", "alias move"),
    ),
    ("DELETE FROM alias_changes WHERE model = 'lessons'", ("lost", "alias move")),
    ("DELETE FROM aliases WHERE model = 'lessons'", None),
    ("DELETE FROM versions WHERE model = 'lessons'", ("lost", "version")),
    ("DELETE FROM sessions WHERE id = :session", ("lost", "session")),
]


def test_sees_what_is_missing_and_what_is_there_twice(court: Court) -> None:
    assert court.faults() == set()
    for statement, fault in TAMPERINGS:
        assert fault not in court.faults()
        court.tamper(statement)
        assert fault is None or fault in court.faults(), statement


def event(number: int, **fields: object) -> dict[str, object]:
    return {"type": "segment", "event": number, **fields}


def test_sees_what_is_told_wrongly() -> None:
    told = Told(short_motion())
    told.started(STARTED, durable=-1)
    for number in (0, 1):
        told.event(event(number), wanted=number)
    told.accepted({"through_seq": 9, "durable_seq": 9})
    told.started({**STARTED, "next_seq": 10}, durable=9)
    told.event(event(0), wanted=0)
    assert told.faults == []
    told.event(event(3), wanted=2)
    told.event(event(1), wanted=2)
    told.event(event(0, action="grasp"), wanted=0)
    told.started({**STARTED, "next_seq": 9}, durable=9)
    told.started({**STARTED, "version": 2, "next_seq": 10}, durable=9)
    assert [(fault.kind, fault.of) for fault in told.faults] == [
        ("lost", "event"),
        ("doubled", "event"),
        ("contradicted", "event"),
        ("lost", "frames"),
        ("contradicted", "session"),
    ]
