"""Writers that note what was acknowledged, and what must be true of any database that they wrote to."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from typing import Any

import numpy as np
import sqlalchemy as sa
from dbos import DBOS, DBOSClient

from app.registry import aliases, demonstrations, holdings, jobs, models, sessions, tables, versions
from app.registry.records import NewDemonstration, StoredEvent
from app.service.lab import Lab

MODEL = "table-top"
CHANNELS = ("t", "hand.x", "hand.y", "hand.z")
Told = set[tuple[Any, ...]]


class Writers:
    """Each adds its kind of thing to a lab for as long as it is let; ``told``: what was acknowledged."""

    def __init__(self, lab: Lab) -> None:
        self.lab = lab
        self.told: Told = set()
        with lab.database.transaction() as tx:
            models.create(tx, name=MODEL, objects=["object"])

    def demonstration(self, number: int) -> None:
        new = NewDemonstration("grasp", self.lab.store.put(b"shown %d" % number), 10, 1.0, ("object",), 0.0)
        with self.lab.database.transaction() as tx:
            [id_] = demonstrations.add(tx, MODEL, [new]).created
        self.told.add(("demonstration", id_, new.digest))

    def version(self, number: int) -> None:
        digest = self.lab.store.put(b"version %d" % number)
        with self.lab.database.transaction() as tx:
            record = versions.register(
                tx,
                MODEL,
                artifact_digest=digest,
                actions=["grasp"],
                options={"text": "a\tb\\N\né"},
                demonstrations=[],
                library_versions={},
                base=number or None,
            )
            aliases.put(tx, MODEL, "production", record.number)
        self.told.add(("version", record.number, digest))

    def session(self, number: int) -> None:
        id_ = f"session-{number}"
        with self.lab.database.transaction() as tx:
            sessions.create(
                tx,
                id_=id_,
                model=MODEL,
                version=1,
                token_hash="",
                artifact_digest=self.lab.store.put(b"version 0"),
                geometry={},
                channels=CHANNELS,
            )
        for turn in range(3):
            rows = np.full((5, len(CHANNELS)), float(turn), "<f8").tobytes()
            news = [StoredEvent(turn, "segment", f'{{"of": {turn}}}')]
            with self.lab.database.transaction() as tx:
                sessions.append(tx, sessions.Addition(id_, 0, 5 * turn, rows, news))
            self.told.add(("segment", id_, turn))

    def job(self, number: int) -> None:
        request = {"recording": self.lab.store.put(b"recording %d" % number), "version": 1}
        with self.lab.database.transaction() as tx:
            record, _ = jobs.create(tx, kind="segmentation", request=request, model=MODEL)
        self.told.add(("job", record.id))

    @contextmanager
    def writing(self, *, least: int) -> Iterator[None]:
        """Let all write while the block runs, which begins when each has written so many."""
        stop, ready = threading.Event(), threading.Barrier(5)
        failures: list[BaseException] = []

        def run(write: Callable[[int], None]) -> None:
            try:
                for number in count():
                    if number == least:
                        ready.wait(60)
                    if stop.is_set():
                        return
                    write(number)
            except BaseException as error:
                failures.append(error)
                ready.abort()

        kinds = (self.demonstration, self.version, self.session, self.job)
        threads = [threading.Thread(target=run, args=(kind,)) for kind in kinds]
        for thread in threads:
            thread.start()
        try:
            ready.wait(60)
            yield
        finally:
            stop.set()
            for thread in threads:
                thread.join()
        assert failures == []


def found(lab: Lab) -> Told:
    """Return what is in a lab, as the writers note it."""
    shown, made = sa.select(tables.demonstrations), sa.select(tables.versions)
    events, asked = sa.select(tables.session_events), sa.select(tables.jobs)
    with lab.database.reading() as tx:
        return {
            *(("demonstration", row.id, row.digest) for row in tx.execute(shown)),
            *(("version", row.number, row.artifact_digest) for row in tx.execute(made)),
            *(("segment", row.session_id, row.segment) for row in tx.execute(events)),
            *(("job", row.id) for row in tx.execute(asked)),
        }


def check(lab: Lab) -> None:
    """Hold what is in a lab against what must always be true."""
    with lab.database.reading() as tx:
        named = holdings.named(tx)
        known = {record.number for record in versions.page(tx, MODEL, size=10_000).records}
        [alias] = aliases.listing(tx, MODEL)
        moves = aliases.history(tx, MODEL, "production", size=10_000).records
        last = tx.scalar(sa.select(tables.version_numbers.c.last))
        for record in sessions.page(tx, size=10_000).records:
            chunks = sessions.chunks(tx, record.id)
            assert [chunk.first_seq for chunk in chunks] == list(range(0, record.n_frames, 5))
            told = sessions.events(tx, record.id)
            assert [event.event for event in told] == list(range(record.n_events))
            assert record.n_segments == record.n_events == len(chunks)
    assert known == set(range(1, len(known) + 1))
    assert (alias.version, last) == (len(known), len(known))
    assert [move.version for move in moves] == sorted(known, reverse=True)
    for digest, title in named.items():
        lab.store.get(digest, title)


def enqueue(lab: Lab, *ids: str) -> None:
    """Hand jobs to the engine, which nobody is there to do."""
    DBOS.migrate(lab.database.engine_url)
    with engine(lab) as client:
        for id_ in ids:
            client.enqueue({"workflow_name": "job", "queue_name": "jobs", "workflow_id": id_}, id_)


def enqueued(lab: Lab) -> set[str]:
    with engine(lab) as client:
        return {status.workflow_id for status in client.list_workflows()}


@contextmanager
def engine(lab: Lab) -> Iterator[DBOSClient]:
    client = DBOSClient(system_database_url=lab.database.engine_url)
    try:
        yield client
    finally:
        client.destroy()
