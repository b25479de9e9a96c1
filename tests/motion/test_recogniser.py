"""The recogniser as a stream: chunks, rates, gaps, refusals, memory, and the laws of its criterion."""

from __future__ import annotations

import tracemalloc
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.motion.criterion import PACE, Criterion
from app.motion.errors import InvalidTrajectory, MotionError, RoleMissing
from app.motion.model import FeatureSpecification, Model
from app.motion.recogniser import Event, Method, Recogniser, SegmentEvent, recognise
from app.motion.rest import LEFT, LEFT_AT, NEARER, movement, rests
from app.motion.scoring import score_segments, states_of
from app.motion.simulation import Conditions, demonstrations, recording
from app.motion.training import PHASE_FLOOR, TrainingOptions, fit_model
from app.motion.trajectory import Floats, Recording, Scene, Trajectory
from app.motion.window import Gap

LAW = settings(derandomize=True, deadline=None, max_examples=15)

SHOWN = recording(11, 5)
HARD = recording(12, 5, Conditions(outlier_share=0.01, gap_share=1.0, rest=(0.3, 1.5)))


def chunked(recogniser: Recogniser, motion: Trajectory, sizes: Sequence[int]) -> list[Event]:
    """Return the events of a stream cut into chunks of these sizes, over and over."""
    ends = np.minimum(np.cumsum(np.resize(sizes, len(motion))), len(motion))
    cuts = [0, *dict.fromkeys(ends.tolist())]
    events = [event for start, end in pairwise(cuts) for event in recogniser.push(motion.part(start, end))]
    return events + recogniser.finish()


def segments_of(events: Sequence[Event]) -> list[SegmentEvent]:
    return [event for event in events if isinstance(event, SegmentEvent)]


def actions_of(events: Sequence[Event]) -> list[str]:
    return [event.action for event in segments_of(events)]


def spans(events: Sequence[Event]) -> list[tuple[str, int, int]]:
    return [(event.action, event.start, event.end) for event in segments_of(events)]


def truth(shown: Recording) -> list[str | None]:
    return [segment.action for segment in shown.segments]


def changed(motion: Trajectory, hand: Floats | None = None, times: Floats | None = None) -> Trajectory:
    return Trajectory(
        motion.times if times is None else times, motion.hand if hand is None else hand, motion.objects
    )


def at_times(motion: Trajectory, times: Floats) -> Trajectory:
    """Return a motion as it would have been sampled at other times [s]."""

    def track(positions: Floats) -> Floats:
        return np.column_stack([np.interp(times, motion.times, axis) for axis in positions.T])

    return Trajectory(times, track(motion.hand), {k: track(v) for k, v in motion.objects.items()})


def moved(motion: Trajectory, rotation: Floats, shift: Sequence[float]) -> Trajectory:
    objects = {name: track @ rotation.T + shift for name, track in motion.objects.items()}
    return Trajectory(motion.times, motion.hand @ rotation.T + shift, objects)


def joined(first: Trajectory, second: Trajectory, pause: float) -> Trajectory:
    """Return two motions one after the other, the second ``pause`` seconds after the first [s]."""
    return Trajectory(
        np.concatenate([first.times, second.times - second.times[0] + first.times[-1] + pause]),
        np.concatenate([first.hand, second.hand]),
        {name: np.concatenate([first.objects[name], second.objects[name]]) for name in first.objects},
    )


@pytest.mark.parametrize(("method", "off"), [("steps", 15), ("greedy", 30)])
def test_finds_the_actions(trained: Model, method: Method, off: int) -> None:
    events = recognise(trained, SHOWN.trajectory, method=method)
    assert actions_of(events) == truth(SHOWN)
    for event, segment in zip(segments_of(events), SHOWN.segments, strict=True):
        assert event.start == pytest.approx(segment.start, abs=off)
        assert event.end == pytest.approx(segment.end, abs=off)
        assert event.t_start == pytest.approx(event.start / 100, abs=0.01)
        assert event.t_end == pytest.approx(event.end / 100, abs=0.01)
        best, second, *_ = sorted(event.log_likelihoods.values(), reverse=True)
        assert event.log_likelihoods[event.action] == best > 0.0
        assert event.margin == best - second


@LAW
@given(st.lists(st.integers(1, 300), min_size=1, max_size=6), st.sampled_from([SHOWN, HARD]))
def test_chunks_do_not_matter_to_the_last_bit(trained: Model, sizes: list[int], shown: Recording) -> None:
    assert chunked(Recogniser(trained), shown.trajectory, sizes) == recognise(trained, shown.trajectory)


