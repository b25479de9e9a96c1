"""Laws of violations and notices: each is there if, and only if, something lies outside its bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from app.motion.asked import Workspace
from app.motion.errors import InvalidRequest
from app.motion.feasibility import (
    CLEARANCE,
    FAR_LENGTH,
    FAR_RISE,
    MISSED,
    leaves,
    passes,
    remoteness,
    rests,
    sinks,
    stays_above,
)
from app.motion.model import ActionModel, Model
from app.motion.trajectory import Floats

BOX = Workspace(np.array([-1.0, -2.0, 0.0]), np.array([1.0, 2.0, 0.5]))
TIMES = np.arange(50) / 100.0
INSIDE = np.array([0.0, 0.0, 0.25])
SIDES = [(axis, name, side) for axis, name in enumerate("xyz") for side in ("min", "max")]
UP = np.array([0.0, 0.0, 1.0])


def walk(seed: int) -> Floats:
    """Return a movement (50, 3) within the box, whichever way it goes [m]."""
    return INSIDE + np.random.default_rng(seed).uniform(-0.2, 0.2, (50, 3))


def limit_of(axis: int, side: str) -> float:
    return float(np.asarray(BOX.least if side == "min" else BOX.most)[axis])


@given(st.integers(0, 2**32 - 1))
def test_movement_within_the_box_and_above_the_table_violates_nothing(seed: int) -> None:
    assert list(leaves(BOX, TIMES, walk(seed))) == []
    assert list(sinks(0.0, TIMES, walk(seed))) == []


@pytest.mark.parametrize(("axis", "name", "side"), SIDES)
@given(st.integers(0, 2**32 - 1), st.integers(0, 49), st.floats(1e-5, 10.0))
def test_each_side_is_violated_where_the_movement_is_furthest_beyond(
    axis: int, name: str, side: str, seed: int, frame: int, beyond: float
) -> None:
    positions, limit = walk(seed), limit_of(axis, side)
    outwards = 1.0 if side == "max" else -1.0
    positions[frame, axis] = limit + outwards * beyond
    positions[(frame + 1) % 50, axis] = limit + outwards * 0.9 * beyond
    (violation,) = leaves(BOX, TIMES, positions)
    assert (violation.kind, violation.time) == (f"workspace_{side}_{name}", TIMES[frame])
    assert (violation.value, violation.limit) == (positions[frame, axis], limit)


@pytest.mark.parametrize(("axis", "name", "side"), SIDES)
@pytest.mark.parametrize(("share", "n_violations"), [(-1.0, 0), (0.0, 0), (0.9, 0), (1.1, 1)])
def test_what_is_beyond_a_side_by_less_than_the_clearance_is_not(
    axis: int, name: str, side: str, share: float, n_violations: int
) -> None:
    positions = walk(0)
    outwards = 1.0 if side == "max" else -1.0
    positions[7, axis] = limit_of(axis, side) + outwards * share * CLEARANCE
    assert len(list(leaves(BOX, TIMES, positions))) == n_violations


def test_all_sides_may_be_violated_by_one_movement() -> None:
    positions = walk(0)
    positions[:2] = np.array([BOX.least, BOX.most]) * [[1.1], [1.1]] - [[0.0, 0.0, 0.1], [0.0, 0.0, 0.0]]
    kinds = [violation.kind for violation in leaves(BOX, TIMES, positions)]
    assert kinds == [f"workspace_{side}_{name}" for _, name, side in SIDES]


@pytest.mark.parametrize(("share", "n_violations"), [(0.0, 0), (0.9, 0), (1.1, 1), (1e4, 1)])
@pytest.mark.parametrize("height", [-0.7, 0.0, 0.02])
def test_table_is_violated_by_what_sinks_below_it(height: float, share: float, n_violations: int) -> None:
    positions = walk(0)
    positions[31, 2] = height - share * CLEARANCE
    violations = list(sinks(height, TIMES, positions))
    assert len(violations) == n_violations
    for violation in violations:
        assert (violation.kind, violation.time, violation.limit) == ("table", TIMES[31], height)
        assert violation.value == positions[31, 2]


@pytest.mark.parametrize(
    ("least", "most"), [([0, 0, 0], [1, 0, 1]), ([0, 2, 0], [1, 1, 1]), ([0, 0, np.nan], [1, 1, 1])]
)
def test_box_whose_corners_are_not_in_order_is_refused(least: Sequence[float], most: Sequence[float]) -> None:
    with pytest.raises(InvalidRequest) as refused:
        Workspace(least, most)
    assert refused.value.field == "workspace"


@pytest.mark.parametrize(
    ("ends", "names"), [((0.0, 0.0), []), ((0.1, 0.0), ["start"]), ((0.0, 0.1), ["goal"])]
)
def test_end_that_does_not_rest_is_a_violation(ends: tuple[float, float], names: list[str]) -> None:
    velocities = np.ones((50, 3))
    velocities[[0, -1]] = [[0.0, ends[0], 0.0], [0.0, ends[1], 0.0]]
    violations = list(rests(TIMES, velocities))
    assert [violation.kind for violation in violations] == [f"moves_at_{name}" for name in names]
    assert [violation.value for violation in violations] == [0.1] * len(names)


@given(st.integers(0, 2**32 - 1), st.lists(st.floats(0.0, 2.0), max_size=5))
def test_point_is_missed_where_it_is_further_off_than_asked(seed: int, shares: list[float]) -> None:
    rng = np.random.default_rng(seed)
    n, far = len(shares), np.array(shares)
    stds, times = rng.uniform(0.001, 0.1, n), rng.uniform(0.0, 1.0, n)
    positions, away = rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    away *= (far * MISSED * stds / np.linalg.norm(away, axis=1))[:, None]
    assume((np.abs(far - 1.0) * MISSED * stds > 2 * CLEARANCE).all())
    missed = list(passes(times, positions, positions + away, stds))
    assert [(each.kind, each.time) for each in missed] == [("via", time) for time in times[far > 1.0]]
    np.testing.assert_allclose([each.value for each in missed], (far * MISSED * stds)[far > 1.0])
    np.testing.assert_allclose([each.limit for each in missed], (MISSED * stds)[far > 1.0])


def test_class_stays_above_the_table_where_all_its_states_do(trained: Model) -> None:
    chain = trained.action("push")
    means = chain.means.copy()
    assert stays_above(chain)
    means[1, 3] = -0.01
    assert not stays_above(replace(chain, means=means))


def going(chain: ActionModel, starts: Floats, ways: Floats) -> ActionModel:
    return replace(chain, starts=starts, ways=ways)


@pytest.fixture(scope="module")
def level(trained: Model) -> ActionModel:
    """Return a class that was shown from 0.2 to 0.4 m to all sides, about the origin."""
    starts = np.array([[0.1, 0.1, 0.0], [-0.1, -0.1, 0.0], [0.1, -0.1, 0.1], [-0.1, 0.1, 0.1]])
    ways = np.array([[0.4, 0.0, 0.0], [-0.4, 0.0, 0.0], [0.0, -0.2, 0.0], [0.0, 0.2, 0.0]])
    return going(trained.action("grasp"), starts, ways)


def codes(chain: ActionModel, start: Floats, goal: Floats) -> list[str]:
    return [notice.code for notice in remoteness(chain, start, goal - start)]


def test_what_was_demonstrated_is_not_far(trained: Model, level: ActionModel) -> None:
    for chain in (*trained.actions, level):
        for start, way in zip(chain.starts, chain.ways, strict=True):
            assert codes(chain, start, start + way) == []


@pytest.mark.parametrize(("share", "expected"), [(0.99, []), (1.01, ["start_far"])])
@pytest.mark.parametrize("side", [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
def test_start_is_far_where_it_is_off_by_more_than_movements_are_long(
    level: ActionModel, side: Sequence[float], share: float, expected: list[str]
) -> None:
    edge = np.where(np.asarray(side) > 0.0, level.starts.max(axis=0), level.starts.min(axis=0))
    start = edge + share * level.lengths.mean() * np.asarray(side)
    assert codes(level, start, start + np.array([0.3, 0.0, 0.0]))[:1] == expected


@pytest.mark.parametrize(("share", "expected"), [(0.99, []), (1.01, ["goal_far"])])
@pytest.mark.parametrize("side", [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
def test_goal_is_far_where_it_is_off_by_more_than_movements_are_long(
    level: ActionModel, side: Sequence[float], share: float, expected: list[str]
) -> None:
    goals = level.starts + level.ways
    edge = np.where(np.asarray(side) > 0.0, goals.max(axis=0), goals.min(axis=0))
    goal = edge + share * level.lengths.mean() * np.asarray(side)
    start = goal - 0.4 * np.asarray(side)
    assert [code for code in codes(level, start, goal) if code == "goal_far"] == expected


@pytest.mark.parametrize(
    ("length", "is_far"),
    [
        (0.99 * 0.2 / FAR_LENGTH, 1),
        (1.01 * 0.2 / FAR_LENGTH, 0),
        (0.3, 0),
        (0.99 * 0.4 * FAR_LENGTH, 0),
        (1.01 * 0.4 * FAR_LENGTH, 1),
    ],
)
def test_length_is_far_where_it_is_beyond_the_longest_or_shortest(
    level: ActionModel, length: float, is_far: int
) -> None:
    start = np.array([-length / 2, 0.0, 0.05])
    assert codes(level, start, start + np.array([length, 0.0, 0.0])) == ["length_far"] * is_far


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(("beyond", "is_far"), [(0.99, 0), (1.01, 1)])
def test_rise_is_far_where_it_is_beyond_all_demonstrated(
    level: ActionModel, sign: float, beyond: float, is_far: int
) -> None:
    angle = sign * beyond * FAR_RISE
    way = 0.3 * np.array([np.cos(angle), 0.0, np.sin(angle)])
    assert codes(level, np.zeros(3), way) == ["rise_far"] * is_far


@given(st.integers(0, 2**32 - 1))
def test_notices_are_the_same_wherever_all_of_it_is(level: ActionModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    by, (start, goal) = rng.uniform(-5.0, 5.0, 3), rng.uniform(-1.0, 1.0, (2, 3))
    moved = going(level, level.starts + by, level.ways)
    assert codes(moved, start + by, goal + by) == codes(level, start, goal)


def test_class_that_moves_straight_up_knows_no_other_rise(trained: Model) -> None:
    lengths = np.array([0.1, 0.3, 0.2])
    lift = going(trained.action("grasp"), np.zeros((3, 3)), np.outer(lengths, UP))
    assert codes(lift, np.zeros(3), 0.2 * UP) == []
    assert codes(lift, np.zeros(3), np.array([1e-9, 0.0, 0.2])) == []
    assert codes(lift, np.zeros(3), np.array([0.15, 0.0, 0.0])) == ["rise_far"]
    assert codes(lift, 0.15 * UP, np.zeros(3)) == ["rise_far"]


def test_detail_says_by_how_much(level: ActionModel) -> None:
    (notice,) = remoteness(level, np.array([-0.36, 0.0, 0.05]), np.array([0.72, 0.0, 0.0]))
    assert notice.detail == "0.72 m are 1.8 times beyond the longest demonstrated, 0.4 m"
