"""Whatever the way to the server does to a stream: its events are those of an undisturbed one."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from tests.chaos.house import House
from tests.chaos.proxy import FAIR, Weather, proxied
from tests.chaos.streamer import Habits
from tests.chaos.streams import await_that, faults, short_motion, streaming
from tests.chaos.told import Told

ENCODINGS = ("json", "f64")


def both(habits: Habits) -> list[tuple[Told, Habits]]:
    """Return two sessions to stream, one in either encoding."""
    return [
        (Told(short_motion(seed)), replace(habits, encoding=encoding))
        for seed, encoding in enumerate(ENCODINGS)
    ]


def held(house: House, weather: list[Weather], otherwise: Weather, every: list[tuple[Told, Habits]]) -> None:
    """Stream through the weather of the first connections and of those after, and find nothing wrong."""
    with (
        proxied(
            house.ports[0], lambda number: weather[number] if number < len(weather) else otherwise
        ) as url,
        streaming(lambda: url, every),
    ):
        pass
    assert faults(house, [told for told, _ in every]) == []


def test_resets(house: House) -> None:
    rng = random.Random(1)  # noqa: S311 (chance, no secret)
    weather = [Weather(reset=rng.randint(1500, 40_000)) for _ in range(12)]
    every = both(Habits(pace=2000.0))
    held(house, weather, FAIR, every)
    assert sum(told.resumed for told, _ in every) >= 6


def test_slices_and_delays(house: House) -> None:
    held(house, [], Weather(slices=40, wait=0.02), both(Habits(pace=1500.0)))


@pytest.mark.parametrize("deaf", ["server", "client"])
def test_half_open(house: House, deaf: str) -> None:
    """One way nothing passes any more, and neither end is told."""
    every = both(Habits(pace=2000.0, patience=0.7))
    held(house, [Weather(silence=size, deaf=deaf) for size in (9000, 700, 3000, 20_000)], FAIR, every)
    assert sum(told.resumed for told, _ in every) >= 1


def test_frames_twice_and_too_early(house: House) -> None:
    every = both(Habits(again=0.5, ahead=0.03, pace=2000.0))
    held(house, [], FAIR, every)
    assert sum(told.closings[4400] for told, _ in every) >= 2


def test_two_fight_for_a_session(house: House) -> None:
    """Each comes back as soon as it is thrown out, at either server; both hear the same."""
    told = Told(short_motion(0, 30))
    with streaming(house.url, [(told, Habits(pace=2000.0))]):
        await_that(lambda: told.session_id)
        with streaming(house.url, [(told, Habits(pace=2000.0, encoding="json"))]):
            pass
    assert faults(house, [told]) == []
    assert told.closings[4409] >= 4
