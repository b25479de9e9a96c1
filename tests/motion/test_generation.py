"""Laws of generated movements, on models of the simulated protocol."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson

from app.formats.ros import multi_dof_joint_trajectory
from app.motion.asked import MAX_STEPS, MAX_VIA, Limits, Step, Via
from app.motion.errors import InvalidRequest, UnknownAction
from app.motion.features import BLEND, alignment, line
from app.motion.generation import GeneratedMotion, generate, generate_task, join
from app.motion.model import FeatureSpecification, Model
from app.motion.simulation import STYLES, demonstrations
from app.motion.training import TrainingOptions, conditioned, fit_model, observe
from app.motion.trajectory import Floats
from tests.formats.controller import faults

SPECIFICATION = FeatureSpecification(("object",))
START, GOAL = np.array([0.1, 0.3, 0.04]), np.array([-0.2, 0.25, 0.04])
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def model() -> Model:
    return fit_model(demonstrations(1), SPECIFICATION, TrainingOptions(n_states=8))


coordinates = st.floats(-3.0, 3.0)
points = st.tuples(coordinates, coordinates, coordinates).map(np.array)
actions = st.sampled_from(sorted(STYLES))


def turning(angle: float) -> Floats:
    """Return the (3, 3) rotation about up."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def level(start: Floats, goal: Floats) -> float:
    """Return how far a movement goes across the table [m]."""
    return float(np.hypot(*(goal - start)[:2]))


def along_x(length: float) -> Floats:
    """Return the goal that lies so far from START, across the table [m]."""
    return START + length * np.array([1.0, 0.0, 0.0])


def deviation(motion: GeneratedMotion) -> Floats:
    start, goal = motion.positions[0], motion.positions[-1]
    aligned: Floats = (motion.positions - line(start, goal, len(motion.times))) @ alignment(start, goal).T
    return aligned


def demonstrated(action: str, phase: Floats) -> Floats:
    """Return the mean deviation (n, 3) of a class's demonstrations at equal phases [m]."""
    shapes = []
    for demonstration in demonstrations(1):
        if demonstration.action == action:
            shape = observe(conditioned(demonstration, SPECIFICATION), demonstration.scene.table_height)[
                :, :3
            ]
            at = np.linspace(0.0, 1.0, len(shape))
            shapes.append([np.interp(phase, at, component) for component in shape.T])
    mean: Floats = np.mean(shapes, axis=0).T
    return mean


def mean_length(action: str) -> float:
    hands = [d.trajectory.hand for d in demonstrations(1) if d.action == action]
    return float(np.mean([np.linalg.norm(hand[-1] - hand[0]) for hand in hands]))


@given(actions, points, points, st.floats(20.0, 400.0), st.floats(0.2, 4.0))
def test_movements_go_from_rest_at_start_to_rest_at_goal(
    model: Model, action: str, start: Floats, goal: Floats, rate: float, duration: float
) -> None:
    assume(np.linalg.norm(goal - start) >= BLEND)
    motion = generate(model, action, start, goal, rate=rate, duration=duration)
    np.testing.assert_array_equal(motion.positions[[0, -1]], [start, goal])
    np.testing.assert_array_equal(motion.velocities[[0, -1]], np.zeros((2, 3)))
    np.testing.assert_array_equal(motion.std[[0, -1]], np.zeros((2, 3)))
    for values in (motion.positions, motion.velocities, motion.accelerations, motion.std):
        assert values.shape == (len(motion.times), 3)
        assert np.isfinite(values).all()
    assert motion.times[0] == 0.0
    assert duration - 1e-3 / rate <= motion.times[-1] <= duration + 1.001 / rate
    np.testing.assert_allclose(np.diff(motion.times), 1.0 / rate, rtol=1e-6)


@given(actions, points, points, points)
def test_moving_both_ends_moves_everything(
    model: Model, action: str, start: Floats, goal: Floats, by: Floats
) -> None:
    assume(level(start, goal) >= 0.02)
    here, there = generate(model, action, start, goal), generate(model, action, start + by, goal + by)
    np.testing.assert_allclose(there.positions, here.positions + by, atol=1e-9)
    np.testing.assert_allclose(there.velocities, here.velocities, atol=1e-9)
    np.testing.assert_allclose(there.std, here.std, atol=1e-9)


