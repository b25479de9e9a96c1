"""Sessions in one process on both databases: written, failing, tidied up; no server, no sockets."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Sequence
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from app.motion.model import Model
from app.motion.simulation import recording
from app.registry import models, sessions, versions
from app.registry.artifacts import dump_model
from app.registry.database import Database
from app.registry.errors import DatabaseUnavailable
from app.registry.records import SessionRecord
from app.registry.store import Store
from app.service.frames import Frames
from app.service.geometry import Geometry
from app.service.journal import Entry
from app.service.lab import Lab
from app.service.live import Limits, LiveSessions
from app.service.session_archive import recording as recording_of
from app.service.session_errors import SessionGone, TakenOver, WriteFailed
from app.service.session_retention import PERIOD, keep_tidy, tidy
from app.service.session_start import Ticket, Wish
from app.service.session_store import SessionStore
from tests.talking import expected

MOTION = recording(5, 5).trajectory
WISH = Wish("table-top", Geometry())
RETENTION = timedelta(days=7)


@pytest.fixture
def lab(database: Database, store: Store, trained: Model) -> Lab:
    """A lab with a model version, on each kind of database."""
    digest = store.put(dump_model(trained))
    with database.transaction() as tx:
        models.create(tx, name="table-top", objects=trained.features.objects)
        versions.register(
            tx,
            "table-top",
            artifact_digest=digest,
            actions=trained.names,
            options={},
            demonstrations=[],
            library_versions={},
        )
    return Lab(database, store)


def frames(start: int, stop: int) -> Frames:
    """Return frames of the motion as they come from the wire."""
    part = MOTION.part(start, stop)
    return Frames(start, part.times, np.stack([part.hand, *part.objects.values()], axis=1))


def live_run(lab: Lab, work: Callable[[LiveSessions], Awaitable[None]]) -> None:
    """Let live sessions work, then drain them; nobody is there to leave."""

    async def run() -> None:
        live = LiveSessions(SessionStore(lab), Limits(drain=0.0))
        try:
            await work(live)
        finally:
            await live.drain()

    asyncio.run(run())


def record_of(lab: Lab, session_id: str) -> SessionRecord:
    with lab.database.reading() as tx:
        return sessions.get(tx, session_id)


def test_what_is_taken_in_becomes_durable_in_order(lab: Lab, trained: Model) -> None:
    async def work(live: LiveSessions) -> None:
        attachment, _ = await live.open(WISH)
        session = attachment.session
        for start in range(0, 400, 100):
            await session.take(frames(start, start + 100))
        await session.saved()
        assert record_of(lab, session.pinned.session_id).n_frames == 400
        await session.take(frames(350, len(MOTION)))
        await session.end(len(MOTION) - 1)
        record = record_of(lab, session.pinned.session_id)
        assert (record.state, record.n_frames) == ("ended", len(MOTION))
        assert record.n_segments == len(expected(trained, MOTION)) > 0
        found = recording_of(lab, record.id)
        np.testing.assert_array_equal(found.tracks["hand"], MOTION.hand)
        np.testing.assert_array_equal(found.times, MOTION.times)

    live_run(lab, work)


def test_a_session_that_cannot_be_written_goes_on_from_what_is_durable(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(self: SessionStore, entries: Sequence[Entry]) -> None:
        raise OSError("the disk is full")

    async def work(live: LiveSessions) -> None:
        attachment, token = await live.open(WISH)
        session = attachment.session
        await session.take(frames(0, 100))
        with pytest.raises(WriteFailed):
            await session.saved()
        with pytest.raises(WriteFailed):
            await session.end()
        live.leave(attachment)
        monkeypatch.undo()
        again = await live.resume(Ticket(session.pinned.session_id, token, -1, WISH))
        assert again.session is not session
        assert again.session.next_seq == 0

    monkeypatch.setattr(SessionStore, "write", fails)
    live_run(lab, work)


def test_an_answer_of_the_database_that_is_lost_doubles_nothing(
    lab: Lab, trained: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The commit took place, but nobody was told: what is written once more is there already."""
    write, lost = SessionStore.write, list[int]()

    def loses_every_other_answer(self: SessionStore, entries: Sequence[Entry]) -> None:
        write(self, entries)
        lost.append(len(entries))
        if len(lost) % 2:
            raise DatabaseUnavailable("the connection was lost")

    async def work(live: LiveSessions) -> None:
        attachment, _ = await live.open(WISH)
        session = attachment.session
        for start in range(0, len(MOTION), 100):
            await session.take(frames(start, start + 100))
            await session.saved()
        await session.end()
        found = [json.loads(stored.text) async for stored in session.events_after(-1)]
        assert found[:-1] == expected(trained, MOTION)
        assert record_of(lab, session.pinned.session_id).n_frames == len(MOTION)
        np.testing.assert_array_equal(
            recording_of(lab, session.pinned.session_id).tracks["hand"], MOTION.hand
        )

    monkeypatch.setattr("app.service.journal.AGAIN", 0.0)
    monkeypatch.setattr(SessionStore, "write", loses_every_other_answer)
    live_run(lab, work)