@pytest.mark.parametrize("method", ["steps", "greedy"])
def test_single_frames_give_what_the_whole_gives(trained: Model, method: Method) -> None:
    one_by_one = chunked(Recogniser(trained, method=method), HARD.trajectory, [1])
    assert one_by_one == recognise(trained, HARD.trajectory, method=method)
    assert segments_of(one_by_one)


def test_events_come_in_order_while_the_stream_goes_on(trained: Model) -> None:
    recogniser, events, when = Recogniser(trained), list[SegmentEvent](), list[int]()
    shown = recording(13, 12).trajectory
    for at in range(len(shown)):
        found = segments_of(recogniser.push(shown.part(at, at + 1)))
        events += found
        when += [at] * len(found)
    assert len(events) >= 8
    assert all(one.end <= other.start for one, other in pairwise(events))
    assert all(at > event.end for at, event in zip(when, events, strict=True))
    longest = max(float(action.durations.max()) for action in trained.actions)
    assert max(at - event.end for at, event in zip(when, events, strict=True)) < 400 * longest


@pytest.mark.parametrize("rate", [60.0, 120.0, 240.0])
def test_streams_of_other_rates_give_the_same_actions(trained: Model, rate: float) -> None:
    times = np.arange(0.0, SHOWN.trajectory.times[-1], 1.0 / rate)
    events = recognise(trained, at_times(SHOWN.trajectory, times))
    wanted = segments_of(recognise(trained, SHOWN.trajectory))
    assert actions_of(events) == truth(SHOWN)
    for event, same in zip(segments_of(events), wanted, strict=True):
        assert event.t_start == pytest.approx(same.t_start, abs=0.08)
        assert event.t_end == pytest.approx(same.t_end, abs=0.08)
        assert times[event.end] == pytest.approx(event.t_end, abs=1.0 / rate)


@LAW
@given(st.integers(0, 2**32 - 1))
def test_an_irregular_clock_gives_the_same_actions(trained: Model, seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.005, 0.015, round(SHOWN.trajectory.times[-1] * 100)))
    events = recognise(trained, at_times(SHOWN.trajectory, times[times < SHOWN.trajectory.times[-1]]))
    assert actions_of(events) == truth(SHOWN)


def test_a_dropout_is_a_gap_and_no_end_of_the_action(trained: Model) -> None:
    first = SHOWN.segments[0]
    middle = (first.start + first.end) // 2
    hand = SHOWN.trajectory.hand.copy()
    hand[middle - 10 : middle + 10] = np.nan
    events = recognise(trained, changed(SHOWN.trajectory, hand))
    [gap] = [event for event in events if isinstance(event, Gap)]
    assert (gap.start, gap.end) == (middle - 10, middle + 10)
    assert gap.seconds == pytest.approx(0.2)
    assert actions_of(events) == truth(SHOWN)


def test_a_stream_without_a_hand_is_one_gap(trained: Model) -> None:
    events = recognise(trained, changed(SHOWN.trajectory, np.full_like(SHOWN.trajectory.hand, np.nan)))
    [gap] = events
    assert isinstance(gap, Gap)
    assert (gap.start, gap.end) == (0, len(SHOWN.trajectory))


def test_no_segment_begins_or_ends_in_a_dropout(trained: Model) -> None:
    hand = HARD.trajectory.hand.copy()
    hand[np.random.default_rng(5).random(len(hand)) < 0.3] = np.nan
    events = segments_of(recognise(trained, changed(HARD.trajectory, hand)))
    assert events
    for event in events:
        near = hand[[max(event.start - 1, 0), event.start, event.start + 1]]
        assert not np.isnan(near).all()


def test_time_that_jumps_begins_a_new_search(trained: Model) -> None:
    first, second = recording(21, 3), recording(22, 3)
    motion = joined(first.trajectory, second.trajectory, pause=60.0)
    events, n_first = recognise(trained, motion), len(first.trajectory)
    assert actions_of(events) == truth(first) + truth(second)
    alone = spans(recognise(trained, first.trajectory))
    after = spans(recognise(trained, second.trajectory))
    assert spans(events) == alone + [(action, start + n_first, end + n_first) for action, start, end in after]
    [gap] = [event for event in events if isinstance(event, Gap)]
    assert (gap.start, gap.end) == (n_first, n_first)
    assert gap.seconds == pytest.approx(60.0)
    assert chunked(Recogniser(trained), motion, [7]) == events


def refused(trained: Model) -> list[tuple[Trajectory, type[MotionError]]]:
    """Return chunks that must not follow the first hundred frames."""
    late = SHOWN.trajectory.part(100, 120)
    return [
        (Trajectory(late.times, late.hand), RoleMissing),
        (Trajectory(late.times, late.hand, {"cup": late.objects["object"]}), RoleMissing),
        (SHOWN.trajectory.part(99, 110), InvalidTrajectory),
        (SHOWN.trajectory.part(0, 100), InvalidTrajectory),
    ]


