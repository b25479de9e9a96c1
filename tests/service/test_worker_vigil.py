"""Who is dead, by the clock of who watches; and what is tried again."""

from __future__ import annotations

import threading

import pytest

from app.registry.errors import DatabaseUnavailable
from app.service import patience
from app.service.dispatch import LOOK_S
from app.service.patience import Leaving, patiently
from app.service.vigil import DEAD_S, Pulses

N_LOOKS = int(DEAD_S / LOOK_S)


def test_whose_beats_stand_still_is_dead() -> None:
    pulses, now = Pulses(), 100.0
    for look in range(N_LOOKS + 1):
        assert pulses.dead({"one": look, "two": 1}, now) == set()
        now += LOOK_S
    assert pulses.dead({"one": N_LOOKS, "two": 1}, now) == {"two"}
    assert pulses.dead({"one": N_LOOKS}, now + LOOK_S) == set()
    assert pulses.dead({"one": N_LOOKS, "two": 1}, now + 2 * LOOK_S) == set(), "two is new"
    for look in range(3, N_LOOKS):
        assert pulses.dead({"one": N_LOOKS, "two": 1}, now + look * LOOK_S) == set()


@pytest.mark.parametrize("alive", [True, False])
def test_who_could_not_look_takes_nobody_for_dead(alive: bool) -> None:
    """It was paused itself, or the database was away: then nobody has beaten yet."""
    pulses = Pulses()
    pulses.dead({"one": 7}, 100.0)
    assert pulses.dead({"one": 60 if alive else 7}, 160.0) == set()
    silent = [pulses.dead({"one": 60 if alive else 7}, 160.0 + look * LOOK_S) for look in range(1, N_LOOKS)]
    assert silent[0] == set()
    assert (silent[-1] == set()) == alive


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
