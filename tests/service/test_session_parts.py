"""What a session is made of: frames, geometry, marks, the journal."""

from __future__ import annotations

import asyncio
import json
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from app.motion.errors import InvalidState
from app.motion.hypothesis import Expected, Hypothesis
from app.motion.state import State
from app.registry.errors import DatabaseUnavailable
from app.registry.records import Checkpoint, StoredEvent
from app.service import messages
from app.service.checkpoints import Snapshot, state_of
from app.service.frames import Layout, from_binary, from_columns, settle
from app.service.geometry import UNITS_PER_METRE, Geometry, LengthUnit, UpAxis
from app.service.journal import Entry, Journal
from app.service.mark import Mark
from app.service.session_errors import FramesRefused, SessionError, SessionGone, WriteFailed

LAYOUT = Layout(("cup", "object"), Geometry())
coordinates = st.integers(-90_000_000, 90_000_000).map(lambda micrometres: micrometres / 1e6)


@st.composite
def positions(draw: st.DrawFn, n_frames: int) -> np.ndarray[Any, Any]:
    """Positions of hand, cup and object, (n_frames, 3, 3), some of them dropouts."""
    found: np.ndarray[Any, Any] = draw(arrays(float, (n_frames, 3, 3), elements=coordinates))
    found[draw(arrays(bool, (n_frames, 3)))] = np.nan
    return found


class TestFrames:
    @given(found=st.integers(1, 5).flatmap(positions), first_seq=st.integers(0, 2**50))
    def test_json_and_binary_say_the_same(self, found: np.ndarray[Any, Any], first_seq: int) -> None:
        times = np.arange(len(found)) * 0.01
        tracks = [
            [None if np.isnan(position[0]) else position.tolist() for position in found[:, index]]
            for index in range(3)
        ]
        objects = {"object": tracks[2], "cup": tracks[1]}
        written = from_columns(LAYOUT, first_seq, times.tolist(), tracks[0], objects)
        binary = Layout(LAYOUT.objects, LAYOUT.geometry, encoding="f64")
        rows = np.column_stack([times, found.reshape(len(found), -1)])
        packed = from_binary(
            binary, struct.pack("<QII", first_seq, *rows.shape) + rows.astype("<f8").tobytes()
        )
        settled = settle(LAYOUT, written, 0, -1.0)
        np.testing.assert_array_equal(settled, rows)
        np.testing.assert_array_equal(settled, settle(binary, packed, 0, -1.0))

    def test_a_rate_gives_the_times_whatever_was_sent_before(self) -> None:
        layout = Layout((), Geometry(), rate_hz=30.0)
        frames = from_columns(layout, 7, None, [[0, 0, 0]] * 4, {})
        whole, rest = settle(layout, frames, 0, 0.0), settle(layout, frames, 2, 0.0)
        np.testing.assert_array_equal(whole[:, 0], np.arange(7, 11) / 30.0)
        np.testing.assert_array_equal(rest, whole[2:])

    @pytest.mark.parametrize(("rate_hz", "code"), [(1e-320, "non_finite"), (1e-12, "wrong_unit")])
    def test_a_rate_that_makes_no_times_is_refused(self, rate_hz: float, code: str) -> None:
        layout = Layout((), Geometry(), rate_hz=rate_hz)
        with pytest.raises(FramesRefused, match="t, frame") as refused:
            settle(layout, from_columns(layout, 0, None, [[0, 0, 0]] * 4, {}), 0, -1.0)
        assert refused.value.code == code

    def test_only_what_is_new_is_looked_at_and_named_by_its_number(self) -> None:
        frames = from_columns(LAYOUT, 10, [1.0, 2.0, 3.0], [[0, 0, 0], [1, 1, 1], [900, 0, 0]], self.things())
        with pytest.raises(FramesRefused, match=r"hand, frame 2: .*unit") as refused:
            settle(LAYOUT, frames, 1, 1.5)
        assert (refused.value.code, refused.value.at_seq) == ("wrong_unit", 12)
        with pytest.raises(FramesRefused, match="t, frame 1") as refused:
            settle(LAYOUT, frames, 1, 2.5)
        assert (refused.value.code, refused.value.at_seq) == ("times_not_increasing", 11)

    def things(self) -> dict[str, list[list[float]]]:
        return {name: [[0.0, 0.0, 0.0]] * 3 for name in LAYOUT.objects}


