"""Laws of generated movements, on models of the simulated protocol."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson

from app.motion.errors import InvalidRequest, UnknownAction
from app.motion.features import BLEND, alignment, line
from app.motion.generation import GeneratedMotion, generate, keypoint_phases
from app.motion.model import FeatureSpecification, Model
from app.motion.simulation import STYLES, demonstrations
from app.motion.training import TrainingOptions, conditioned, fit_model, observe
from app.motion.trajectory import Floats

SPECIFICATION = FeatureSpecification(("object",))
START, GOAL = np.array([0.1, 0.3, 0.04]), np.array([-0.2, 0.25, 0.04])
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def model() -> Model:
    return fit_model(demonstrations(1), SPECIFICATION, TrainingOptions(n_states=8))


@pytest.fixture(scope="module")
def chosen() -> Model:
    """A model whose numbers of states are chosen from the demonstrations."""
    return fit_model(demonstrations(1), SPECIFICATION, TrainingOptions())


coordinates = st.floats(-3.0, 3.0)
points = st.tuples(coordinates, coordinates, coordinates).map(np.array)
actions = st.sampled_from(sorted(STYLES))


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
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )
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


@pytest.mark.parametrize("action", sorted(STYLES))
def test_standard_deviation_is_that_of_the_states(chosen: Model, action: str) -> None:
    chain = chosen.action(action)
    motion = generate(chosen, action, START, along_x(0.3), rate=1000.0)
    frames = np.rint(keypoint_phases(chain) * (len(motion.times) - 1)).astype(int)
    of_states = np.sqrt(chain.variances[:, :3])
    assert (motion.std[frames] >= 0.95 * of_states).all()
    assert (motion.std[frames] <= 1.3 * of_states).all()


@given(actions, points, points)
def test_standard_deviation_turns_with_the_movement(
    model: Model, action: str, start: Floats, goal: Floats
) -> None:
    assume(np.linalg.norm(goal - start) >= BLEND)
    turned, straight = generate(model, action, start, goal), generate(model, action, START, GOAL)
    np.testing.assert_allclose(np.sum(turned.std**2, axis=1), np.sum(straight.std**2, axis=1), rtol=1e-9)


@pytest.mark.parametrize("action", sorted(STYLES))
def test_default_duration_is_what_the_self_transitions_imply(model: Model, action: str) -> None:
    chain = model.action(action)
    expected_frames = np.sum(1.0 / (1.0 - chain.stay))
    motion = generate(model, action, START, GOAL)
    assert motion.times[-1] == pytest.approx((expected_frames - 1) / SPECIFICATION.rate, rel=0.03)


@pytest.mark.parametrize("action", sorted(STYLES))
def test_keypoints_lie_in_order_within_the_movement(model: Model, action: str) -> None:
    phases = keypoint_phases(model.action(action))
    assert (np.diff([0.0, *phases, 1.0]) > 0).all()


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
        ("goal", {"goal": along_x(0.004)}),
        ("rate", {"rate": 0.0}),
        ("rate", {"rate": -100.0}),
        ("rate", {"rate": np.nan}),
        ("rate", {"rate": 1e6}),
        ("duration", {"duration": 0.0}),
        ("duration", {"duration": -1.0}),
        ("duration", {"duration": np.nan}),
        ("duration", {"duration": np.inf}),
        ("duration", {"duration": 1e4}),
        ("rate", {"rate": 1000.0, "duration": 600.0}),
    ],
)
def test_impossible_request_is_refused_by_name(model: Model, field: str, changed: dict[str, Any]) -> None:
    with pytest.raises(InvalidRequest, match=f"^{field}: ") as refused:
        generate(model, "grasp", **{"start": START, "goal": GOAL, **changed})
    assert refused.value.field == field


def test_unknown_action_is_refused(model: Model) -> None:
    with pytest.raises(UnknownAction, match="juggle"):
        generate(model, "juggle", START, GOAL)


@settings(max_examples=25)
@given(actions, points, points)
def test_the_plain_method_meets_its_ends_but_need_not_rest_there(
    model: Model, action: str, start: Floats, goal: Floats
) -> None:
    assume(np.linalg.norm(goal - start) >= BLEND)
    motion = generate(model, action, start, goal, rate=500.0, method="paper")
    np.testing.assert_array_equal(motion.positions[[0, -1]], [start, goal])
    assert np.isfinite(motion.std).all()
    travelled = cumulative_simpson(motion.velocities, x=motion.times, axis=0, initial=0.0)
    np.testing.assert_allclose(motion.positions - start, travelled, atol=1e-4)
    gained = cumulative_simpson(motion.accelerations, x=motion.times, axis=0, initial=0.0)
    np.testing.assert_allclose(motion.velocities - motion.velocities[0], gained, atol=1e-3)


@pytest.mark.parametrize("action", sorted(STYLES))
def test_the_plain_method_passes_near_the_keypoints(model: Model, action: str) -> None:
    chain = model.action(action)
    motion = generate(model, action, START, GOAL, rate=1000.0, method="paper")
    frames = np.rint(keypoint_phases(chain) * (len(motion.times) - 1)).astype(int)
    missed = np.abs(deviation(motion)[frames] - chain.means[:, :3])
    assert (missed <= 1.5 * np.sqrt(chain.variances[:, :3])).all()
    assert np.linalg.norm(motion.velocities[0]) > 0.01
