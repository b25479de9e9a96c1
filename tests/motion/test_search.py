"""The search against a slow and obvious account of Steps 1-3, on tables written by hand and drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.motion.model import Model
from app.motion.search import PACE, Bounds, Found, Search, bounds_of
from app.motion.trajectory import Floats, Indices

LAW = settings(derandomize=True, deadline=None, max_examples=200)

BOUNDS = Bounds(shortest=2, longest=12, patience=6, neighbourhood=3, spacing=1, stride=2)


@st.composite
def tables(draw: st.DrawFn) -> Floats:
    """Draw (n_frames, n_frames, 2) ratios of segments; few values, so that many are equal."""
    n_frames = draw(st.integers(1, 24))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    values = np.array([-np.inf, -3.0, -1.0, 0.0, 1.0, 2.0, 4.0])
    result: Floats = rng.choice(values, (n_frames, n_frames, 2))
    return result


@st.composite
def bounds(draw: st.DrawFn) -> Bounds:
    shortest, patience = draw(st.integers(1, 4)), draw(st.integers(1, 8))
    return Bounds(
        shortest=shortest,
        longest=draw(st.integers(shortest, 14)),
        patience=patience,
        neighbourhood=draw(st.integers(0, patience)),
        spacing=draw(st.integers(1, 3)),
        stride=draw(st.integers(1, 4)),
    )


def of_table(table: Floats) -> Callable[[Indices], Floats]:
    def ratios(segments: Indices) -> Floats:
        result: Floats = table[segments[:, 0], segments[:, 1]]
        return result

    return ratios


def search(table: Floats, within: Bounds, look_ahead: bool = True, work: int = 10**6) -> list[Found]:
    steps = Search(of_table(table), within, look_ahead)
    found = [each for _ in range(len(table)) for each in steps.frame(work)]
    return found + steps.finish()


def step_1(table: Floats, origin: int, within: Bounds) -> tuple[list[int], int, float]:
    """Return the ends looked at from an origin, the best of them, and what it is worth."""
    looked: list[int] = []
    best_end, best = origin + within.shortest, -np.inf
    for end in range(origin + within.shortest, min(origin + within.longest + 1, len(table))):
        looked.append(end)
        if table[origin, end].max() > best:
            best_end, best = end, float(table[origin, end].max())
        if end - best_end >= within.patience:
            break
    return looked, best_end, max(best, 0.0)


def by_the_paper(table: Floats, within: Bounds, look_ahead: bool) -> list[tuple[int, int]]:
    origin, found = 0, []
    while origin + within.shortest < len(table):
        looked, best_end, gain = step_1(table, origin, within)
        if gain == 0.0:
            origin += within.stride
            continue
        ends = [best_end]
        if look_ahead:
            near = [end for end in looked if abs(end - best_end) <= within.neighbourhood]
            ends = [end for end in near if (end - best_end) % within.spacing == 0]
        joint = [table[origin, end].max() + step_1(table, end, within)[2] for end in ends]
        end = ends[int(np.argmax(joint))] if look_ahead else best_end
        found.append((origin, end))
        origin = end
    return found


def ends_of(found: list[Found]) -> list[tuple[int, int]]:
    return [(each.start, each.end) for each in found]


@LAW
@given(tables(), bounds(), st.booleans(), st.integers(1, 60))
def test_finds_what_the_paper_says_however_little_it_may_work(
    table: Floats, within: Bounds, look_ahead: bool, work: int
) -> None:
    assert ends_of(search(table, within, look_ahead, work)) == by_the_paper(table, within, look_ahead)


@LAW
@given(tables(), bounds(), st.integers(1, 60))
def test_works_a_bounded_amount_for_each_frame(table: Floats, within: Bounds, work: int) -> None:
    looked_at: list[int] = []

    def ratios(segments: Indices) -> Floats:
        looked_at.append(int((segments[:, 1] - segments[:, 0]).sum()))
        return of_table(table)(segments)

    steps = Search(ratios, within)
    for _ in range(len(table)):
        looked_at.clear()
        steps.frame(work)
        assert sum(looked_at) <= work + within.longest


@LAW
@given(tables(), bounds())
def test_segments_follow_each_other_within_bounds(table: Floats, within: Bounds) -> None:
    free_from = 0
    for start, end in ends_of(search(table, within)):
        assert free_from <= start
        assert within.shortest <= end - start <= within.longest
        free_from = end


@LAW
@given(tables(), bounds())
def test_one_frame_of_work_without_end_catches_up(table: Floats, within: Bounds) -> None:
    patient, hasty = (Search(of_table(table), within) for _ in range(2))
    slowly = [each for _ in range(len(table) - 1) for each in patient.frame(1)] + patient.frame(None)
    at_once = [each for _ in range(len(table)) for each in hasty.frame(10**6)]
    assert ends_of(slowly) == ends_of(at_once)
    assert patient.origin == hasty.origin


def overreaching() -> Floats:
    """Return the paper's Fig. 7: alone, the first action is best two frames into its successor."""
    table = np.full((20, 20, 2), -5.0)
    table[0, 6, 0], table[0, 8, 0] = 10.0, 11.0
    table[6, 14, 1], table[8, 14, 1] = 9.0, 2.0
    return table