class TestGeometry:
    @given(arrays(float, (4, 3), elements=coordinates), st.sampled_from(sorted(UNITS_PER_METRE)))
    def test_a_turn_keeps_lengths_and_hands(self, track: np.ndarray[Any, Any], unit: LengthUnit) -> None:
        turned = {axis: Geometry(unit, axis).to_metres(track) for axis in axes()}
        lengths = [np.linalg.norm(each, axis=1) * UNITS_PER_METRE[unit] for each in turned.values()]
        np.testing.assert_allclose(lengths[0], np.linalg.norm(track, axis=1))
        np.testing.assert_allclose(lengths[0], lengths[1])

    def test_up_is_up(self) -> None:
        x, y, z = np.eye(3)
        turned = Geometry("m", "y").to_metres(np.stack([x, y, z]))
        np.testing.assert_array_equal(turned, [x, z, -y])
        np.testing.assert_array_equal(np.cross(turned[0], turned[1]), turned[2])
        assert not np.signbit(Geometry("m", "y").to_metres(np.zeros((1, 3)))).any()


def axes() -> tuple[UpAxis, UpAxis]:
    return "y", "z"


class TestMark:
    def test_wakes_who_waits_for_less(self) -> None:
        async def run() -> list[int]:
            mark = Mark(0)
            waiting = [asyncio.create_task(mark.beyond(value)) for value in (0, 1, 5)]
            await asyncio.sleep(0)
            mark.advance(2)
            mark.advance(1)
            await asyncio.sleep(0)
            assert [task.done() for task in waiting] == [True, True, False]
            mark.advance(6)
            return await asyncio.gather(*waiting)

        assert asyncio.run(run()) == [2, 2, 6]

    def test_an_error_ends_the_wait_of_all_but_not_what_has_been(self) -> None:
        async def run() -> None:
            mark = Mark(3)
            waiting = asyncio.create_task(mark.beyond(3))
            await asyncio.sleep(0)
            mark.fail(SessionGone("s"))
            with pytest.raises(SessionGone):
                await waiting
            with pytest.raises(SessionGone):
                await mark.beyond(3)
            assert await mark.beyond(2) == 3

        asyncio.run(run())


class TestHypothesis:
    def test_is_told_with_the_likely_goals_first(self) -> None:
        actions = Expected("grasp", 1.0, 0.25), Expected("rest", 0.0, None)
        found = Hypothesis(3, 9, actions, {"cup": 0.25, "shelf": 0.75})
        assert json.loads(messages.hypothesis(found)) == {
            "type": "hypothesis",
            "start_seq": 3,
            "through_seq": 9,
            "actions": [
                {"action": "grasp", "posterior": 1.0, "progress": 0.25},
                {"action": "rest", "posterior": 0.0, "progress": None},
            ],
            "goals": [{"name": "shelf", "posterior": 0.75}, {"name": "cup", "posterior": 0.25}],
        }

    def test_has_no_goals_without_candidates(self) -> None:
        assert "goals" not in json.loads(messages.hypothesis(Hypothesis(0, 9, (), {})))


class Source:
    """A session, as the journal sees it; it has something to add whenever it is asked."""

    def __init__(self, session_id: str) -> None:
        self.session_id = session_id
        self.collected = 0
        self.durable: list[int] = []
        self.error: SessionError | None = None
        self.over = asyncio.Event()

    def collect(self) -> Entry:
        self.collected += 1
        return Entry(self.session_id, 0, 0, (), (StoredEvent(self.collected, "gap", "{}"),))

    def written(self, entry: Entry) -> None:
        self.durable += [stored.event for stored in entry.events]
        self.over.set()

    def failed(self, error: SessionError) -> None:
        self.error = error
        self.over.set()


def written(write: Callable[[Sequence[Entry]], None], *names: str) -> list[Source]:
    """Let a journal write urgent news of sources; return them once it knows what became of it."""

    async def run() -> list[Source]:
        journal, sources = Journal(write), [Source(name) for name in names]
        for source in sources:
            journal.note(source, urgent=True)
        await asyncio.gather(*(source.over.wait() for source in sources))
        await journal.close()
        return sources

    return asyncio.run(run())


