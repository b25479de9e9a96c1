"""Training: what it refuses and names, what it never gives, and training further."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.motion.baum_welch import COMPILED, Chain, log_likelihoods, repetition, train_chain
from app.motion.by_hmmlearn import HMMLEARN
from app.motion.errors import FitFailed, RoleMissing, UnusableDemonstration
from app.motion.model import N_OF_MOVEMENT, N_OF_ROLE, PACE, PHASE, ActionModel, FeatureSpecification, Model
from app.motion.simulation import demonstrations
from app.motion.training import (
    BACKGROUND,
    CONTEXT_SHARE,
    MIN_FRAMES,
    PACE_FLOOR,
    PHASE_FLOOR,
    STATES,
    TrainingOptions,
    check_demonstration,
    conditioned,
    fit_model,
    observe,
)
from app.motion.trajectory import Demonstration, Floats, Trajectory

LAW = settings(derandomize=True, deadline=None, max_examples=15)

SPECIFICATION = FeatureSpecification(("object",))
FOUR = TrainingOptions(n_states=4)


def reach(
    n_frames: int = 60, goal: Sequence[float] = (0.3, 0.0, 0.0), noise: float = 0.002, seed: int = 0
) -> Demonstration:
    """Return a straight reach for an object at 100 Hz."""
    fraction = np.linspace(0.0, 1.0, n_frames)[:, None]
    trembling = np.random.default_rng(seed).normal(0.0, noise, (n_frames, 3))
    hand = np.array(goal) * fraction + trembling
    objects = {"object": np.broadcast_to(np.array(goal), hand.shape)}
    return Demonstration("reach", Trajectory(np.arange(n_frames) / 100.0, hand, objects))


def without_hand(shown: Demonstration, missing: slice | Sequence[int]) -> Demonstration:
    hand = shown.trajectory.hand.copy()
    hand[missing] = np.nan
    return replace(shown, trajectory=replace(shown.trajectory, hand=hand))


def few(seed: int, n: int, actions: Sequence[str] = ("grasp", "push")) -> list[Demonstration]:
    """Return n simulated demonstrations of each of these classes, class by class."""
    result: list[Demonstration] = []
    for action in actions:
        of_class = [shown for shown in demonstrations(seed) if shown.action == action]
        result += [of_class[at] for at in np.random.default_rng(seed).permutation(len(of_class))[:n]]
    return result


def equal(one: ActionModel, other: ActionModel) -> bool:
    return all(np.array_equal(getattr(one, part.name), getattr(other, part.name)) for part in fields(one))


@pytest.mark.parametrize(
    ("spoiled", "why"),
    [
        (reach(n_frames=10), f"has 10 frames, needs at least {MIN_FRAMES}"),
        (reach(n_frames=15), "lasts 0.140 s"),
        (reach(goal=(0.0, 0.0, 0.0), noise=1e-4), "starts and ends at the same point"),
        (without_hand(reach(), slice(10, 45)), "35 of its 60 frames are dropouts"),
        (without_hand(reach(), [0]), "first frame is a dropout"),
        (without_hand(reach(), [-1]), "last frame is a dropout"),
    ],
)
def test_a_demonstration_that_teaches_nothing_is_named(spoiled: Demonstration, why: str) -> None:
    with pytest.raises(UnusableDemonstration, match=why) as raised:
        fit_model([reach(seed=1), reach(seed=2), spoiled], SPECIFICATION, FOUR)
    assert (raised.value.index, raised.value.action) == (2, "reach")
    with pytest.raises(UnusableDemonstration, match=why):
        check_demonstration(2, spoiled, SPECIFICATION)


def test_a_missing_role_is_named() -> None:
    with pytest.raises(RoleMissing) as raised:
        fit_model([reach(), reach(seed=1)], FeatureSpecification(("object", "cup")), FOUR)
    assert raised.value.role == "cup"


def test_one_demonstration_has_no_spread() -> None:
    with pytest.raises(FitFailed, match="'push': has 1 demonstration") as raised:
        fit_model([*few(0, 3, ["grasp"]), *few(0, 1, ["push"])], SPECIFICATION, FOUR)
    assert raised.value.action == "push"


def test_more_states_than_frames_are_refused_by_name() -> None:
    shown = [reach(n_frames=100), reach(n_frames=40, seed=1)]
    with pytest.raises(UnusableDemonstration, match=r"has 20 usable frames .* at least 30") as raised:
        fit_model(shown, SPECIFICATION, TrainingOptions(n_states=30))
    assert raised.value.index == 1


@LAW
@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.sampled_from([0.0, 1e-6, 0.002, 0.05]))
def test_parameters_are_always_numbers(seed: int, n_states: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    shown = [
        reach(int(rng.integers(30, 80)), rng.uniform(0.1, 0.5, 3).tolist(), noise, int(rng.integers(99)))
        for _ in range(rng.integers(2, 5))
    ]
    shown[0] = without_hand(shown[0], rng.integers(5, 20, 4).tolist())
    model = fit_model(shown, SPECIFICATION, TrainingOptions(n_states=n_states))
    for part in fields(ActionModel):
        if part.name != "action":
            assert np.isfinite(getattr(model.actions[0], part.name)).all(), part.name
    assert np.isfinite(model.background.width).all()
    assert (model.actions[0].stay >= 0.0).all()
    assert (model.actions[0].stay < 1.0).all()
    assert 0.0 < model.evidence <= 1.0


def test_demonstrations_that_are_all_alike_have_floored_spread() -> None:
    options = TrainingOptions(n_states=4, deviation_floor=0.01)
    [action] = fit_model([reach(noise=0.0)] * 3, SPECIFICATION, options).actions
    spreads = np.sqrt(action.variances)
    context = 0.01 * CONTEXT_SHARE
    floors = [0.01, 0.01, 0.01, context, PACE_FLOOR, PHASE_FLOOR, context, PACE_FLOOR]
    assert (spreads >= np.array(floors) - 1e-12).all()
    np.testing.assert_allclose(spreads[:, [1, N_OF_MOVEMENT + 1]], [[0.01, PACE_FLOOR]] * 4)


def test_the_background_is_as_wide_as_all_demonstrations_and_more() -> None:
    shown = few(0, 5)
    frames = np.concatenate([observe(conditioned(each, SPECIFICATION), 0.0) for each in shown])
    model, floored = fit_model(shown, SPECIFICATION, FOUR), [N_OF_MOVEMENT + 1]
    np.testing.assert_allclose(
        np.delete(model.background.width, floored), BACKGROUND * np.delete(frames.std(axis=0), floored)
    )
    assert (model.background.width[floored] >= BACKGROUND * PACE_FLOOR).all()


def test_features_are_those_of_the_whole_movement_in_time() -> None:
    shown = without_hand(reach(noise=0.0), slice(20, 30))
    features = observe(conditioned(shown, SPECIFICATION), -0.5)
    assert features.shape[1] == SPECIFICATION.n_features
    assert len(features) == pytest.approx(30 - 5, abs=1)
    np.testing.assert_allclose(features[:, :3], 0.0, atol=0.02)
    np.testing.assert_allclose(features[:, 3], 0.5, atol=0.02)
    np.testing.assert_allclose(features[:, PACE], np.log1p(0.3 / 0.59 / SPECIFICATION.still), atol=1e-9)
    phase = features[:, PHASE]
    assert (phase[0], phase[-1]) == (0.0, 1.0)
    assert np.diff(phase).max() == pytest.approx(6 / 29, abs=0.05)
    distance, pace_of_object = features[:, N_OF_MOVEMENT : N_OF_MOVEMENT + N_OF_ROLE].T
    np.testing.assert_allclose(distance, 0.3 * (1.0 - phase), atol=0.02)
    np.testing.assert_allclose(pace_of_object, 0.0, atol=1e-9)


def test_a_demonstration_ends_with_the_last_point_that_is_seen() -> None:
    """At 50 Hz the last point of 60 frames at 100 Hz lies beyond the last frame but one, a dropout."""
    shown = without_hand(reach(60), [-2, -3])
    tracks = conditioned(shown, SPECIFICATION)
    assert not np.isnan(tracks.hand[[0, -1]]).any()
    assert len(tracks.hand) == len(tracks.pace) == tracks.objects.shape[1] == tracks.paces.shape[1]
    assert len(tracks.hand) == pytest.approx(30, abs=2)


def test_durations_and_lengths_are_those_of_the_demonstrations() -> None:
    shown = [without_hand(reach(60), slice(20, 30)), reach(80, (0.0, 0.5, 0.0), seed=1)]
    [action] = fit_model(shown, SPECIFICATION, FOUR).actions
    np.testing.assert_allclose(action.durations, [0.59, 0.79])
    np.testing.assert_allclose(action.lengths, [0.3, 0.5], atol=0.01)
    assert action.n_demonstrations == 2


def test_the_number_of_states_is_chosen_from_the_demonstrations() -> None:
    rng = np.random.default_rng(3)
    straight = [reach(noise=0.01, seed=seed) for seed in range(6)]
    bent = []
    for seed in range(6):
        shown = reach(120, (0.4, 0.0, 0.0), noise=0.0, seed=seed)
        waves = 0.1 * np.sin(np.linspace(0.0, 4 * np.pi, 120))[:, None] * [0.0, 1.0, 1.0]
        hand = shown.trajectory.hand + waves + rng.normal(0.0, 0.001, (120, 3))
        bent.append(Demonstration("wave", replace(shown.trajectory, hand=hand)))
    wave, plain = (fit_model(of, SPECIFICATION, TrainingOptions()).actions[0] for of in (bent, straight))
    assert {wave.n_states, plain.n_states} <= set(STATES)
    assert wave.n_states >= plain.n_states
    assert fit_model(bent, SPECIFICATION, TrainingOptions(n_states=5)).actions[0].n_states == 5


def test_a_short_action_has_fewer_states_than_half_its_frames() -> None:
    shown = [reach(25, seed=seed) for seed in range(4)]
    [action] = fit_model(shown, SPECIFICATION, TrainingOptions()).actions
    assert action.n_states <= 13 // 2


@LAW
@given(st.integers(0, 2**32 - 1), st.integers(2, 6))
def test_training_does_not_explain_worse(seed: int, n_states: int) -> None:
    rng = np.random.default_rng(seed)
    sequences = [rng.normal(0.0, 1.0, (rng.integers(20, 40), 3)).cumsum(axis=0) for _ in range(4)]
    parts = [np.concatenate(of) for of in zip(*(np.array_split(s, n_states) for s in sequences), strict=True)]
    initial = Chain(
        np.array([of.mean(axis=0) for of in parts]),
        np.array([of.var(axis=0) for of in parts]) + 1e-3,
        np.full(n_states, 0.8),
        np.array([float(len(of)) for of in parts]),
    )
    trained = train_chain(sequences, initial, np.full(3, 1e-3))
    before, after = (log_likelihoods(sequences, chain).sum() for chain in (initial, trained))
    assert after >= before - 1e-6 * abs(before)


def test_frames_repeat_themselves_as_often_as_they_are_told() -> None:
    rng = np.random.default_rng(4)
    chain = Chain(np.zeros((1, 2)), np.ones((1, 2)), np.array([0.99]), np.ones(1))
    fresh = [rng.normal(size=(100, 2)) for _ in range(400)]
    assert repetition(fresh, chain) == pytest.approx(1.0, abs=0.15)
    assert repetition([np.repeat(each, 7, axis=0) for each in fresh], chain) == pytest.approx(7.0, rel=0.15)
    assert repetition([np.zeros((50, 2))], chain) == 1.0


def test_many_classes_count_as_evidence_by_their_demonstrations() -> None:
    model = fit_model(few(0, 4), SPECIFICATION, FOUR)
    grasp, push = model.actions
    mean = (grasp.repetition + push.repetition) / 2
    assert model.evidence == pytest.approx(4 / model.features.n_features / mean)
    twice = replace(grasp, durations=np.tile(grasp.durations, 2))
    mean = (2 * grasp.repetition + push.repetition) / 3
    assert replace(model, actions=(twice, push)).evidence == pytest.approx(
        4 / model.features.n_features / mean
    )


def test_the_same_seed_gives_the_same_model() -> None:
    shown = few(1, 4)
    one, other = (fit_model(shown, SPECIFICATION, TrainingOptions(seed=7)) for _ in range(2))
    assert all(map(equal, one.actions, other.actions))
    np.testing.assert_array_equal(one.background.width, other.background.width)


@pytest.fixture(scope="module")
def base() -> Model:
    """A model of six demonstrations of grasping and six of pushing, the first ones of ``few(2, 12)``."""
    return fit_model([*few(2, 12)[:6], *few(2, 12)[12:18]], SPECIFICATION, FOUR)


def test_a_class_with_nothing_new_keeps_its_action_model(base: Model) -> None:
    shown = [*few(2, 12)[:6], *few(2, 12)[12:]]
    further = fit_model(shown, SPECIFICATION, FOUR, base, learned=range(12))
    assert further.action("grasp") is base.action("grasp")
    assert further.action("push").n_demonstrations == 12
    assert not equal(further.action("push"), base.action("push"))


def test_training_further_comes_close_to_training_on_all(base: Model) -> None:
    shown = few(2, 12)
    order = [*range(6), *range(12, 18), *range(6, 12), *range(18, 24)]
    further = fit_model([shown[at] for at in order], SPECIFICATION, FOUR, base, learned=range(12))
    at_once = fit_model(shown, SPECIFICATION, FOUR)
    for one, other, before in zip(further.actions, at_once.actions, base.actions, strict=True):
        deviation = np.sqrt(other.variances)
        off, off_before = (np.abs((each.means - other.means) / deviation).mean() for each in (one, before))
        assert off < min(0.15, off_before)
        assert np.abs(np.log(one.variances / other.variances)).mean() < 0.3
        np.testing.assert_allclose(one.weights.sum(), other.weights.sum())
        np.testing.assert_allclose(np.sort(one.durations), np.sort(other.durations))
        np.testing.assert_allclose(np.sort(one.lengths), np.sort(other.lengths))
        assert one.repetition == pytest.approx(other.repetition, rel=0.5)


def test_through_hmmlearn_the_model_is_the_same() -> None:
    """Numbers of states are chosen, and one class is trained further."""
    shown, options = few(3, 9), TrainingOptions()
    first = fit_model(shown[:15], SPECIFICATION, options)
    ours, theirs = (
        fit_model(shown, SPECIFICATION, options, first, range(15), estimator=estimator)
        for estimator in (COMPILED, HMMLEARN)
    )
    afresh = fit_model(shown, SPECIFICATION, options, estimator=HMMLEARN).action("grasp")
    assert ours.action("grasp").n_states == afresh.n_states
    for one, other in [*zip(ours.actions, theirs.actions, strict=True), (first.action("grasp"), afresh)]:
        for part in ("means", "variances", "stay", "weights", "durations", "lengths", "repetition"):
            np.testing.assert_allclose(getattr(one, part), getattr(other, part), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(ours.familiarity.typical, theirs.familiarity.typical, rtol=1e-8)
    np.testing.assert_array_equal(ours.background.width, theirs.background.width)


def test_a_class_that_lost_a_demonstration_is_trained_afresh(base: Model) -> None:
    shown = [*few(2, 12)[1:6], *few(2, 12)[12:18]]
    further = fit_model(shown, SPECIFICATION, FOUR, base, learned=range(11))
    assert equal(further.action("grasp"), fit_model(shown[:5], SPECIFICATION, FOUR).actions[0])
    assert further.action("push") is base.action("push")


def test_a_new_class_joins_those_that_were_there(base: Model) -> None:
    shown = [*few(2, 12)[:6], *few(2, 12)[12:18], *few(2, 3, ["retract"])]
    further = fit_model(shown, SPECIFICATION, FOUR, base, learned=range(12))
    assert further.names == ("grasp", "push", "retract")
    assert further.action("grasp") is base.action("grasp")


def test_what_is_too_short_to_train_further_on_is_named() -> None:
    long = fit_model([reach(100), reach(100, seed=1)], SPECIFICATION, TrainingOptions(n_states=30))
    shown = [reach(100), reach(100, seed=1), reach(40, seed=2)]
    with pytest.raises(UnusableDemonstration, match="has 20 usable frames") as raised:
        fit_model(shown, SPECIFICATION, TrainingOptions(n_states=30), long, learned=range(2))
    assert raised.value.index == 2


def test_progress_is_told_and_may_end_the_training() -> None:
    told: list[tuple[int, int, str]] = []
    fit_model(few(0, 3), SPECIFICATION, FOUR, progress=lambda *news: told.append(news))
    assert told == [(0, 2, "training grasp"), (1, 2, "training push"), (2, 2, "trained")]

    class Cancelled(Exception):
        pass

    def cancel(done: int, total: int, message: str) -> None:
        if done == 1:
            raise Cancelled(message)

    with pytest.raises(Cancelled, match="training push"):
        fit_model(few(0, 3), SPECIFICATION, FOUR, progress=cancel)


def test_the_default_floor_does_not_hide_a_precise_hand() -> None:
    precise: Floats = fit_model(few(0, 10, ["push"]), SPECIFICATION, TrainingOptions()).actions[0].variances
    assert np.sqrt(precise[:, 2]).min() == pytest.approx(TrainingOptions().deviation_floor)
    assert np.sqrt(precise[:, 0]).max() > 2 * TrainingOptions().deviation_floor


@pytest.mark.parametrize("unit", [1e5, 1e12])
def test_times_in_a_wrong_unit_are_refused_by_name(unit: float) -> None:
    shown = reach()
    late = replace(shown, trajectory=replace(shown.trajectory, times=shown.trajectory.times * unit))
    with pytest.raises(UnusableDemonstration, match=r"^demonstration 1 .*wrong unit of time") as refused:
        fit_model([shown, late], SPECIFICATION, FOUR)
    assert refused.value.index == 1


def test_a_state_that_lasted_one_frame_may_last_longer_in_what_comes() -> None:
    once = np.array([[0.0], [1.0], [1.0]])
    later = np.array([[0.0], [0.0], [0.0], [0.0], [1.0]])
    floor, start = (
        np.full(1, 1e-4),
        Chain(np.array([[0.0], [1.0]]), np.full((2, 1), 1e-4), *np.ones((2, 2)) / 2),
    )
    known = train_chain([once, once], start, floor)
    assert known.stay[0] == 0.0
    further = train_chain([later, later], known._replace(stay=np.maximum(known.stay, 0.1)), floor, known)
    np.testing.assert_allclose(further.weights, [10.0, 6.0])
