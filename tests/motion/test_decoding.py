"""The decoder against all divisions of tables written by hand and drawn, and by its laws."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.motion import decoding
from app.motion.criterion import PAUSE, START
from app.motion.decoding import (
    CONVERGE_EVERY,
    FINENESS,
    SETTLED,
    SURVIVING,
    UNKNOWN,
    Decoder,
    Limits,
    limits_of,
)
from app.motion.foresight import Outlook
from app.motion.model import Model
from app.motion.search import PACE, Found
from app.motion.trajectory import Flags, Floats, Indices

LAW = settings(derandomize=True, deadline=None, max_examples=100)

RATE = 25.0
"""A rate at which every point is a place [Hz]."""

seeds = st.integers(0, 2**32 - 1)


@dataclass
class Table:
    """Parts of a division that stand in a table, over and over where a stream is longer.

    segments: (n, n, n_classes) by first and goal point; resting: (n,); begun: (n, n) by first and newest
    point, what a movement under way counts; hand: (n,) whether it is seen.
    """

    segments: Floats
    resting: Floats
    begun: Floats
    hand: Flags
    typical: float = 1.0
    earliest: int = 10**9

    def _at(self, origin: int, through: int) -> tuple[int, int]:
        self.earliest = min(self.earliest, origin)
        n = len(self.resting)
        return origin % n, through % n

    def seen(self, point: int) -> bool:
        return bool(self.hand[point % len(self.hand)])

    def best(self, segments: Indices, before: Floats, least: Floats) -> Floats:
        known = [self.segments[self._at(*segment)].max() for segment in segments.tolist()]
        return np.maximum(known, least)

    def rest(self, start: int, stop: int) -> float:
        return float(sum(self.resting[at % len(self.resting)] for at in range(start, stop)))

    def outlook(self, origin: int, through: int) -> Outlook | None:
        if not (self.seen(origin) and self.seen(through)):
            return None
        value = self.begun[self._at(origin, through)]
        return Outlook(np.array([[value]]), np.zeros((1, 1, 3)), np.zeros((1, 1)))


def drawn(seed: int, n: int, n_unseen: int = 0) -> Table:
    """Return a table in which everything competes with everything."""
    rng = np.random.default_rng(seed)
    ages = np.arange(n) - np.arange(n)[:, None]
    segments = 0.8 * ages[:, :, None] + rng.normal(0.0, 6.0, (n, n, 2)) + START / 2.0
    segments[rng.random(segments.shape) < 0.3] = -np.inf
    begun, hand = 0.8 * ages + rng.normal(0.0, 8.0, (n, n)), np.ones(n, dtype=bool)
    hand[rng.permutation(n)[:n_unseen]] = False
    return Table(segments, rng.normal(0.6, 0.5, n), begun, hand)


undecided = partial(patch.object, decoding, "CONVERGE_EVERY", 10**9)
"""While this lasts nothing is decided before the end."""


def divisions(origin: int, last: int, limits: Limits) -> Iterator[list[tuple[int, int]]]:
    """Yield the segments of every division of the points from an origin to the last one."""
    yield []
    for start in range(origin, last):
        for end in range(start + limits.shortest, min(start + limits.longest, last) + 1):
            for others in divisions(end, last, limits):
                yield [(start, end), *others]


def worth(table: Table, segments: Sequence[tuple[int, int]], last: int) -> float:
    """Return what a division counts; a rest after a segment has its price."""
    value, free_from, price = 0.0, 0, 0.0
    for start, end in segments:
        known = max(float(table.segments[start, end].max()), UNKNOWN * table.typical * (end - start))
        value += table.rest(free_from, start) - price * (start > free_from) + known - START
        free_from, price = end, PAUSE
    return value + table.rest(free_from, last) - price * (last > free_from)


def best_of_all(
    table: Table, last: int, limits: Limits, resting: bool = False
) -> tuple[float, list[tuple[int, int]]]:
    """Return the value and the segments of the best division, or of the best that ends in rest."""
    all_there_are = (
        segments
        for segments in divisions(0, last, limits)
        if all(table.seen(end) for _, end in segments)
        and not (resting and segments and segments[-1][1] == last)
    )
    return max((worth(table, segments, last), segments) for segments in all_there_are)


def run(decoder: Decoder, n_points: int, work: int = 10**6) -> list[tuple[int, tuple[int, int]]]:
    """Return where what is found starts and ends, with the last point there was."""
    found = [(at, (each.start, each.end)) for at in range(n_points) for each in decoder.frame(work)]
    return found + [(n_points - 1, (each.start, each.end)) for each in decoder.finish()]


def ends_of(found: Sequence[tuple[int, tuple[int, int]]]) -> list[tuple[int, int]]:
    return [each for _, each in found]


narrow = st.builds(
    lambda rate, shortest, more, bound: Limits(rate, shortest, shortest + more, min(bound, shortest + more)),
    st.sampled_from([25.0, 30.0, 50.0, 55.0, 100.0]),
    st.integers(2, 6),
    st.integers(0, 20),
    st.integers(0, 30),
)


@LAW
@given(seeds, st.integers(1, 9), st.integers(1, 3), st.integers(0, 8), st.integers(0, 4))
def test_what_is_left_in_the_end_is_the_best_of_all_divisions(
    seed: int, n: int, shortest: int, more: int, n_unseen: int
) -> None:
    table, limits = drawn(seed, n, n_unseen), Limits(RATE, shortest, shortest + more, bound=10**3)
    with undecided():
        found = ends_of(run(Decoder(table, limits), n))
    assert found == best_of_all(table, n - 1, limits)[1]


@LAW
@given(seeds, st.integers(1, 9))
def test_alternatives_go_on_from_the_best_division_before_them(seed: int, n: int) -> None:
    table, limits = drawn(seed, n), Limits(RATE, 2, 9, bound=10**3)
    decoder = Decoder(table, limits)
    with undecided():
        assert [decoder.frame() for _ in range(n)] == [[]] * n
    found = decoder.alternatives(n - 1)
    assert [each.value for each in found] == sorted((each.value for each in found), reverse=True)
    for each in found:
        before, _ = best_of_all(table, each.point, limits, resting=each.outlook is None)
        if each.outlook is None:
            assert each.base == pytest.approx(before)
            assert each.value == pytest.approx(before + table.rest(each.point, n - 1))
        else:
            assert each.base == pytest.approx(before - START)
            assert each.value == pytest.approx(each.base + table.begun[each.point, n - 1])


def test_classes_and_phases_of_a_movement_under_way_add_up() -> None:
    table = drawn(1, 9)
    decoder = Decoder(table, Limits(RATE, 2, 9, bound=10**3))
    for _ in range(9):
        decoder.frame()
    several = Outlook(np.log([[1.0, 2.0], [3.0, 4.0]]), np.zeros((2, 2, 3)), np.zeros((2, 2)))
    table.outlook = lambda origin, through: several  # type: ignore[method-assign]
    begun = [each for each in decoder.alternatives(8) if each.outlook is not None]
    assert begun
    assert [each.value - each.base for each in begun] == pytest.approx([np.log(10.0)] * len(begun))


def test_nothing_is_known_of_a_hand_that_is_not_seen() -> None:
    table = drawn(1, 9, n_unseen=9)
    decoder = Decoder(table, Limits(RATE, 2, 9, bound=10**3))
    for _ in range(9):
        decoder.frame()
        assert decoder.alternatives(8) == []


@LAW
@given(seeds, narrow, st.integers(0, 30), st.integers(1, 60))
def test_how_much_it_may_work_decides_when_and_not_what(
    seed: int, limits: Limits, n_unseen: int, work: int
) -> None:
    table = drawn(seed, 80, n_unseen)
    hasty, slow = (run(Decoder(table, limits), 80, least) for least in (10**6, work))
    assert ends_of(slow) == ends_of(hasty)
    assert all(late >= at for (late, _), (at, _) in zip(slow, hasty, strict=True))


@LAW
@given(seeds, narrow, st.integers(1, 60))
def test_works_a_bounded_amount_for_each_frame(seed: int, limits: Limits, work: int) -> None:
    table, looked_at = drawn(seed, 60), list[int]()
    decoder, best = Decoder(table, limits), table.best

    def noted(segments: Indices, before: Floats, least: Floats) -> Floats:
        looked_at.append(int((segments[:, 1] - segments[:, 0]).sum()))
        return best(segments, before, least)

    table.best = noted  # type: ignore[method-assign]
    for _ in range(60):
        looked_at.clear()
        decoder.frame(work)
        assert sum(looked_at) <= work + limits.longest + limits.spacing


@LAW
@given(seeds, narrow, st.integers(1, 60))
def test_one_frame_of_work_without_end_catches_up(seed: int, limits: Limits, work: int) -> None:
    table = drawn(seed, 60)
    patient, hasty = Decoder(table, limits), Decoder(table, limits)
    slowly = [each for _ in range(59) for each in patient.frame(work)] + patient.frame(None)
    assert slowly == [each for _ in range(60) for each in hasty.frame(None)]
    assert patient.origin == hasty.origin
    assert patient.finish() == hasty.finish()


@LAW
@given(seeds, narrow, st.integers(0, 40), st.sampled_from([0, 7]))
def test_segments_are_in_order_within_limits_and_decided_in_time(
    seed: int, limits: Limits, n_unseen: int, origin: int
) -> None:
    table, free_from = drawn(seed, 60, n_unseen), origin
    found = run(Decoder(table, limits, origin), 300)
    slack = (CONVERGE_EVERY + 1) * limits.spacing
    for at, (start, end) in found:
        assert free_from <= start
        assert limits.shortest <= end - start <= limits.longest
        assert end <= origin + at <= end + limits.longest + slack or at == 299
        free_from = end


@LAW
@given(seeds, narrow, st.integers(0, 40))
def test_nothing_before_the_origin_is_needed(seed: int, limits: Limits, n_unseen: int) -> None:
    table = drawn(seed, 60, n_unseen)
    decoder = Decoder(table, limits)
    for _ in range(400):
        origin, table.earliest = decoder.origin, 10**9
        found = decoder.frame()
        assert min([table.earliest, *(each.start for each in found)]) >= origin
        assert decoder.origin >= origin


def plain(n: int, begun: float = -1e3) -> Table:
    """Return a table of rest, 0.8 a point; a movement under way counts ``begun``."""
    segments = np.full((n, n, 1), -np.inf)
    return Table(segments, np.full(n, 0.8), np.full((n, n), begun), np.ones(n, dtype=bool))


def with_segment(table: Table, start: int, end: int, gain: float = 20.0) -> Table:
    """Return the table with a segment that is better than rest by its gain."""
    table.segments[start, end] = 0.8 * (end - start) + START + gain
    return table


def even(point: int) -> int:
    """Return the first point, not before this one, at which the decoder tries to decide."""
    return -(-point // CONVERGE_EVERY) * CONVERGE_EVERY


@pytest.mark.parametrize("end", [14, 15])
def test_a_segment_that_all_have_is_decided_once_its_end_is_settled(end: int) -> None:
    table = with_segment(plain(80), 4, end)
    assert run(Decoder(table, Limits(RATE, 2, 30, 30)), 80) == [(even(end + round(SETTLED * RATE)), (4, end))]


@pytest.mark.parametrize(("behind", "decided"), [(SURVIVING - 1.0, even(14 + 30)), (SURVIVING + 1.0, 20)])
def test_what_not_all_that_survive_have_is_decided_at_the_bound(behind: float, decided: int) -> None:
    """A movement under way since before the segment is behind rest after the segment by so much."""
    table = replace(with_segment(plain(80), 4, 14), typical=10.0)
    for origin in range(5):
        table.begun[origin] = 0.8 * (np.arange(80) - origin) + 20.0 + START - PAUSE - behind
    assert run(Decoder(table, Limits(RATE, 2, 60, bound=30)), 80) == [(decided, (4, 14))]


@pytest.mark.parametrize(("start", "end", "decided"), [(6, 20, 30), (13, 19, 54)])
def test_ends_that_are_near_each_other_agree(start: int, end: int, decided: int) -> None:
    """Another division, which has this segment and a movement under way behind it, is nearly as good."""
    table = with_segment(with_segment(plain(80), 4, 24), start, end, gain=19.0)
    table.begun[end] = 0.8 * (np.arange(80) - end) + START - PAUSE
    assert run(Decoder(table, Limits(RATE, 2, 60, bound=30)), 80) == [(decided, (4, 24))]


@pytest.mark.parametrize("bound", [3, 10, 40])
def test_a_start_is_still_there_when_a_division_comes_to_lead_late(bound: int) -> None:
    """Until 371 a movement since 325..330 leads, which has no end; then one since the end of a segment."""
    table, points = with_segment(plain(450), 296, 335, gain=1.0), np.arange(450)
    table.begun[325:331] = np.where(points < 372, 80.0, -1e3)
    table.begun[335] = np.where(points < 372, -1e3, 80.0)
    decoder, found = Decoder(table, Limits(RATE, 2, 40, bound)), list[Found]()
    for _ in range(450):
        origin = decoder.origin
        now = decoder.frame()
        assert all(each.start >= origin for each in now)
        found += now
    assert [(each.start, each.end) for each in found + decoder.finish()] == [(296, 335)]


def test_what_it_remembers_does_not_grow_and_what_it_finds_stays_the_same() -> None:
    """A stream that repeats itself every 80 points, over twenty times what is remembered."""
    table, limits = with_segment(with_segment(plain(80), 4, 14), 30, 52), Limits(RATE, 2, 30, 30)
    decoder, sizes = Decoder(table, limits), set[int]()
    found = list[Found]()
    for at in range(8000):
        found += decoder.frame()
        sizes.add(
            sum(part.nbytes for part in vars(decoder).values() if isinstance(part, np.ndarray)) // 2**10
        )
        assert at + 1 - decoder.origin <= limits.horizon + 2 * limits.spacing
    assert len(sizes) <= 2
    once = [(4, 14), (30, 52)]
    every = [(80 * lap + start, 80 * lap + end) for lap in range(100) for start, end in once]
    assert [(each.start, each.end) for each in found + decoder.finish()] == every


@LAW
@given(seeds, narrow, st.integers(1, 500))
def test_an_origin_of_its_own_only_shifts_what_is_found(seed: int, limits: Limits, origin: int) -> None:
    table, lap = drawn(seed, 40), 2 * limits.spacing * 40
    here = ends_of(run(Decoder(table, limits), 200))
    there = ends_of(run(Decoder(table, limits, origin * lap), 200))
    assert there == [(start + origin * lap, end + origin * lap) for start, end in here]


def test_limits_come_from_the_demonstrations(trained: Model) -> None:
    found, rate = limits_of(trained), trained.features.rate
    durations = np.concatenate([action.durations for action in trained.actions])
    assert found.shortest / rate == pytest.approx(durations.min() / PACE, abs=1 / rate)
    assert found.longest / rate == pytest.approx(durations.max() * PACE, abs=1 / rate)
    assert found.bound == found.longest
    assert limits_of(trained, 0.5).bound / rate == pytest.approx(0.5, abs=1 / rate)
    assert limits_of(trained, 1e6) == found
    twice = replace(trained, features=replace(trained.features, rate=2 * rate))
    for name in ("shortest", "longest", "bound", "spacing"):
        assert getattr(limits_of(twice), name) == pytest.approx(2 * getattr(found, name), abs=2)


@pytest.mark.parametrize("longest", [20, 200, 1200])
def test_where_a_segment_began_is_looked_for_to_a_share_of_its_length(longest: int) -> None:
    table, limits = plain(2), Limits(50.0, 9, longest, longest)
    decoder, looked_at = Decoder(table, limits), dict[int, list[int]]()
    for _ in range(2 * longest):
        decoder.frame(None)

    def noted(segments: Indices, before: Floats, least: Floats) -> Floats:
        for start, end in segments.tolist():
            looked_at.setdefault(end, []).append(end - start)
        assert len(before) == len(segments)
        return least

    table.best = noted  # type: ignore[method-assign]
    for _ in range(10 * limits.spacing):
        decoder.frame(None)
    assert len(looked_at) == 10
    for lengths in looked_at.values():
        for wanted in range(limits.shortest, longest + 1):
            off = min(abs(wanted - length) for length in lengths)
            assert off <= max(limits.spacing, wanted / FINENESS)