def test_who_was_taken_over_writes_no_more(lab: Lab, trained: Model) -> None:
    """A process that was paused and wakes, with frames of its own that nobody has seen."""

    async def work(paused: LiveSessions) -> None:
        attachment, token = await paused.open(WISH)
        session = attachment.session
        await session.take(frames(0, 300))
        await session.saved()
        await session.take(frames(300, 600))
        other = LiveSessions(SessionStore(lab), Limits(drain=0.0))
        hold = await other.resume(Ticket(session.pinned.session_id, token, -1, WISH))
        next_seq = hold.session.next_seq
        assert 300 <= next_seq < 600
        with pytest.raises(TakenOver):
            await session.saved()
        await hold.session.take(frames(next_seq, len(MOTION)))
        await hold.session.end()
        assert record_of(lab, session.pinned.session_id).n_frames == len(MOTION)
        found = [json.loads(stored.text) async for stored in hold.session.events_after(-1)]
        assert found[:-1] == expected(trained, MOTION)
        await other.drain()

    live_run(lab, work)


def test_of_one_that_has_ended_elsewhere_nothing_provisional_is_told(lab: Lab) -> None:
    async def work(live: LiveSessions) -> None:
        attachment, token = await live.open(WISH)
        await attachment.session.take(frames(0, 100))
        await attachment.session.end()
        other = LiveSessions(SessionStore(lab), Limits(drain=0.0))
        hold = await other.resume(Ticket(attachment.session.pinned.session_id, token, -1, WISH))
        assert hold.session.next_seq == 100
        for told in (hold.session.frames(20.0), hold.session.hypotheses(20.0)):
            first = asyncio.ensure_future(anext(told))
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            assert not first.done()
            first.cancel()
        await other.drain()

    live_run(lab, work)


def test_a_session_that_is_given_up_ends_with_an_event(lab: Lab) -> None:
    async def work(live: LiveSessions) -> None:
        attachment, token = await live.open(WISH)
        session_id = attachment.session.pinned.session_id
        await attachment.session.take(frames(0, 100))
        await attachment.session.saved()
        live.abandon(attachment.session)
        with pytest.raises(SessionGone):
            await live.resume(Ticket(session_id, token, -1, WISH))
        heard = [stored.type async for stored in live.events(session_id, -1)]
        assert heard == ["ended"]
        assert (await live.end(session_id)).state == "ended"

    live_run(lab, work)


def test_draining_keeps_what_was_taken_in(lab: Lab) -> None:
    ids: list[str] = []

    async def work(live: LiveSessions) -> None:
        attachment, _ = await live.open(WISH)
        ids.append(attachment.session.pinned.session_id)
        await attachment.session.take(frames(0, 300))
        live.leave(attachment)

    live_run(lab, work)
    record = record_of(lab, ids[0])
    assert (record.state, record.n_frames) == ("active", 300)