class TestJournal:
    def test_many_sessions_share_a_transaction(self) -> None:
        written: list[list[str]] = []

        async def run() -> None:
            journal = Journal(lambda entries: written.append([entry.session_id for entry in entries]))
            sources = [Source(name) for name in "abc"]
            for source in sources:
                journal.note(source, urgent=False)
            await asyncio.gather(*(source.over.wait() for source in sources))
            await journal.close()
            assert [source.durable for source in sources] == [[1], [1], [1]]

        asyncio.run(run())
        assert written == [["a", "b", "c"]]

    def test_a_decision_waits_for_nobody_and_takes_nobody_along(self) -> None:
        written: list[list[str]] = []

        async def run() -> None:
            journal = Journal(lambda entries: written.append([entry.session_id for entry in entries]))
            frames, decision = Source("frames"), Source("decision")
            for source in (frames, decision):
                journal.note(source, urgent=False)
            journal.note(decision, urgent=True)
            journal.note(decision, urgent=False)
            await decision.over.wait()
            assert written == [["decision"]]
            await frames.over.wait()
            await journal.close()

        asyncio.run(run())
        assert written == [["decision"], ["frames"]]

    def test_a_session_that_cannot_be_written_harms_no_other(self) -> None:
        def write(entries: Sequence[Entry]) -> None:
            for entry in entries:
                if entry.session_id == "gone":
                    raise SessionGone("gone")
                if entry.session_id == "bad":
                    raise ValueError("bad")

        good, gone, bad = written(write, "good", "gone", "bad")
        assert good.durable == [1]
        assert isinstance(gone.error, SessionGone)
        assert isinstance(bad.error, WriteFailed)

    def test_a_database_that_is_away_is_waited_for(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("app.service.journal.AGAIN", 0.0)
        tries: list[int] = []

        def write(entries: Sequence[Entry]) -> None:
            tries.append(len(entries))
            if len(tries) < 4:
                raise DatabaseUnavailable("gone")

        [source] = written(write, "patient")
        assert (tries, source.durable, source.error) == ([1, 1, 1, 1], [1], None)

    def test_but_not_for_ever_and_for_all_together(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("app.service.journal.AGAIN", 0.0)
        monkeypatch.setattr("app.service.journal.PATIENCE", 0.01)
        tries: list[int] = []

        def write(entries: Sequence[Entry]) -> None:
            tries.append(len(entries))
            raise DatabaseUnavailable("gone")

        for source in written(write, "one", "other"):
            assert source.durable == []
            assert isinstance(source.error, WriteFailed)
        assert set(tries) == {2}

    def test_what_waits_is_written_before_it_closes(self) -> None:
        async def run() -> Source:
            journal = Journal(lambda _: None)
            source = Source("late")
            journal.note(source, urgent=False)
            await journal.close()
            return source

        assert asyncio.run(run()).durable == [1]


STATE: State = {"n": np.array(3), "open": np.array(True), "none": np.empty((0, 3)), "values": np.eye(2)}


class TestCheckpoints:
    def test_a_state_reads_back_bit_for_bit(self) -> None:
        packed = Snapshot(700, 4, 2, STATE).packed()
        assert (packed.n_frames, packed.n_events, packed.n_segments) == (700, 4, 2)
        found = state_of(packed)
        assert list(found) == list(STATE)
        for name, array in STATE.items():
            assert (found[name].dtype, found[name].shape) == (array.dtype, array.shape)
            np.testing.assert_array_equal(found[name], array)
            assert found[name].flags.writeable

    @pytest.mark.parametrize(
        "state",
        [
            b"",
            b"junk",
            b"[]x\n",
            b"3\n",
            b'[["a", "|O", [1]]]\n01234567',
            b'[["a", "<f8", [9]]]\n0123',
            b"[1]\n",
        ],
    )
    def test_bytes_that_are_none_are_refused(self, state: bytes) -> None:
        with pytest.raises(InvalidState):
            state_of(Checkpoint(0, 0, 0, state))

    def test_cut_off_ones_are_too(self) -> None:
        whole = Snapshot(700, 4, 2, STATE).packed().state
        for length in range(len(whole) - 1):
            with pytest.raises(InvalidState):
                state_of(Checkpoint(0, 0, 0, whole[:length]))
