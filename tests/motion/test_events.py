"""What events and hypotheses tell beside where: novelty, unknown actions, who fills which role, goals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest

from app.motion.errors import InvalidRequest, RoleMissing
from app.motion.hypothesis import REST, Hypothesis
from app.motion.model import FeatureSpecification, Model
from app.motion.recogniser import Recogniser, SegmentEvent, recognise
from app.motion.simulation import Conditions, demonstrations, recording
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Demonstration, Floats, Recording, Segment, Trajectory

SHOWN = recording(11, 5)
PAUSED = [recording(40 + seed, 4, Conditions(rest=(0.3, 0.8))) for seed in range(6)]


def segments_of(model: Model, shown: Recording) -> list[SegmentEvent]:
    events = recognise(model, shown.trajectory)
    return [event for event in events if isinstance(event, SegmentEvent)]


def at_its_place(events: Sequence[SegmentEvent], true: Segment) -> SegmentEvent | None:
    """Return the event that overlaps a true segment the most, None if none overlaps half of it."""

    def shared(event: SegmentEvent) -> int:
        return min(event.end, true.end) - max(event.start, true.start)

    best = max(events, key=shared, default=None)
    return best if best is not None and 2 * shared(best) > true.end - true.start else None


def with_objects(motion: Trajectory, objects: dict[str, Floats]) -> Trajectory:
    return Trajectory(motion.times, motion.hand, objects)


def hypotheses(recogniser: Recogniser, motion: Trajectory, every: int = 5) -> Iterator[Hypothesis]:
    """Yield what is told after each so many frames."""
    for at in range(0, len(motion), every):
        recogniser.push(motion.part(at, min(at + every, len(motion))))
        if (found := recogniser.hypothesis()) is not None:
            yield found


@pytest.fixture(scope="module")
def without_grasp() -> Model:
    """A model that was never shown a grasp."""
    shown = [each for each in demonstrations(1) if each.action != "grasp"]
    return fit_model(shown, FeatureSpecification(("object",)), TrainingOptions(n_states=4))


def test_novelty_is_what_is_missing_to_what_is_typical(trained: Model) -> None:
    """It is low for what a model has learned: on average nothing is missing."""
    found = [event.novelty for shown in PAUSED for event in segments_of(trained, shown)]
    assert np.isfinite(found).all()
    assert abs(float(np.median(found))) < 0.25 * trained.familiarity.typical.mean()


def test_what_was_never_shown_is_unknown_or_novel(trained: Model, without_grasp: Model) -> None:
    taught, untaught, unknown = list[float](), list[float](), 0
    for shown in PAUSED:
        known, found = segments_of(trained, shown), segments_of(without_grasp, shown)
        for true in shown.segments:
            if true.action == "grasp":
                if (event := at_its_place(known, true)) is not None:
                    taught.append(event.novelty)
                event = at_its_place(found, true)
                unknown += event is None or event.action is None
                if event is not None:
                    untaught.append(event.novelty)
    assert len(taught) == len(PAUSED)
    assert not untaught or min(untaught) > max(taught)
    assert unknown + sum(value > 2 * max(taught) for value in untaught) >= len(PAUSED)


def test_what_is_less_than_the_least_of_its_class_is_unknown(trained: Model) -> None:
    strict = replace(trained.familiarity, least=np.full(len(trained.names), 1e3))
    events = segments_of(replace(trained, familiarity=strict), SHOWN)
    assert [event.action for event in events] == [None] * len(SHOWN.segments)
    as_before = segments_of(trained, SHOWN)
    assert [replace(event, action=None) for event in as_before] == events


def test_the_object_that_is_handled_is_named_whatever_its_name(trained: Model) -> None:
    """The role is of an object that the hand goes to and takes along; the others stand about."""
    rng, n = np.random.default_rng(3), len(SHOWN.trajectory)
    still = {f"box {at}": rng.uniform(-0.5, 0.5, 3) + np.zeros((n, 3)) for at in range(3)}
    cup = {"cup": SHOWN.trajectory.objects["object"]}
    events = [
        e
        for e in recognise(trained, with_objects(SHOWN.trajectory, still | cup))
        if isinstance(e, SegmentEvent)
    ]
    assert [event.action for event in events] == [each.action for each in SHOWN.segments]
    assert [event.objects for event in events] == [{"object": "cup"}] * len(events)


def test_a_model_without_roles_needs_no_objects() -> None:
    shown = [replace(each, trajectory=with_objects(each.trajectory, {})) for each in demonstrations(1)[::2]]
    model = fit_model(shown, FeatureSpecification(), TrainingOptions(n_states=4))
    events = segments_of(model, Recording(with_objects(SHOWN.trajectory, {}), SHOWN.segments))
    assert [event.action for event in events] == [each.action for each in SHOWN.segments]
    assert [event.objects for event in events] == [{}] * len(events)


def slowly(shown: Demonstration, factor: int) -> Demonstration:
    """Return a demonstration as another class, so many times as slow."""
    return Demonstration(
        f"{shown.action} slowly",
        Trajectory(shown.trajectory.times * factor, shown.trajectory.hand, shown.trajectory.objects),
    )


def test_short_actions_are_found_beside_classes_that_last_long() -> None:
    shown = demonstrations(1)[::3]
    slow = [slowly(each, 15) for each in shown[::4]]
    model = fit_model([*shown, *slow], FeatureSpecification(("object",)), TrainingOptions(n_states=4))
    found = [event.action for event in segments_of(model, SHOWN)]
    assert found == [each.action for each in SHOWN.segments]


def test_an_object_named_like_a_role_fills_it(trained: Model) -> None:
    beside = SHOWN.trajectory.objects["object"] + np.array([0.0, 1.0, 0.0])
    motion = with_objects(SHOWN.trajectory, {"cup": beside} | dict(SHOWN.trajectory.objects))
    assert recognise(trained, motion) == recognise(trained, SHOWN.trajectory)


def test_objects_that_cannot_fill_the_roles_are_refused_at_once(trained: Model) -> None:
    with pytest.raises(RoleMissing):
        Recogniser(trained, objects=())
    with pytest.raises(InvalidRequest):
        Recogniser(trained, objects=tuple(f"box {at}" for at in range(100)))


def test_hypotheses_are_shares_of_one(trained: Model) -> None:
    recogniser = Recogniser(trained, goals={"bin": np.array([0.2, 0.4, 0.05])})
    told = list(hypotheses(recogniser, SHOWN.trajectory))
    assert len(told) > 0.9 * len(SHOWN.trajectory) / 5
    for at, found in enumerate(told):
        assert {each.action for each in found.actions} == {*trained.names, None, REST}
        assert sum(each.posterior for each in found.actions) == pytest.approx(1.0)
        assert all(0.0 <= each.posterior <= 1.0 for each in found.actions)
        assert all(each.progress is None or 0.0 <= each.progress <= 1.0 for each in found.actions)
        assert 0 <= found.start <= found.through == min(5 * at + 4, len(SHOWN.trajectory) - 1)
        if found.goals:
            assert found.goals.keys() == {"object", "bin"}
            assert sum(found.goals.values()) == pytest.approx(1.0)


def test_asking_changes_nothing(trained: Model) -> None:
    asked, silent = Recogniser(trained), Recogniser(trained)
    events = []
    for at in range(0, len(SHOWN.trajectory), 3):
        events += asked.push(SHOWN.trajectory.part(at, min(at + 3, len(SHOWN.trajectory))))
        assert asked.hypothesis() == asked.hypothesis()
    assert events + asked.finish() == silent.push(SHOWN.trajectory) + silent.finish()


def test_a_hypothesis_comes_to_know_the_action_and_its_goal(trained: Model) -> None:
    first, motion = SHOWN.segments[0], SHOWN.trajectory
    recogniser = Recogniser(trained, goals={"elsewhere": motion.hand[first.end] + np.array([0.3, 0.0, 0.0])})
    recogniser.push(motion.part(0, round(first.start + 0.8 * (first.end - first.start))))
    found = recogniser.hypothesis()
    assert found is not None
    likely = found.actions[0]
    assert (likely.action, max(found.goals, key=lambda name: found.goals[name])) == (first.action, "object")
    assert likely.posterior > 0.8
    assert likely.progress == pytest.approx(0.8, abs=0.2)


def test_a_hand_at_rest_is_expected_to_rest(trained: Model) -> None:
    rng = np.random.default_rng(6)
    hand = np.array([0.2, 0.2, 0.1]) + rng.normal(0.0, 0.0005, (600, 3))
    motion = Trajectory(np.arange(600) / 100.0, hand, {"object": hand - np.array([0.0, 0.3, 0.04])})
    told = list(hypotheses(Recogniser(trained), motion))
    assert all(found.actions[0].action == REST for found in told)


def test_the_paper_knows_no_hypotheses(trained: Model) -> None:
    for method in ("steps", "greedy"):
        recogniser = Recogniser(trained, method=method)
        recogniser.push(SHOWN.trajectory)
        assert recogniser.hypothesis() is None


def test_after_a_jump_of_time_a_hypothesis_begins_after_it(trained: Model) -> None:
    motion, recogniser = SHOWN.trajectory, Recogniser(trained)
    recogniser.push(motion)
    late = Trajectory(
        motion.times[:4] + motion.times[-1] + 60.0, motion.hand[:4], {"object": motion.hand[:4]}
    )
    for at in range(4):
        recogniser.push(late.part(at, at + 1))
        found = recogniser.hypothesis()
        assert found is not None
        assert len(motion) <= found.start <= found.through == len(motion) + at
