"""The measures, on hand-made tables, by their laws, and against enumeration."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, permutations
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.motion.errors import InvalidSegment
from app.motion.evaluation import Evaluation, evaluate
from app.motion.trajectory import Floats, Segment

N_FRAMES = 400
TIMES = np.arange(N_FRAMES) / 100.0
CLASSES = ("grasp", "push", "retract")

TRUTH = (Segment(20, 100, "grasp"), Segment(110, 200, "push"), Segment(200, 300, "retract"))

Labelled = tuple[Floats, Sequence[Segment], Sequence[Segment]]


def judged(*found: Segment, truth: Sequence[Segment] = TRUTH) -> Evaluation:
    return evaluate([(TIMES, truth, found)])


@st.composite
def sequences(draw: st.DrawFn) -> tuple[Segment, ...]:
    """Draw segments in order, some of them touching, some of them without an action."""
    bounds = sorted(draw(st.sets(st.integers(0, N_FRAMES), min_size=2, max_size=9)))
    actions = st.sampled_from([*CLASSES, None])
    return tuple(Segment(a, b, draw(actions)) for a, b in pairwise(bounds) if draw(st.integers(0, 3)) > 0)


@st.composite
def recordings(draw: st.DrawFn) -> Labelled:
    return TIMES, draw(sequences()), draw(sequences())


def named(segments: Sequence[Segment]) -> list[Segment]:
    return [segment for segment in segments if segment.action is not None]


def goal(segment: Segment) -> int:
    return min(segment.end, N_FRAMES - 1)


def iou(a: Segment, b: Segment) -> float:
    union = max(goal(a), goal(b)) - min(a.start, b.start)
    return max(min(goal(a), goal(b)) - max(a.start, b.start), 0) / union if union else 0.0


def most_pairs(allowed: NDArray[np.bool_]) -> int:
    """Return the size of the largest one-to-one matching of rows and columns, by trying all of them."""
    wide = allowed if len(allowed) <= allowed.shape[1] else allowed.T
    rows = np.arange(len(wide))
    return max(int(wide[rows, list(order)].sum()) for order in permutations(range(wide.shape[1]), len(wide)))


def test_perfect_is_one() -> None:
    result = judged(*TRUTH)
    assert (result.delineated, result.classified_of_delineated) == (1.0, 1.0)
    assert (result.f1_50, result.f1_75, result.frame_accuracy) == (1.0, 1.0, 1.0)
    assert (result.action_in_rest, result.median_boundary_error_ms, result.n_extra) == (0.0, 0.0, 0)
    assert all(measures.f1_75 == 1.0 for measures in result.per_class.values())


def test_nothing_found() -> None:
    result = judged()
    assert (result.n_true, result.n_found, result.n_extra) == (3, 0, 0)
    assert (result.delineated, result.f1_50, result.frame_accuracy, result.action_in_rest) == (0.0,) * 4
    assert (result.classified_of_delineated, result.median_boundary_error_ms) == (None, None)


def test_nothing_true() -> None:
    result = judged(Segment(0, 100, "grasp"), truth=())
    assert (result.n_extra, result.f1_50, result.action_in_rest) == (1, 0.0, 0.25)
    assert (result.delineated, result.frame_accuracy) == (None, None)


def test_nothing_at_all() -> None:
    result = evaluate([])
    assert (result.n_true, result.n_found, result.per_class) == (0, 0, {})
    assert (result.f1_50, result.action_in_rest, result.median_boundary_error_ms) == (None, None, None)


@pytest.mark.parametrize(
    ("start", "end", "delineated"),
    [
        (110, 200, True),
        (125, 200, True),
        (126, 200, False),
        (100, 200, True),
        (95, 200, True),
        (94, 200, False),
        (110, 185, True),
        (110, 184, False),
        (110, 215, True),
        (110, 216, False),
    ],
)
def test_delineated_within_tolerance_or_in_the_rest_beside(start: int, end: int, delineated: bool) -> None:
    result = judged(Segment(start, end, "push"))
    assert result.delineated == (1 / 3 if delineated else 0.0)


@pytest.mark.parametrize(("start", "end"), [(0, 100), (20, 115), (0, 110), (35, 85)])
def test_rest_before_the_first_action_and_between_belongs_to_nobody(start: int, end: int) -> None:
    assert judged(Segment(start, end, "grasp")).delineated == 1 / 3


@pytest.mark.parametrize("end", [285, 300, 399, 400])
def test_rest_after_the_last_action_belongs_to_nobody(end: int) -> None:
    assert judged(Segment(200, end, "retract")).delineated == 1 / 3


def test_idle_segments_are_rest() -> None:
    truth = (TRUTH[0], Segment(100, 110), *TRUTH[1:], Segment(300, 400))
    found = (*TRUTH, Segment(310, 330, "push"), Segment(340, 390))
    assert judged(*found, truth=truth) == judged(*found)
    assert judged(*found).n_found == 4
    assert judged(*found).action_in_rest == 20 / 130


def test_hand_made_table() -> None:
    """A split grasp, a push taken for a retraction, a sloppy retraction and one in rest."""
    result = judged(
        Segment(20, 70, "grasp"),
        Segment(70, 100, "push"),
        Segment(110, 196, "retract"),
        Segment(220, 300, "retract"),
        Segment(350, 380, "retract"),
    )
    assert (result.n_true, result.n_found, result.n_extra) == (3, 5, 2)
    assert result.delineated == 1 / 3
    assert result.classified_of_delineated == 0.0
    assert result.f1_50 == 2 * 2 / 8
    assert result.f1_75 == 2 * 1 / 8
    assert result.frame_accuracy == (50 + 0 + 80) / 270
    assert result.action_in_rest == 30 / 130
    assert result.median_boundary_error_ms == pytest.approx(np.median([0, 300, 200, 0]))
    assert list(result.per_class) == sorted(CLASSES)
    assert result.confusion == ((1, 0, 0, 0), (0, 0, 1, 0), (0, 0, 1, 0), (0, 1, 1, 0))
    assert result.per_class["retract"].f1_50 == 2 * 1 / 4
    assert result.per_class["push"].frame_accuracy == 0.0


def test_figures_are_pooled_not_averaged() -> None:
    good = (TIMES, TRUTH, TRUTH)
    bad = (TIMES, TRUTH[:1], ())
    assert evaluate([good, bad]).delineated == 3 / 4
    assert evaluate([good, bad]).f1_50 == 2 * 3 / 7


@pytest.mark.parametrize("segment", [Segment(-1, 5), Segment(5, 5, "push"), Segment(7, 6), Segment(0, 401)])
def test_segments_outside_the_recording_are_refused(segment: Segment) -> None:
    with pytest.raises(InvalidSegment, match="segment 1"):
        judged(TRUTH[0], segment)


@given(st.lists(recordings(), max_size=4), st.randoms(use_true_random=False))
def test_order_does_not_matter(labelled: list[Labelled], random: Random) -> None:
    shuffled = [
        (times, random.sample(truth, len(truth)), random.sample(found, len(found)))
        for times, truth, found in random.sample(labelled, len(labelled))
    ]
    assert evaluate(shuffled) == evaluate(labelled)


@given(recordings(), st.floats(-1e3, 1e3))
def test_when_it_happened_does_not_matter(labelled: Labelled, later: float) -> None:
    times, truth, found = labelled
    moved, still = evaluate([(times + later, truth, found)]), evaluate([labelled])
    assert (moved.confusion, moved.per_class) == (still.confusion, still.per_class)


@given(recordings())
def test_names_do_not_matter(labelled: Labelled) -> None:
    times, truth, found = labelled
    renamed = dict(zip(CLASSES, ("c", "a", "b"), strict=True))

    def again(segments: Sequence[Segment]) -> list[Segment]:
        return [Segment(s.start, s.end, renamed[s.action] if s.action else None) for s in segments]

    before, after = evaluate([labelled]), evaluate([(times, again(truth), again(found))])
    assert {renamed[name]: measures for name, measures in before.per_class.items()} == after.per_class
    assert (before.f1_50, before.frame_accuracy) == (after.f1_50, after.frame_accuracy)


@given(st.lists(recordings(), min_size=1, max_size=3))
def test_confusion_counts_every_segment_once(labelled: list[Labelled]) -> None:
    result = evaluate(labelled)
    counts = np.array(result.confusion)
    assert [m.n_true for m in result.per_class.values()] == counts[:-1].sum(axis=1).tolist()
    assert [m.n_found for m in result.per_class.values()] == counts[:, :-1].sum(axis=0).tolist()
    assert counts[-1].sum() == result.n_extra
    assert counts.min() >= 0


@given(recordings())
def test_pairs_are_as_many_as_enumeration_finds(labelled: Labelled) -> None:
    _, truth, found = labelled
    true, seen = named(truth), named(found)
    result = evaluate([labelled])
    for k, f1 in ((0.5, result.f1_50), (0.75, result.f1_75)):
        allowed = [[t.action == s.action and iou(t, s) >= k for s in seen] for t in true]
        pairs = most_pairs(np.array(allowed, dtype=bool).reshape(len(true), len(seen)))
        assert f1 == (2 * pairs / (len(true) + len(seen)) if true or seen else None)


@given(recordings())
def test_delineated_are_as_many_as_enumeration_finds(labelled: Labelled) -> None:
    _, truth, found = labelled
    true, seen = named(truth), named(found)
    allowed = np.zeros((len(true), len(seen)), dtype=bool)
    for row, segment in enumerate(true):
        rest_from = goal(true[row - 1]) if row else 0
        rest_to = true[row + 1].start if row + 1 < len(true) else N_FRAMES - 1
        for column, s in enumerate(seen):
            starts = abs(s.start - segment.start) <= 15 or rest_from <= s.start <= segment.start
            ends = abs(goal(s) - goal(segment)) <= 15 or goal(segment) <= goal(s) <= rest_to
            allowed[row, column] = starts and ends
    assert evaluate([labelled]).delineated == (most_pairs(allowed) / len(true) if true else None)
