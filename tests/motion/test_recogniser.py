"""The recogniser as a stream: chunks, rates, gaps, refusals, memory, places."""

from __future__ import annotations

import tracemalloc
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.motion.errors import InvalidTrajectory, MotionError, RoleMissing
from app.motion.model import Model
from app.motion.recogniser import Event, Method, Recogniser, SegmentEvent, recognise
from app.motion.simulation import Conditions, recording
from app.motion.trajectory import Floats, Recording, Scene, Trajectory
from app.motion.window import Gap

METHODS: tuple[Method, ...] = ("viterbi", "steps", "greedy")

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


def actions_of(events: Sequence[Event]) -> list[str | None]:
    return [event.action for event in segments_of(events)]


def spans(events: Sequence[Event]) -> list[tuple[str | None, int, int]]:
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


def still_after(motion: Trajectory, seconds: float) -> Trajectory:
    """Return a motion at 100 Hz, and all that is there standing still behind it for a while [s]."""
    n = round(seconds * 100)
    tracks = {
        name: np.vstack([track, np.repeat(track[-1:], n, axis=0)]) for name, track in motion.objects.items()
    }
    hand = np.vstack([motion.hand, np.repeat(motion.hand[-1:], n, axis=0)])
    return Trajectory(np.arange(len(hand)) / 100, hand, tracks)


def joined(first: Trajectory, second: Trajectory, pause: float) -> Trajectory:
    """Return two motions one after the other, the second ``pause`` seconds after the first [s]."""
    return Trajectory(
        np.concatenate([first.times, second.times - second.times[0] + first.times[-1] + pause]),
        np.concatenate([first.hand, second.hand]),
        {name: np.concatenate([first.objects[name], second.objects[name]]) for name in first.objects},
    )


@pytest.mark.parametrize(("method", "off"), [("viterbi", 15), ("steps", 15), ("greedy", 30)])
def test_finds_the_actions(trained: Model, method: Method, off: int) -> None:
    events = recognise(trained, SHOWN.trajectory, method=method)
    assert actions_of(events) == truth(SHOWN)
    for event, segment in zip(segments_of(events), SHOWN.segments, strict=True):
        assert event.start == pytest.approx(segment.start, abs=off)
        assert event.end == pytest.approx(segment.end, abs=off)
        assert event.t_start == pytest.approx(event.start / 100, abs=0.01)
        assert event.t_end == pytest.approx(event.end / 100, abs=0.01)
        best, second, *_ = sorted(event.log_likelihoods.values(), reverse=True)
        assert event.action is not None
        assert event.log_likelihoods[event.action] == best > 0.0
        assert event.margin == best - second
        assert event.objects == {"object": "object"}


@LAW
@given(st.lists(st.integers(1, 300), min_size=1, max_size=6), st.sampled_from([SHOWN, HARD]))
def test_chunks_do_not_matter_to_the_last_bit(trained: Model, sizes: list[int], shown: Recording) -> None:
    assert chunked(Recogniser(trained), shown.trajectory, sizes) == recognise(trained, shown.trajectory)


@pytest.mark.parametrize("method", METHODS)
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


def aimless(seed: int, seconds: float) -> Trajectory:
    """Return motion at 100 Hz that is of no class, now and then without a hand."""
    rng, times = np.random.default_rng(seed), np.arange(round(seconds * 100)) / 100
    waves = rng.uniform(0.1, 1.5, (8, 1, 3)) * times[None, :, None] + rng.uniform(0.0, 1.0, (8, 1, 3))
    hand = 0.3 + 0.08 * np.sin(2 * np.pi * waves).sum(axis=0) + rng.normal(0.0, 0.001, (len(times), 3))
    hand[rng.random(len(hand)) < rng.uniform(0.0, 0.1)] = np.nan
    for start in rng.integers(0, len(hand), 4).tolist():
        hand[start : start + int(rng.integers(5, 450))] = np.nan
    return Trajectory(times, hand, {"object": np.broadcast_to([0.0, 0.3, 0.0], hand.shape)})


@LAW
@given(st.integers(0, 2**32 - 1), st.sampled_from([None, 0.3, 1.0]), st.booleans())
def test_segments_follow_each_other_whatever_comes(
    trained: Model, seed: int, bound: float | None, has_aim: bool
) -> None:
    motion = recording(seed, 8, Conditions(rest=(0.0, 0.3))).trajectory if has_aim else aimless(seed, 40.0)
    recogniser, events = Recogniser(trained, bound=bound), list[SegmentEvent]()
    for at in range(0, len(motion), 50):
        events += segments_of(recogniser.push(motion.part(at, min(at + 50, len(motion)))))
        if (told := recogniser.hypothesis()) is not None:
            assert sum(each.posterior for each in told.actions) == pytest.approx(1.0)
            assert 0 <= told.start <= told.through
    events += segments_of(recogniser.finish())
    assert all(0 <= event.start < event.end < len(motion) for event in events)
    assert all(one.end <= other.start for one, other in pairwise(events))
    for event in events:
        assert motion.times[event.start] == pytest.approx(event.t_start, abs=0.011)
        assert motion.times[event.end] == pytest.approx(event.t_end, abs=0.011)
        assert np.isfinite(event.novelty)


@pytest.mark.parametrize("method", METHODS)
def test_memory_does_not_grow_with_the_stream(trained: Model, method: Method) -> None:
    shown = recording(31, 60).trajectory
    recogniser, sizes = Recogniser(trained, method=method), list[int]()
    tracemalloc.start()
    for at in range(0, len(shown) - 50, 50):
        recogniser.push(shown.part(at, at + 50))
        recogniser.hypothesis()
        if at % 1000 == 950:
            sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert len(sizes) >= 3
    assert sizes[-1] < sizes[0] + 2**18


@pytest.mark.parametrize("method", METHODS)
def test_a_long_stream_is_recognised_like_its_beginning(trained: Model, method: Method) -> None:
    """The same actions over and over: each time they are found, and in the end as soon as at first."""
    shown = recording(14, 3, Conditions(rest=(0.5, 0.5)))
    lap, recogniser = still_after(shown.trajectory, 2.0), Recogniser(trained, method=method)
    found, delays = list[SegmentEvent](), list[int]()
    for first in range(0, 20 * len(lap), len(lap)):
        again = Trajectory(lap.times + first / 100, lap.hand, lap.objects)
        for at in range(0, len(lap), 10):
            events = segments_of(recogniser.push(again.part(at, min(at + 10, len(lap)))))
            found += events
            delays += [first + at + 10 - each.end for each in events]
    found += segments_of(recogniser.finish())
    n = len(shown.segments)
    assert actions_of(found) == 20 * truth(shown)
    for one, other in zip(found, found[n:], strict=False):
        assert other.start - len(lap) == pytest.approx(one.start, abs=15)
        assert other.end - len(lap) == pytest.approx(one.end, abs=15)
    assert max(delays[-5 * n :]) <= max(delays[: 5 * n]) + 20


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