def test_what_it_refuses_leaves_it_as_it_was(trained: Model) -> None:
    recogniser = Recogniser(trained)
    events = recogniser.push(SHOWN.trajectory.part(0, 100))
    for chunk, error in refused(trained):
        with pytest.raises(error):
            recogniser.push(chunk)
    events += recogniser.push(SHOWN.trajectory.part(100, len(SHOWN.trajectory)))
    assert events + recogniser.finish() == recognise(trained, SHOWN.trajectory)


def test_nothing_comes_of_nothing(trained: Model) -> None:
    recogniser = Recogniser(trained)
    assert recogniser.hypothesis() is None
    assert recogniser.finish() == []
    assert recognise(trained, SHOWN.trajectory.part(0, 1)) == []


def test_a_hand_at_rest_does_nothing(trained: Model) -> None:
    rng = np.random.default_rng(6)
    hand = np.array([0.2, 0.2, 0.1]) + rng.normal(0.0, 0.0005, (3000, 3))
    objects = {"object": hand - np.array([0.0, 0.0, 0.04])}
    assert recognise(trained, Trajectory(np.arange(3000) / 100.0, hand, objects)) == []


def test_memory_does_not_grow_with_the_stream(trained: Model) -> None:
    shown = recording(31, 60).trajectory
    recogniser, sizes = Recogniser(trained), list[int]()
    tracemalloc.start()
    for at in range(0, len(shown) - 50, 50):
        recogniser.push(shown.part(at, at + 50))
        if at % 1000 == 950:
            sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert len(sizes) >= 3
    assert sizes[-1] < sizes[0] + 2**18


@LAW
@given(st.floats(-np.pi, np.pi), st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)))
def test_where_the_table_stands_does_not_matter(
    trained: Model, turn: float, shift: tuple[float, float]
) -> None:
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    events = recognise(trained, moved(SHOWN.trajectory, rotation, (*shift, 0.0)))
    assert spans(events) == spans(recognise(trained, SHOWN.trajectory))


def test_the_height_of_the_table_is_that_of_the_scene(trained: Model) -> None:
    lifted = moved(SHOWN.trajectory, np.eye(3), (0.0, 0.0, 0.7))
    assert spans(recognise(trained, lifted, Scene(0.7))) == spans(recognise(trained, SHOWN.trajectory))


@pytest.mark.parametrize("unit", [10.0, 39.37])
def test_the_unit_of_length_does_not_matter(trained: Model, unit: float) -> None:
    units = np.append(np.full(trained.features.n_features - 1, unit), 1.0)
    actions = tuple(
        replace(
            action,
            means=units * action.means,
            variances=units**2 * action.variances,
            lengths=unit * action.lengths,
        )
        for action in trained.actions
    )
    width = units * trained.background.width
    model = replace(trained, actions=actions, background=replace(trained.background, width=width))
    events = recognise(model, moved(SHOWN.trajectory, unit * np.eye(3), (0.0, 0.0, 0.0)))
    wanted = recognise(trained, SHOWN.trajectory)
    assert spans(events) == spans(wanted)
    for event, same in zip(segments_of(events), segments_of(wanted), strict=True):
        assert event.log_likelihoods == pytest.approx(same.log_likelihoods, rel=1e-6)


@pytest.fixture(scope="module")
def in_decimetres() -> tuple[Model, Model]:
    """Models trained on the same demonstrations, in metres and as if a decimetre were one."""
    shown, floor = demonstrations(1)[::4], 0.0075
    specification = FeatureSpecification(("object",))
    bigger = [replace(d, trajectory=moved(d.trajectory, 10.0 * np.eye(3), (0.0, 0.0, 0.0))) for d in shown]
    metres, decimetres = (
        fit_model(of, specification, TrainingOptions(n_states=4, deviation_floor=unit * floor))
        for of, unit in ((shown, 1.0), (bigger, 10.0))
    )
    return metres, decimetres


def test_training_and_recognition_know_no_unit(in_decimetres: tuple[Model, Model]) -> None:
    metres, decimetres = in_decimetres
    bigger = moved(SHOWN.trajectory, 10.0 * np.eye(3), (0.0, 0.0, 0.0))
    assert spans(recognise(decimetres, bigger)) == spans(recognise(metres, SHOWN.trajectory))
    assert decimetres.evidence == pytest.approx(metres.evidence)
    assert np.sqrt(decimetres.actions[0].variances[:, -1]).min() >= PHASE_FLOOR