class TestTidying:
    def test_the_sessions_of_a_dead_process_expire(self, lab: Lab) -> None:
        ids: list[str] = []

        async def die(live: LiveSessions) -> None:
            attachment, _ = await live.open(WISH)
            ids.append(attachment.session.pinned.session_id)
            await attachment.session.take(frames(0, 400))
            await attachment.session.saved()
            live.leave(attachment)

        async def work(live: LiveSessions) -> None:
            now = record_of(lab, ids[0]).last_seen_at
            assert await tidy(live, RETENTION, now + timedelta(seconds=599)) == (0, 0)
            assert record_of(lab, ids[0]).state == "active"
            assert await tidy(live, RETENTION, now + timedelta(seconds=601)) == (1, 0)
            assert await tidy(live, RETENTION, now + timedelta(seconds=601)) == (0, 0)
            record = record_of(lab, ids[0])
            assert record.state == "expired"
            *_, last = [stored async for stored in live.events(ids[0], -1)]
            assert (last.type, last.event) == ("ended", record.n_events - 1)
            assert f'"segments":{record.n_segments},"frames":400' in last.text

        live_run(lab, die)
        live_run(lab, work)

    def test_what_they_had_open_is_decided(self, lab: Lab, trained: Model) -> None:
        ids: list[str] = []

        async def die(live: LiveSessions) -> None:
            attachment, _ = await live.open(WISH)
            ids.append(attachment.session.pinned.session_id)
            await attachment.session.take(frames(0, len(MOTION)))
            await attachment.session.saved()

        async def work(live: LiveSessions) -> None:
            now = record_of(lab, ids[0]).last_seen_at
            assert await tidy(live, RETENTION, now + timedelta(seconds=601)) == (1, 0)
            found = [json.loads(stored.text) async for stored in live.events(ids[0], -1)]
            assert found[:-1] == expected(trained, MOTION)

        live_run(lab, die)
        live_run(lab, work)

    def test_those_that_live_here_are_seen(self, lab: Lab) -> None:
        async def work(live: LiveSessions) -> None:
            attachment, _ = await live.open(WISH)
            session = attachment.session
            seen = record_of(lab, session.pinned.session_id).last_seen_at
            assert await tidy(live, RETENTION, seen + timedelta(days=30)) == (0, 0)
            moved = await session.moved.beyond(0)
            assert moved > 0
            record = record_of(lab, session.pinned.session_id)
            assert record.state == "active"
            assert record.last_seen_at > seen

        live_run(lab, work)

    def test_the_frames_of_finished_sessions_are_dropped(self, lab: Lab) -> None:
        async def work(live: LiveSessions) -> None:
            over, _ = await live.open(WISH)
            active, _ = await live.open(WISH)
            for attachment in (over, active):
                await attachment.session.take(frames(0, 100))
            await over.session.end()
            await active.session.saved()
            ended = record_of(lab, over.session.pinned.session_id)
            early, late = (ended.last_seen_at + RETENTION + timedelta(seconds=s) for s in (-1, 1))
            assert await tidy(live, RETENTION, early) == (0, 0)
            assert await tidy(live, RETENTION, late) == (0, 1)
            assert not record_of(lab, ended.id).frames_kept
            assert record_of(lab, active.session.pinned.session_id).frames_kept
            assert len(live.store.events(ended.id, -1)) == ended.n_events

        live_run(lab, work)

    def test_goes_on_where_the_database_fails_once(
        self, lab: Lab, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        looks: list[datetime] = []
        pauses: list[float] = []

        async def look(live: LiveSessions, retention: timedelta, now: datetime) -> tuple[int, int]:
            looks.append(now)
            if len(looks) == 1:
                raise OSError("no connection")
            return 2, 3

        async def pause(seconds: float) -> None:
            pauses.append(seconds)
            if len(pauses) == 2:
                raise asyncio.CancelledError

        async def work(live: LiveSessions) -> None:
            monkeypatch.setattr("app.service.session_retention.tidy", look)
            monkeypatch.setattr("app.service.session_retention.asyncio.sleep", pause)
            with pytest.raises(asyncio.CancelledError):
                await keep_tidy(live, RETENTION)
            monkeypatch.undo()

        with caplog.at_level("INFO", "app.service.session_retention"):
            live_run(lab, work)
        assert pauses == [PERIOD, PERIOD]
        assert datetime.now(UTC) - looks[1] < timedelta(minutes=1)
        messages = [record.getMessage() for record in caplog.records]
        assert messages == [
            "old sessions could not be tidied up",
            "2 sessions expired, the frames of 3 dropped",
        ]
