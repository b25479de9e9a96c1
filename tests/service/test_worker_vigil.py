"""Who is dead, by the clock of who watches; and what is tried again."""

from __future__ import annotations

import threading

import pytest

from app.registry.errors import DatabaseUnavailable
from app.service import patience
from app.service.patience import Leaving, patiently
from app.service.vigil import DEAD_S, Pulses

STILL = DEAD_S + 0.1


def test_whose_beats_stand_still_is_dead() -> None:
    pulses = Pulses()
    assert pulses.dead({"one": 7, "two": 1}, 100.0) == set()
    assert pulses.dead({"one": 8, "two": 1}, 100.0 + DEAD_S) == set()
    assert pulses.dead({"one": 8, "two": 1}, 100.0 + STILL) == {"two"}
    assert pulses.dead({"one": 8}, 101.0 + DEAD_S) == set()
    assert pulses.dead({"one": 9, "two": 1}, 100.0 + 2 * STILL) == set(), "two is new"


def test_a_watcher_that_was_paused_itself_takes_nobody_for_dead() -> None:
    pulses = Pulses()
    pulses.dead({"one": 7}, 100.0)
    assert pulses.dead({"one": 60}, 160.0) == set()
    pulses.forget()
    assert pulses.dead({"one": 60}, 260.0) == set()
    assert pulses.dead({"one": 60}, 260.0 + STILL) == {"one"}


class Failing:
    """Fails so many times."""

    def __init__(self, times: int, error: Exception) -> None:
        self.times = times
        self.error = error

    def __call__(self) -> str:
        if self.times:
            self.times -= 1
            raise self.error
        return "done"


AWAY = [DatabaseUnavailable("away"), OSError("no space left")]


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patience, "FIRST_S", 1e-4)
    monkeypatch.setattr(patience, "BOUND_S", 0.05)


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("error", AWAY)
def test_what_fails_for_the_moment_is_tried_again_but_not_for_ever(error: Exception) -> None:
    assert patiently(Failing(3, error), threading.Event()) == "done"
    with pytest.raises(type(error)):
        patiently(Failing(10**6, error), threading.Event())


def test_what_fails_for_good_is_not_tried_again() -> None:
    failing = Failing(2, ValueError("wrong"))
    with pytest.raises(ValueError, match="wrong"):
        patiently(failing, threading.Event())
    assert failing.times == 1


def test_a_worker_that_leaves_does_not_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patience, "FIRST_S", patience.BOUND_S / 2)
    leaving = threading.Event()
    leaving.set()
    with pytest.raises(Leaving):
        patiently(Failing(10**6, AWAY[0]), leaving)