def test_hypotheses_are_shares_of_one(trained: Model) -> None:
    recogniser, told = Recogniser(trained), 0
    for at in range(0, len(SHOWN.trajectory) - 5, 5):
        recogniser.push(SHOWN.trajectory.part(at, at + 5))
        if (found := recogniser.hypothesis()) is not None:
            told += 1
            assert found.posteriors.keys() == {*trained.names, None}
            assert sum(found.posteriors.values()) == pytest.approx(1.0)
            assert all(0.0 <= value <= 1.0 for value in found.posteriors.values())
            assert all(0.0 <= value <= 1.0 for value in found.progress.values())
            assert 0 <= found.start <= found.through == at + 4
    assert told > 20


def test_a_hypothesis_comes_to_know_the_action(trained: Model) -> None:
    first = SHOWN.segments[0]
    recogniser = Recogniser(trained)
    recogniser.push(SHOWN.trajectory.part(0, first.end + 1))
    found = recogniser.hypothesis()
    assert found is not None
    assert max(found.posteriors, key=lambda action: found.posteriors[action]) == first.action
    assert found.posteriors[first.action] > 0.9


def minimum_jerk(seconds: float, before: float, after: float, noise: float = 0.0) -> Floats:
    """Return a movement of 0.3 m at 100 Hz with rest before and after [s]."""
    time = np.linspace(0.0, 1.0, round(seconds * 100) + 1)
    fraction = np.concatenate(
        [
            np.zeros(round(before * 100)),
            10 * time**3 - 15 * time**4 + 6 * time**5,
            np.ones(round(after * 100)),
        ]
    )
    trembling = np.random.default_rng(7).normal(0.0, noise, (len(fraction), 3))
    hand: Floats = np.array([0.3, 0.0, 0.0]) * fraction[:, None] + trembling
    return hand


def test_the_share_of_the_way_and_that_of_the_time_belong_together() -> None:
    assert pytest.approx(LEFT, abs=1e-4) == 10 * LEFT_AT**3 - 15 * LEFT_AT**4 + 6 * LEFT_AT**5


@pytest.mark.parametrize("noise", [0.0, 0.0005, 0.002])
@pytest.mark.parametrize(("before", "after"), [(0.0, 0.0), (0.5, 0.0), (0.0, 2.0), (1.0, 0.3)])
def test_a_movement_is_found_without_the_rest_beside_it(before: float, after: float, noise: float) -> None:
    first, last = movement(minimum_jerk(0.8, before, after, noise))
    assert first == pytest.approx(100 * before, abs=5)
    assert last == pytest.approx(100 * before + 80, abs=5)


def test_a_movement_does_not_end_in_a_dropout() -> None:
    hand = minimum_jerk(0.8, 1.0, 1.0)
    hand[97:105] = hand[175:183] = np.nan
    first, last = movement(hand)
    assert not np.isnan(hand[[first, last]]).any()
    assert (first, last) == pytest.approx((97, 182), abs=2)


@pytest.mark.parametrize("hand", [np.zeros((5, 3)), np.eye(3)[:2], np.zeros((2, 3))])
def test_what_hardly_moves_is_whole(hand: Floats) -> None:
    assert movement(hand) == (0, len(hand) - 1)


def test_an_action_goes_some_way(trained: Model) -> None:
    action = trained.action("grasp")
    least = float(action.lengths.min()) / NEARER
    assert rests(np.array([[0.0, 0.0, 0.0], [0.9 * least, 0.0, 0.0]]), action)
    assert not rests(np.array([[0.0, 0.0, 0.0], [1.1 * least, 0.0, 0.0]]), action)


def test_the_criterion_weighs_ratios_and_durations(trained: Model) -> None:
    hand = np.ascontiguousarray(SHOWN.trajectory.hand)
    objects = SHOWN.trajectory.objects["object"][None]
    segments = np.array([[0, 30], [0, 60], [10, 60], [40, 100]])
    criterion = Criterion(trained, 0.0)
    ratios = score_segments(hand, objects, 0.0, segments, states_of(trained))
    np.testing.assert_allclose(criterion.odds(hand, objects, segments), trained.evidence * ratios)
    seconds = (segments[:, 1] - segments[:, 0]) / trained.features.rate
    penalty = criterion.odds(hand, objects, segments) - criterion(hand, objects, segments)
    for action, of_class in zip(trained.actions, penalty.T, strict=True):
        logs = np.log(action.durations)
        off = (np.log(seconds) - logs.mean()) / max(logs.std(ddof=1), PACE)
        np.testing.assert_allclose(of_class, 0.5 * off**2, atol=1e-9)