@given(actions, points, points, st.floats(-np.pi, np.pi))
def test_turning_both_ends_about_up_turns_everything(
    model: Model, action: str, start: Floats, goal: Floats, angle: float
) -> None:
    assume(level(start, goal) >= 0.02)
    turn = turning(angle)
    here, there = generate(model, action, start, goal), generate(model, action, turn @ start, turn @ goal)
    np.testing.assert_allclose(there.positions, here.positions @ turn.T, atol=1e-9)
    np.testing.assert_allclose(there.velocities, here.velocities @ turn.T, atol=1e-8)
    np.testing.assert_allclose(there.accelerations, here.accelerations @ turn.T, atol=1e-7)


@settings(max_examples=25)
@given(actions, points, points)
def test_velocities_and_accelerations_are_those_of_the_positions(
    model: Model, action: str, start: Floats, goal: Floats
) -> None:
    assume(np.linalg.norm(goal - start) >= BLEND)
    motion = generate(model, action, start, goal, rate=500.0)
    travelled = cumulative_simpson(motion.velocities, x=motion.times, axis=0, initial=0.0)
    np.testing.assert_allclose(motion.positions - start, travelled, atol=1e-5)
    gained = cumulative_simpson(motion.accelerations, x=motion.times, axis=0, initial=0.0)
    np.testing.assert_allclose(motion.velocities, gained, atol=1e-4)


@pytest.mark.parametrize("action", sorted(STYLES))
def test_rate_samples_one_and_the_same_movement(model: Model, action: str) -> None:
    coarse = generate(model, action, START, GOAL, rate=50.0, duration=0.9)
    fine = generate(model, action, START, GOAL, rate=500.0, duration=0.9)
    for name in ("times", "positions", "velocities", "accelerations", "std"):
        np.testing.assert_allclose(getattr(fine, name)[::10], getattr(coarse, name), atol=1e-9)


@pytest.mark.parametrize("action", sorted(STYLES))
def test_duration_stretches_time_and_nothing_else(model: Model, action: str) -> None:
    fast = generate(model, action, START, GOAL, rate=200.0, duration=0.5)
    slow = generate(model, action, START, GOAL, rate=100.0, duration=1.0)
    np.testing.assert_allclose(fast.positions, slow.positions, atol=1e-12)
    np.testing.assert_allclose(fast.velocities, 2 * slow.velocities, atol=1e-12)
    np.testing.assert_allclose(fast.accelerations, 4 * slow.accelerations, atol=1e-12)


@pytest.mark.parametrize("action", sorted(STYLES))
def test_shape_is_that_of_the_demonstrations(model: Model, action: str) -> None:
    phase = np.linspace(0.0, 1.0, 101)
    goal = along_x(mean_length(action))
    motion = generate(model, action, START, goal, rate=100.0, duration=1.0)
    error = np.linalg.norm(deviation(motion) - demonstrated(action, phase), axis=1)
    assert np.sqrt(np.mean(error**2)) < 0.01


@pytest.mark.parametrize("length", [0.1, 0.25, 0.6])
@pytest.mark.parametrize(("action", "height"), [("grasp", 0.06), ("displace", 0.13), ("retract", 0.05)])
def test_arch_keeps_its_height_at_any_length(model: Model, action: str, height: float, length: float) -> None:
    motion = generate(model, action, START, along_x(length))
    assert motion.positions[:, 2].max() - START[2] == pytest.approx(height, rel=0.2)


def test_push_stays_on_the_table(model: Model) -> None:
    motion = generate(model, "push", START, GOAL)
    assert np.abs(motion.positions[:, 2] - START[2]).max() < 0.003


@pytest.mark.parametrize("action", sorted(STYLES))
@pytest.mark.parametrize("length", [0.15, 0.4, 1.0, 3.0])
def test_hand_never_turns_back_along_the_line(model: Model, action: str, length: float) -> None:
    motion = generate(model, action, START, along_x(length))
    assert np.diff(motion.positions[:, 0]).min() >= -1e-4 * length


