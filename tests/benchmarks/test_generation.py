"""The benchmark of generation: its measures, its peers and its movements."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest

from app.motion.model import Model
from app.motion.simulation import demonstrations
from app.motion.trajectory import Floats, Trajectory
from benchmarks.folders import ROLE, SHARED
from benchmarks.generation import PROMP_MEAN, SLACK, Measured, asked, measure, overall, section
from benchmarks.generators import OURS, PEERS, Generate, align, minimum_jerk_line, teach
from benchmarks.likeness import (
    BANDS,
    N_PHASES,
    apart,
    at_phases,
    compare,
    mean,
    off_the_ends,
    smoothness,
    warped,
    within,
)
from benchmarks.movements import Fold, Source, finger, lost, of_folder, reach_and_return, reach_to_grasp

START, GOAL, DURATION = np.array([0.05, -0.1, 0.1]), np.array([0.2, 0.2, 0.05]), 0.8


def _walk(seed: int, n_points: int) -> Floats:
    return np.cumsum(np.random.default_rng(seed).normal(size=(n_points, 3)), axis=0)


def _pairings(n: int, m: int) -> Iterator[list[tuple[int, int]]]:
    """Yield every way to pair n points with m in order, both ends with each other."""
    if (n, m) == (1, 1):
        yield [(0, 0)]
        return
    for before in ((n - 1, m), (n, m - 1), (n - 1, m - 1)):
        if min(before):
            for pairing in _pairings(*before):
                yield [*pairing, (n - 1, m - 1)]


@pytest.mark.parametrize(("n", "m"), [(1, 1), (1, 4), (4, 4), (5, 3), (6, 5)])
def test_warping_takes_the_best_of_all_pairings(n: int, m: int) -> None:
    one, other = _walk(n, n), _walk(10 * m, m)
    sums = [
        (sum(float(np.linalg.norm(one[i] - other[j])) for i, j in pairing), len(pairing))
        for pairing in _pairings(n, m)
    ]
    total, n_pairs = min(sums)
    assert warped(one, other) == pytest.approx(total / n_pairs)


def test_warping_forgives_timing_and_nothing_else() -> None:
    path = _walk(0, 30)
    late = path[np.r_[np.zeros(5, dtype=int), np.arange(30), np.full(9, 29)]]
    assert warped(path, late) == 0.0
    assert warped(path, late + 0.1) > 0.0


def test_what_was_made_is_like_itself() -> None:
    made = at_phases(demonstrations(1)[0].trajectory)
    same = compare(made, made, np.full(made.shape, 1e-3))
    assert (same.apart, same.warped, same.ends) == (0.0, 0.0, 0.0)
    np.testing.assert_array_equal(same.inside, 1.0)


def test_a_shift_is_measured_as_it_is() -> None:
    made, shift = _walk(1, N_PHASES), np.array([0.03, 0.0, 0.04])
    assert apart(made, made + shift) == pytest.approx(0.05)
    assert off_the_ends(made, made + shift) == pytest.approx(0.05)
    std = np.full(made.shape, 0.035)
    np.testing.assert_array_equal(within(made, made + shift, std, 1.0), [1.0, 1.0, 0.0])


def test_a_band_holds_what_is_drawn_from_it() -> None:
    std = np.array([0.1, 0.2, 0.4])
    drawn = std * np.random.default_rng(0).normal(size=(20_000, 3))
    for per_cent, width in BANDS.items():
        shares = within(drawn, np.zeros_like(drawn), np.broadcast_to(std, drawn.shape), width)
        np.testing.assert_allclose(100 * shares, per_cent, atol=1.0)


def test_the_smoothness_of_a_minimum_jerk_movement_is_known_whatever_its_size() -> None:
    line = minimum_jerk_line(START, GOAL, DURATION).positions
    assert smoothness(line) == pytest.approx(-np.log(204.8), abs=0.01)
    assert smoothness(7.0 * line) == pytest.approx(smoothness(line))
    assert smoothness(line + _walk(2, N_PHASES) * 1e-3) < smoothness(line)


def test_a_mean_is_that_of_every_measure() -> None:
    made = _walk(3, N_PHASES)
    near, far = compare(made, made + 0.1), compare(made, made + 0.3)
    assert mean([near, far]).apart == pytest.approx(0.2 * np.sqrt(3))
    assert np.isnan(mean([near, far]).inside).all()


def test_a_trajectory_at_regular_instants_bridges_dropouts() -> None:
    times = np.array([0.0, 0.1, 0.3, 0.4])
    hand = np.outer(times, [1.0, 2.0, 3.0])
    hand[1] = np.nan
    np.testing.assert_allclose(
        at_phases(Trajectory(times, hand), 5), np.outer(np.linspace(0.0, 0.4, 5), [1.0, 2.0, 3.0])
    )


@pytest.fixture(scope="module")
def grasps(trained: Model) -> dict[str, Generate]:
    return teach("grasp", demonstrations(1), trained)


@pytest.mark.parametrize("name", [OURS, *PEERS])
@pytest.mark.parametrize("duration", [0.3, 0.7, 1.1])
def test_every_method_goes_from_start_to_goal(
    grasps: dict[str, Generate], name: str, duration: float
) -> None:
    positions = grasps[name](START, GOAL, duration, 100).positions
    assert positions.shape == (100, 3)
    misses = np.linalg.norm(positions[[0, -1]] - [START, GOAL], axis=1)
    most = {"DMP": 0.02, "ProMP": 1e-3}
    assert misses.max() < most.get(name.split(",", maxsplit=1)[0], 1e-9)


@pytest.mark.parametrize("name", [OURS, "DMP, aligned", "ProMP, aligned", "the paper's", "minimum-jerk line"])
def test_what_is_aligned_turns_with_start_and_goal(grasps: dict[str, Generate], name: str) -> None:
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    there = grasps[name](START, GOAL, DURATION).positions
    turned = grasps[name](turn @ START + 1.0, turn @ GOAL + 1.0, DURATION).positions
    np.testing.assert_allclose(turned, there @ turn.T + 1.0, atol=1e-6)


@pytest.mark.parametrize("name", ["DMP", "DMP, aligned", "ProMP", "ProMP, aligned"])
def test_a_primitive_of_one_movement_repeats_it(trained: Model, name: str) -> None:
    shown = next(each for each in demonstrations(1) if each.action == "grasp")
    made = at_phases(shown.trajectory)
    generated = teach("grasp", [shown] * 3, trained)[name](made[0], made[-1], 1.0)
    assert apart(made, generated.positions) < 5e-3


def test_the_line_is_straight(grasps: dict[str, Generate]) -> None:
    np.testing.assert_allclose(
        align(grasps["minimum-jerk line"](START, GOAL, DURATION).positions)[:, 1:], 0.0, atol=1e-12
    )


def _bell(times: Floats, begin: float, end: float) -> Floats:
    share = np.clip((times - begin) / (end - begin), 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def test_reach_and_return_are_where_the_finger_moves() -> None:
    times = np.arange(340) / 85.0
    way = _bell(times, 0.2, 1.0) - _bell(times, 2.5, 3.3)
    (first, reach), (second, back) = reach_and_return(Trajectory(times, np.outer(way, [0.3, 0.2, 0.1])))
    assert (first, second) == ("reach", "return")
    for motion, begin, end in ((reach, 0.2, 1.0), (back, 2.5, 3.3)):
        assert begin < motion.times[0] < begin + 0.1
        assert end - 0.1 < motion.times[-1] < end


def test_frames_that_are_no_measurement_are_left_out() -> None:
    rows = [
        {
            "time_s": time,
            "index_x": x,
            "index_y": "2000",
            "index_z": "-3000",
            "fingers_occluded": hidden,
        }
        for time, x, hidden in (
            ("0.00", "1", "0"),
            ("0.01", "1", "0"),
            ("0.02", "2", "1"),
            ("0.03", "3", "0"),
            ("0.031", "4", "0"),
            ("0.04", "5", "0"),
        )
    ]
    motion = finger(rows)
    np.testing.assert_allclose(motion.times, [0.0, 0.03, 0.04])
    np.testing.assert_allclose(motion.hand[1], [0.003, 3.0, 2.0])


@pytest.mark.parametrize(
    ("kept", "leap", "expected"), [([0, 1, 2, 3], 0.0, False), ([0, 3], 0.0, True), ([0, 1], 0.2, True)]
)
def test_a_finger_is_lost_where_it_is_gone_or_leaps(kept: list[int], leap: float, expected: bool) -> None:
    times = np.arange(4) / 20.0
    hand = np.outer(times, [0.1, 0.0, 0.0])
    hand[1] += leap
    assert lost(Trajectory(times[kept], hand[kept])) is expected


@pytest.fixture(scope="module")
def small() -> Measured:
    """Grasps and pushes of the simulator, a few of each."""
    few = [each for each in demonstrations(1) if each.action in ("grasp", "push")][::5]
    other = [each for each in demonstrations(2) if each.action in ("grasp", "push")][::20]
    return measure(Source("simulated", "A few.", [Fold("seed 2", few, other)], (ROLE,)))


def test_the_best_peer_is_compared_with_ours(small: Measured) -> None:
    assert small.ratio(OURS) == pytest.approx(1.0)
    for action in small.source.classes:
        peers = {peer: small.of(peer, action).apart for peer in PEERS}
        best = small.best_peer(action, lambda of: of.apart)
        assert peers[best] == min(peers.values())
        lead = small.lead(action, lambda of: of.apart)
        assert lead.mean() == pytest.approx(peers[best] - small.of(OURS, action).apart)


def test_the_page_tells_what_is_asked_and_every_method(small: Measured) -> None:
    goals = list(asked([small], {OURS: 0.9e-3, "DMP": 2e-3, "ProMP": 1e-3, PROMP_MEAN: 0.5e-3}))
    assert [goal.met for goal in goals if "processor" in goal.asked] == [True]
    inside = 100 * small.overall(OURS).inside
    expected = all((np.abs(of - at) <= SLACK[at]).all() for of, at in zip(inside, BANDS, strict=True))
    assert [goal.met for goal in goals if "bands" in goal.asked] == [expected]
    text = overall([small]) + section(small)
    assert all(f"| {method} |" in text for method in (OURS, *PEERS))
    assert "grasp (" in text


@pytest.mark.shared
def test_real_movements_are_counted() -> None:
    people = of_folder(SHARED / "vmci_pick_place")
    assert [fold.held for fold in people.folds] == ["subject1", "subject2"]
    assert [set(Counter(each.action for each in fold.test).values()) for fold in people.folds] == [{9}, {6}]
    assert len(people.classes) == 6
    scripted = of_folder(SHARED / "metaworld_scripted")
    assert Counter(each.action for fold in scripted.folds for each in fold.test) == {
        "grasp": 26,
        "retract": 26,
        "displace": 13,
        "push": 13,
    }


@pytest.mark.shared
def test_every_reach_and_return_is_held_out_once() -> None:
    source = reach_to_grasp(SHARED / "kinesis_reach_to_grasp")
    assert Counter(each.action for fold in source.folds for each in fold.test) == {"reach": 45, "return": 42}
    for fold in source.folds:
        assert len(fold.training) + len(fold.test) == 87
        assert not {id(each) for each in fold.training} & {id(each) for each in fold.test}
    durations = [each.trajectory.times[-1] for fold in source.folds for each in fold.test]
    assert min(durations) > 0.0
