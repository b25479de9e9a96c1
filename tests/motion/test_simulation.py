"""Laws of the simulated table-top protocol."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from app.motion.errors import InvalidRequest
from app.motion.features import alignment
from app.motion.simulation import (
    GRIP,
    RATE,
    REST_POINT,
    STYLES,
    Conditions,
    Style,
    demonstrations,
    further_styles,
    recording,
)
from app.motion.trajectory import Demonstration, Floats, Trajectory

EXACT = Conditions(noise=0.0)
PLAIN = Conditions(noise=0.0, sweep=0.0)
"""Neither noise, nor bow, nor modes: what is left is the line, the time and the arch."""


def aligned(trajectory: Trajectory) -> Floats:
    """Return the path relative to its start, turned so that the goal lies on the first axis."""
    hand = trajectory.hand
    path: Floats = (hand - hand[0]) @ alignment(hand[0], hand[-1]).T
    return path


def distance(demonstration: Demonstration) -> float:
    hand = demonstration.trajectory.hand
    return float(np.linalg.norm(hand[-1] - hand[0]))


def points_of(demonstrated: list[Demonstration], frame: int) -> Counter[tuple[float, ...]]:
    return Counter(tuple(np.round(d.trajectory.hand[frame] - GRIP, 9)) for d in demonstrated)


def test_training_set_is_the_papers() -> None:
    shown = demonstrations(1, EXACT)
    by_class = {action: [d for d in shown if d.action == action] for action in STYLES}
    counts = {action: len(of_class) for action, of_class in by_class.items()}
    assert counts == {"grasp": 60, "displace": 50, "push": 50, "retract": 60}
    points = points_of(by_class["grasp"], -1)
    assert set(points.values()) == {10}
    assert points_of(by_class["retract"], 0) == points
    radii, angles = (
        sorted(np.hypot(x, y) for x, y, _ in points),
        sorted(float(np.arctan2(x, y)) for x, y, _ in points),
    )
    np.testing.assert_allclose(radii, [0.25] * 3 + [0.40] * 3)
    np.testing.assert_allclose(angles, [-0.9, -0.9, 0.0, 0.0, 0.9, 0.9], atol=1e-8)
    for action in ("displace", "push"):
        starts, goals = points_of(by_class[action], 0), points_of(by_class[action], -1)
        assert len(starts) == 2
        assert set(starts.values()) == {25}
        assert set(goals) == set(points)


def test_hand_rests_at_the_same_place() -> None:
    for demonstration in demonstrations(2, EXACT):
        if demonstration.action in ("grasp", "retract"):
            frame = 0 if demonstration.action == "grasp" else -1
            np.testing.assert_allclose(demonstration.trajectory.hand[frame], REST_POINT, atol=1e-12)


def test_durations_grow_with_distance() -> None:
    shown = demonstrations(3, EXACT)
    factors = [np.log((len(d.trajectory) - 1) / RATE / (0.45 + 1.1 * distance(d))) for d in shown]
    assert abs(np.mean(factors)) < 0.03
    assert 0.12 < np.std(factors) < 0.18


@pytest.mark.parametrize(("action", "height"), [("grasp", 0.06), ("displace", 0.13), ("retract", 0.05)])
def test_arch_has_its_height(action: str, height: float) -> None:
    arches = [aligned(d.trajectory)[:, 2].max() for d in demonstrations(4, PLAIN) if d.action == action]
    logs = np.log(np.array(arches) / height)
    assert abs(np.median(logs)) < 0.1
    assert 0.18 < np.std(logs) < 0.32


def test_push_stays_on_the_table() -> None:
    for demonstration in demonstrations(4, PLAIN):
        if demonstration.action == "push":
            np.testing.assert_allclose(demonstration.trajectory.hand[:, 2], GRIP[2], atol=1e-12)


@pytest.mark.parametrize(
    ("action", "bow"), [("grasp", 0.025), ("displace", 0.01), ("push", 0.008), ("retract", -0.03)]
)
def test_bow_swings_to_its_side(action: str, bow: float) -> None:
    swings = []
    for seed in range(4):
        for demonstration in demonstrations(seed, EXACT):
            if demonstration.action == action:
                path = aligned(demonstration.trajectory)
                middle = np.argmin(abs(path[:, 0] - path[-1, 0] / 2))
                swings.append(path[middle, 1])
    assert np.mean(swings) == pytest.approx(bow * np.exp(0.4**2 / 2), abs=0.0025)


def test_sweeping_multiplies_bow_and_modes() -> None:
    calm, usual, sweeping = (
        demonstrations(5, Conditions(noise=0.0, sweep=sweep)) for sweep in (0.0, 1.0, 3.0)
    )
    for none, once, thrice in zip(calm, usual, sweeping, strict=True):
        difference = once.trajectory.hand - none.trajectory.hand
        np.testing.assert_allclose(thrice.trajectory.hand - none.trajectory.hand, 3 * difference, atol=1e-12)
        assert abs(difference).max() > 1e-3


def test_modes_lift_a_push_less() -> None:
    lifts: dict[str, list[Floats]] = {action: [] for action in STYLES}
    for calm, usual in zip(demonstrations(6, PLAIN), demonstrations(6, EXACT), strict=True):
        lifts[usual.action].append(usual.trajectory.hand[:, 2] - calm.trajectory.hand[:, 2])
    size = {action: np.std(np.concatenate(of_class)) for action, of_class in lifts.items()}
    assert 0.1 < size["push"] / size["displace"] < 0.2


def test_movements_are_minimum_jerk_along_the_line() -> None:
    conditions = Conditions(noise=0.0, sweep=0.0, styles={"push": STYLES["push"]})
    peaks = []
    for demonstration in demonstrations(7, conditions):
        along = aligned(demonstration.trajectory)[:, 0] / distance(demonstration)
        speed = np.diff(along) * (len(along) - 1)
        assert (speed > 0).all()
        assert speed[0] < 0.1
        assert speed[-1] < 0.1
        peaks.append(speed.max())
    assert np.mean(peaks) == pytest.approx(1.875, rel=0.03)


def test_every_movement_starts_and_ends_at_rest() -> None:
    for demonstration in demonstrations(8, EXACT):
        speed = np.linalg.norm(np.diff(demonstration.trajectory.hand, axis=0), axis=1) * RATE
        assert max(speed[0], speed[-1]) < 0.1 * speed.max()


def test_same_seed_same_bits() -> None:
    for once, again in zip(demonstrations(9), demonstrations(9), strict=True):
        np.testing.assert_array_equal(once.trajectory.hand, again.trajectory.hand)
    np.testing.assert_array_equal(recording(9).trajectory.hand, recording(9).trajectory.hand)
    assert not np.array_equal(recording(9).trajectory.hand[:50], recording(10).trajectory.hand[:50])


@pytest.mark.parametrize("n_actions", [2, 3, 5, 12])
def test_sequences_follow_the_protocol(n_actions: int) -> None:
    middle = set()
    for seed in range(10):
        actions = [segment.action for segment in recording(seed, n_actions).segments]
        assert len(actions) == n_actions
        assert (actions[0], actions[-1]) == ("grasp", "retract")
        middle.update(actions[1:-1])
    assert middle == ({"displace", "push"} if n_actions > 2 else set())


@pytest.mark.parametrize("n_actions", [-1, 0, 1])
def test_sequence_too_short_for_the_protocol_is_refused(n_actions: int) -> None:
    with pytest.raises(InvalidRequest, match="n_actions"):
        recording(0, n_actions)


@pytest.mark.parametrize("seed", range(5))
def test_boundaries_are_exact(seed: int) -> None:
    labelled = recording(seed, 6, EXACT)
    hand = labelled.trajectory.hand
    assert labelled.segments[0].start == 0
    assert labelled.segments[-1].end == len(hand) - 1
    for before, after in pairwise(labelled.segments):
        assert 0 <= after.start - before.end <= 0.2 * RATE
        np.testing.assert_allclose(
            hand[before.end : after.start + 1],
            np.broadcast_to(hand[before.end], (after.start - before.end + 1, 3)),
            atol=1e-12,
        )
    for segment in labelled.segments:
        moving = np.linalg.norm(np.diff(hand[segment.start : segment.end + 1], axis=0), axis=1)
        assert (moving > 0).all()


def test_places_are_untrained_ones() -> None:
    for seed in range(20):
        labelled = recording(seed, 5, EXACT)
        for segment in labelled.segments[:-1]:
            x, y, z = labelled.trajectory.hand[segment.end]
            assert 0.22 <= np.hypot(x, y) <= 0.42
            assert abs(np.arctan2(x, y)) <= 1.0
            assert z == pytest.approx(GRIP[2])
        np.testing.assert_allclose(labelled.trajectory.hand[-1], REST_POINT, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_object_goes_with_the_hand_that_moves_it(seed: int) -> None:
    labelled = recording(seed, 5, EXACT)
    hand, markers = labelled.trajectory.hand, labelled.trajectory.objects["object"]
    for segment in labelled.segments:
        frames = slice(segment.start, segment.end + 1)
        if segment.action in ("grasp", "retract"):
            np.testing.assert_allclose(np.ptp(markers[frames], axis=0), 0.0, atol=1e-12)
            assert markers[segment.start][2] == pytest.approx(0.0, abs=1e-12)
        else:
            np.testing.assert_allclose(
                hand[frames] - markers[frames], np.broadcast_to(GRIP, hand[frames].shape), atol=1e-12
            )
    assert abs(np.diff(markers, axis=0)).max() < 0.05


def test_demonstrations_of_a_recording_are_its_segments() -> None:
    labelled = recording(4, 4)
    for segment, demonstration in zip(labelled.segments, labelled.demonstrations(), strict=True):
        assert demonstration.action == segment.action
        np.testing.assert_array_equal(
            demonstration.trajectory.hand[-1], labelled.trajectory.hand[segment.end]
        )


def test_sensor_noise_is_as_asked() -> None:
    truth = recording(1, 20, EXACT).trajectory
    for noise in (0.0005, 0.004):
        sensed = recording(1, 20, Conditions(noise=noise)).trajectory
        assert np.std(sensed.hand - truth.hand) == pytest.approx(noise, rel=0.05)
        assert np.std(sensed.objects["object"] - truth.objects["object"]) == pytest.approx(noise, rel=0.05)


def test_frames_come_at_100_hz() -> None:
    times = recording(1).trajectory.times
    np.testing.assert_allclose(times, np.arange(len(times)) / 100.0)


def test_outliers_are_as_asked() -> None:
    truth = recording(2, 40, EXACT).trajectory.hand
    sensed = recording(2, 40, Conditions(noise=0.0, outlier_share=0.05, outlier_size=0.2)).trajectory.hand
    thrown = np.linalg.norm(sensed - truth, axis=1)
    far = thrown > 1e-9
    assert np.mean(far) == pytest.approx(0.05, abs=0.012)
    np.testing.assert_allclose(thrown[far], 0.2)


@pytest.mark.parametrize("gap_length", [0.1, 0.3, 5.0])
def test_gaps_are_as_asked(gap_length: float) -> None:
    labelled = recording(3, 10, Conditions(gap_share=1.0, gap_length=gap_length))
    lost = np.isnan(labelled.trajectory.hand[:, 0])
    for segment in labelled.segments:
        within = lost[segment.start : segment.end + 1]
        n_lost = min(round(gap_length * RATE), segment.end - segment.start - 1)
        assert within.sum() == pytest.approx(n_lost, abs=1)
        assert np.abs(np.diff(within.astype(int))).sum() == 2
        assert not within[[0, -1]].any()
    assert not np.isnan(labelled.trajectory.objects["object"]).any()
    assert not np.isnan(recording(3, 10).trajectory.hand).any()


def test_rest_is_as_asked() -> None:
    labelled = recording(5, 30, Conditions(rest=(0.5, 1.0)))
    rests = [(after.start - before.end) / RATE for before, after in pairwise(labelled.segments)]
    assert 0.5 <= min(rests) < 0.6
    assert 0.9 < max(rests) <= 1.0
    assert all(a.end == b.start for a, b in pairwise(recording(5, 30, Conditions(rest=(0.0, 0.0))).segments))


def test_further_classes_take_part() -> None:
    styles = further_styles(11, 6)
    assert list(styles) == [f"action_{number}" for number in range(5, 11)]
    assert styles == further_styles(11, 6)
    assert len(set(styles.values())) == 6
    conditions = Conditions(styles={**STYLES, **styles})
    counts = Counter(d.action for d in demonstrations(1, conditions))
    assert all(counts[action] == 50 for action in styles)
    assert {s.action for seed in range(5) for s in recording(seed, 20, conditions).segments} >= set(styles)


def test_movement_passes_its_via_point() -> None:
    style = Style(arch=0.0, bow=0.0, via=(0.03, -0.05, 0.08))
    for demonstration in demonstrations(1, Conditions(noise=0.0, sweep=0.0, styles={"fetch": style})):
        path = aligned(demonstration.trajectory)
        nearest = np.linalg.norm(path - path[-1] / 2 - style.via, axis=1).min()
        assert nearest < 0.01