@given(actions, points, points, st.floats(-np.pi, np.pi))
def test_standard_deviation_turns_with_the_movement(
    model: Model, action: str, start: Floats, goal: Floats, angle: float
) -> None:
    assume(level(start, goal) >= 0.02)
    here, there, across = (
        generate(model, action, START, START + turning(turn) @ (goal - start)).std
        for turn in (0.0, angle, np.pi / 2)
    )
    np.testing.assert_allclose(np.sum(there**2, axis=1), np.sum(here**2, axis=1), atol=1e-9)
    np.testing.assert_allclose(there[:, 2], here[:, 2], atol=1e-9)
    np.testing.assert_allclose(across, here[:, [1, 0, 2]], atol=1e-9)


@pytest.mark.parametrize("rise", [-0.4, 0.01, 0.4])
def test_movement_straight_up_or_down_is_a_movement(model: Model, rise: float) -> None:
    motion = generate(model, "displace", START, START + rise * UP)
    np.testing.assert_array_equal(motion.positions[-1], START + rise * UP)
    assert np.linalg.norm(motion.positions - START, axis=1).max() < 0.5


@pytest.mark.parametrize("n_states", [1, 2, 3])
def test_few_states_are_enough(model: Model, n_states: int) -> None:
    coarse = fit_model(demonstrations(2), SPECIFICATION, TrainingOptions(n_states=n_states))
    motion = generate(coarse, "displace", START, GOAL)
    np.testing.assert_array_equal(motion.positions[[0, -1]], [START, GOAL])
    assert motion.positions[:, 2].max() - START[2] > 0.02


@pytest.mark.parametrize(
    ("field", "changed"),
    [
        ("start", {"start": [np.nan, 0.0, 0.0]}),
        ("start", {"start": [0.0, np.inf, 0.0]}),
        ("start", {"start": [0.0, 0.0]}),
        ("start", {"start": "here"}),
        ("goal", {"goal": [[0.0, 0.0, 0.0]]}),
        ("goal", {"goal": [250.0, 300.0, 40.0]}),
        ("goal", {"goal": START}),
        ("goal", {"goal": along_x(0.99 * BLEND)}),
        ("rate", {"rate": 0.0}),
        ("rate", {"rate": np.nan}),
        ("rate", {"rate": 1e6}),
        ("duration", {"duration": 0.0}),
        ("duration", {"duration": np.nan}),
        ("duration", {"duration": np.inf}),
        ("duration", {"duration": 1e4}),
        ("rate", {"rate": 1000.0, "duration": 600.0}),
        ("limits", {"limits": Limits(velocity=1e-4)}),
        ("limits", {"limits": Limits(acceleration=1e-7)}),
        ("rate", {"rate": 1000.0, "limits": Limits(velocity=3e-3)}),
        ("via", {"via": [Via(START, 0.5, 0.01)] * (MAX_VIA + 1)}),
        ("via", {"via": [Via(START, 0.5, 0.01)], "method": "paper"}),
        ("via.0.fraction", {"via": [Via(START, 0.0, 0.01)]}),
        ("via.1.fraction", {"via": [Via(START, 0.5, 0.01), Via(START, 1.0, 0.01)]}),
        ("via.0.fraction", {"via": [Via(START, np.nan, 0.01)]}),
        ("via.0.std", {"via": [Via(START, 0.5, 0.0)]}),
        ("via.0.std", {"via": [Via(START, 0.5, np.inf)]}),
        ("via.0.position", {"via": [Via([0.0, np.nan, 0.0], 0.5, 0.01)]}),
        ("via.1.position", {"via": [Via(START, 0.5, 0.01), Via([0.0, 0.0], 0.5, 0.01)]}),
        ("via.0.position", {"via": [Via([0.0, 500.0, 0.0], 0.5, 0.01)]}),
    ],
)
def test_impossible_request_is_refused_by_name(model: Model, field: str, changed: dict[str, Any]) -> None:
    with pytest.raises(InvalidRequest, match=f"^{field}: ") as refused:
        generate(model, "grasp", **{"start": START, "goal": GOAL, **changed})
    assert refused.value.field == field


def test_unknown_action_is_refused(model: Model) -> None:
    with pytest.raises(UnknownAction, match="juggle"):
        generate(model, "juggle", START, GOAL)


