"""A recogniser that goes on from the state of another is that other, bit for bit."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.motion.errors import InvalidState
from app.motion.hypothesis import Hypothesis
from app.motion.model import Model
from app.motion.recogniser import Event, Recogniser
from app.motion.simulation import Conditions, recording
from app.motion.state import FORMAT, State
from app.motion.trajectory import Trajectory

HARD = recording(12, 5, Conditions(outlier_share=0.01, gap_share=1.0, rest=(0.3, 1.5))).trajectory
JUMP = Trajectory(HARD.times + 60.0 * (np.arange(len(HARD)) >= len(HARD) // 2), HARD.hand, HARD.objects)
"""A stream in which a minute is missing: its second half begins afresh."""


def streamed(
    model: Model, motion: Trajectory, cuts: Sequence[int], rate: float | None, *, handed_over: bool
) -> tuple[list[Event], list[Hypothesis | None]]:
    """Return what a stream gives; handed over, its recogniser is put away and made anew at every cut."""
    recogniser, events, guesses = Recogniser(model, rate=rate), list[Event](), list[Hypothesis | None]()
    for start, stop in pairwise([0, *sorted({*cuts, len(motion)})]):
        events += recogniser.push(motion.part(start, stop))
        guesses.append(recogniser.hypothesis())
        if handed_over:
            state = kept(recogniser.state())
            recogniser = Recogniser(model, rate=rate)
            recogniser.restore(state)
    return events + recogniser.finish(), guesses


def kept(state: State) -> State:
    """Return a state as it is after it was written down and read."""
    return {
        name: np.frombuffer(array.tobytes(), array.dtype).reshape(array.shape).copy()
        for name, array in state.items()
    }


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    cuts=st.lists(st.integers(1, len(HARD) - 1), min_size=1, max_size=6),
    rate=st.sampled_from([None, 100.0]),
    motion=st.sampled_from([HARD, JUMP]),
)
def test_events_and_hypotheses_do_not_know_of_it(
    trained: Model, cuts: list[int], rate: float | None, motion: Trajectory
) -> None:
    events, guesses = streamed(trained, motion, cuts, rate, handed_over=True)
    expected, believed = streamed(trained, motion, cuts, rate, handed_over=False)
    assert [repr(event) for event in events] == [repr(event) for event in expected]
    assert [repr(guess) for guess in guesses] == [repr(guess) for guess in believed]
    assert len(events) > 3


def test_at_every_single_frame(trained: Model) -> None:
    motion = HARD.part(0, 260)
    cuts = range(1, len(motion))
    found, expected = (streamed(trained, motion, cuts, 100.0, handed_over=way) for way in (True, False))
    assert repr(found) == repr(expected)


def test_what_comes_later_does_not_change_a_state(trained: Model) -> None:
    recogniser = Recogniser(trained, rate=100.0)
    recogniser.push(HARD.part(0, 150))
    state = recogniser.state()
    before = {name: array.tobytes() for name, array in state.items()}
    recogniser.push(HARD.part(150, len(HARD)))
    recogniser.hypothesis()
    assert {name: array.tobytes() for name, array in state.items()} == before


def test_a_state_is_small(trained: Model) -> None:
    recogniser = Recogniser(trained, rate=100.0)
    for start in range(0, len(HARD), 50):
        recogniser.push(HARD.part(start, start + 50))
        assert sum(array.nbytes for array in recogniser.state().values()) < 150_000


@pytest.mark.parametrize("broken", [{"format": np.array(FORMAT + 1)}, {"format": None}])
def test_another_format_is_refused(trained: Model, broken: dict[str, Any]) -> None:
    state = {**Recogniser(trained).state(), **broken}
    with pytest.raises(InvalidState):
        Recogniser(trained).restore({name: array for name, array in state.items() if array is not None})


def test_no_other_method_has_a_state(trained: Model) -> None:
    with pytest.raises(TypeError):
        Recogniser(trained, method="steps").state()