def test_looking_ahead_draws_back_from_the_successor() -> None:
    assert ends_of(search(overreaching(), BOUNDS)) == [(0, 6), (6, 14)]


def test_greed_stretches_into_the_successor() -> None:
    assert ends_of(search(overreaching(), BOUNDS, look_ahead=False)) == [(0, 8), (8, 14)]


def test_a_boundary_out_of_the_neighbourhood_is_not_tried() -> None:
    narrow = replace(BOUNDS, neighbourhood=1)
    assert ends_of(search(overreaching(), narrow)) == [(0, 8), (8, 14)]


def test_nothing_is_found_where_nothing_beats_the_background() -> None:
    assert search(np.full((40, 40, 2), -1.0), BOUNDS) == []
    assert search(np.zeros((40, 40, 2)), BOUNDS) == []
    assert search(np.full((40, 40, 2), -np.inf), BOUNDS) == []


def test_a_segment_is_decided_as_soon_as_its_successor_is_complete() -> None:
    table = np.pad(overreaching(), ((0, 4), (0, 4), (0, 0)), constant_values=-5.0)
    steps = Search(of_table(table), BOUNDS)
    when = [at for at in range(len(table)) if steps.frame()]
    # The last to be complete is the one that begins at 8: its best end, 14, is waited out.
    assert when == [14 + BOUNDS.patience]


@pytest.mark.parametrize("origin", [0, 7])
def test_an_origin_of_its_own_only_shifts_what_is_found(origin: int) -> None:
    table = np.pad(overreaching(), ((origin, 0), (origin, 0), (0, 0)), constant_values=-5.0)
    steps = Search(of_table(table), BOUNDS, origin=origin)
    found = [each for _ in range(20) for each in steps.frame()] + steps.finish()
    assert ends_of(found) == [(origin, origin + 6), (origin + 6, origin + 14)]


def test_bounds_come_from_the_demonstrations(trained: Model) -> None:
    found, rate = bounds_of(trained), trained.features.rate
    durations = np.concatenate([action.durations for action in trained.actions])
    assert found.shortest / rate == pytest.approx(durations.min() / PACE, abs=1 / rate)
    assert found.longest / rate == pytest.approx(durations.max() * PACE, abs=1 / rate)
    assert found.patience / rate == pytest.approx(durations.max(), abs=1 / rate)
    twice = replace(trained, features=replace(trained.features, rate=2 * rate))
    for name, value in vars(bounds_of(twice)).items():
        assert value == pytest.approx(2 * getattr(found, name), abs=2)