@pytest.mark.parametrize("action", sorted(STYLES))
@pytest.mark.parametrize("limits", [Limits(velocity=0.2), Limits(acceleration=0.5), Limits(0.3, 0.3)])
def test_limits_stretch_time_and_nothing_else(model: Model, action: str, limits: Limits) -> None:
    slow = generate(model, action, START, GOAL, rate=100.0, duration=0.8, limits=limits)
    assert [notice.code for notice in slow.notices].count("slowed") == 1
    n_periods = len(slow.times) - 1
    assert n_periods > 80
    fast = generate(model, action, START, GOAL, rate=n_periods / 0.8, duration=0.8)
    slower = slow.times[-1] / 0.8
    np.testing.assert_allclose(slow.positions, fast.positions, atol=1e-12)
    np.testing.assert_allclose(slow.velocities * slower, fast.velocities, atol=1e-9)
    np.testing.assert_allclose(slow.accelerations * slower**2, fast.accelerations, atol=1e-9)


def test_limits_that_are_kept_anyhow_change_nothing(model: Model) -> None:
    free, lax = (generate(model, "grasp", START, GOAL, limits=limits) for limits in (Limits(), Limits(9, 90)))
    np.testing.assert_array_equal(lax.positions, free.positions)
    np.testing.assert_array_equal(lax.times, free.times)
    assert lax.notices == free.notices


@given(actions, points, points, st.floats(0.2, 0.8), st.floats(1e-4, 0.02))
def test_point_asked_for_is_passed_as_near_as_it_says(
    model: Model, action: str, start: Floats, goal: Floats, fraction: float, std: float
) -> None:
    assume(np.linalg.norm(goal - start) >= BLEND)
    ends: dict[str, Any] = {"rate": 100.0, "duration": 1.0}
    frame = round(100 * fraction)
    free = generate(model, action, start, goal, **ends)
    point = free.positions[frame] + 0.02 * np.array([0.6, -0.48, 0.64])
    motion = generate(model, action, start, goal, via=[Via(point, frame / 100, std)], **ends)
    before, after = (np.linalg.norm(each.positions[frame] - point) for each in (free, motion))
    assert after < before
    closer = generate(model, action, start, goal, via=[Via(point, frame / 100, std / 10)], **ends)
    assert np.linalg.norm(closer.positions[frame] - point) < after
    assert (motion.std <= free.std + 1e-9).all()


def tour(rng: np.random.Generator, n_steps: int) -> tuple[Floats, list[Step]]:
    start, *goals = rng.uniform(-0.5, 0.5, (n_steps + 1, 3))
    return start, [Step(str(rng.choice(sorted(STYLES))), goal) for goal in goals]


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.sampled_from([20.0, 100.0, 333.0]))
def test_task_goes_on_from_rest_to_rest(model: Model, seed: int, n_steps: int, rate: float) -> None:
    start, steps = tour(np.random.default_rng(seed), n_steps)
    whole, ends = generate_task(model, start, steps, rate=rate)
    np.testing.assert_array_equal(whole.times, np.arange(len(whole.positions)) / rate)
    frames = np.rint(ends * rate).astype(int)
    assert (frames[-1], len(frames)) == (len(whole.times) - 1, n_steps)
    stops = [0, *frames]
    np.testing.assert_array_equal(whole.positions[stops], [start, *(step.goal for step in steps)])
    for values in (whole.velocities, whole.accelerations, whole.std):
        np.testing.assert_array_equal(values[stops], np.zeros((n_steps + 1, 3)))
    for (begin, end), step in zip(pairwise(stops), steps, strict=True):
        alone = generate(model, step.action, whole.positions[begin], step.goal, rate=rate)
        for name in ("positions", "velocities", "accelerations", "std"):
            np.testing.assert_array_equal(getattr(whole, name)[begin : end + 1], getattr(alone, name))
    moved = cumulative_simpson(whole.velocities, x=whole.times, axis=0, initial=0.0)
    np.testing.assert_allclose(whole.positions - start, moved, atol=0.01 if rate < 100.0 else 1e-4)


def test_notices_of_a_task_name_their_step(model: Model) -> None:
    motions = [generate(model, "grasp", START, GOAL), generate(model, "push", GOAL, GOAL + 2.0 * UP)]
    notices = join(motions, 100.0).notices
    for number, motion in enumerate(motions):
        expected = [(notice.code, f"step {number}: {notice.detail}") for notice in motion.notices]
        told = [(each.code, each.detail) for each in notices if each.detail.startswith(f"step {number}: ")]
        assert told == expected
    assert {"rise_far", "length_far"} <= {notice.code for notice in motions[1].notices}
    assert len(notices) == sum(len(motion.notices) for motion in motions)


@pytest.mark.parametrize(
    ("field", "steps", "changed"),
    [
        ("steps", [], {}),
        ("steps", [Step("grasp", GOAL), Step("grasp", START)] * (MAX_STEPS // 2 + 1), {}),
        ("steps.1.goal", [Step("grasp", GOAL), Step("push", GOAL)], {}),
        ("steps.0.duration", [Step("grasp", GOAL, duration=-1.0)], {}),
        ("steps.1.via.0.std", [Step("grasp", GOAL), Step("push", START, via=[Via(GOAL, 0.5, 0.0)])], {}),
        ("start", [Step("grasp", GOAL)], {"start": [np.nan, 0.0, 0.0]}),
        ("limits", [Step("grasp", GOAL)], {"limits": Limits(velocity=1e-5)}),
        ("rate", [Step("grasp", GOAL, 60.0), Step("push", START, 60.0)], {"rate": 1000.0}),
    ],
)
def test_bad_task_is_refused_by_name(model: Model, field: str, steps: list[Step], changed: Any) -> None:
    with pytest.raises(InvalidRequest) as refused:
        generate_task(model, **{"start": START, "steps": steps, **changed})
    assert refused.value.field == field


def between(rng: np.random.Generator, least: float, most: float) -> float:
    return float(np.exp(rng.uniform(np.log(least), np.log(most))))


def request(rng: np.random.Generator) -> dict[str, Any]:
    """Return what may be asked for, at a rate that makes it no more than about a hundred frames."""
    start, way = rng.uniform(-1.0, 1.0, 3), rng.normal(size=3)
    length = between(rng, 0.006, 3.0)
    goal = start + way * length / np.linalg.norm(way)
    velocity, acceleration = between(rng, 0.05, 5.0), between(rng, 0.05, 5.0)
    limited = rng.integers(1, 4)
    limits = Limits(velocity if limited & 1 else None, acceleration if limited & 2 else None)
    method = "paper" if rng.random() < 0.05 else "default"
    via = [
        Via(start + rng.random() * (goal - start) + rng.normal(0.0, 0.1, 3), rng.uniform(0.01, 0.99), std)
        for std in 10.0 ** rng.uniform(-5.0, -1.0, rng.integers(1, 4))
        if method == "default" and rng.random() < 0.3
    ]
    seconds = max(2.0 * length / velocity, np.sqrt(6.0 * length / acceleration))
    return {
        "action": str(rng.choice(sorted(STYLES))),
        "start": start,
        "goal": goal,
        "rate": max(1.0, min(between(rng, 1.0, 1000.0), 100.0 / seconds)),
        "duration": rng.uniform(0.05, 3.0) if rng.random() < 0.5 else None,
        "method": method,
        "via": via,
        "limits": limits,
    }


@pytest.mark.parametrize("seed", range(10))
def test_of_ten_thousand_requests_each_is_met_within_its_limits(model: Model, seed: int) -> None:
    rng, refused = np.random.default_rng(seed), list[str]()
    for number in range(1000):
        asked = request(rng)
        try:
            motion = generate(model, **asked)
        except InvalidRequest as error:
            refused.append(error.field)
            continue
        limits, rests = asked["limits"], asked["method"] == "default"
        kept = ((motion.velocities, limits.velocity), (motion.accelerations, limits.acceleration))
        for values, limit in kept:
            assert np.linalg.norm(values, axis=1).max() <= (limit or np.inf), asked
            assert not rests or (values[[0, -1]] == 0.0).all(), asked
        assert np.abs(motion.positions[[0, -1]] - [asked["start"], asked["goal"]]).max() <= 1e-9, asked
        assert np.isfinite(np.hstack([motion.positions, motion.accelerations, motion.std])).all(), asked
        assert motion.times[0] == 0.0, asked
        assert (np.diff(motion.times) > 0.0).all(), asked
        if number % 40 == 0:
            message = multi_dof_joint_trajectory(motion, "table")
            assert faults(message, allow_nonzero_velocity_at_trajectory_end=not rests) == [], asked
    assert set(refused) <= {"limits", "rate"}
    assert len(refused) < 20
