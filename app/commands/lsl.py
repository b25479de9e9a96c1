"""A stream of the Lab Streaming Layer: its channels by their names, its samples as frames."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from app.commands.live import Block
from app.commands.terminal import failure, tell
from app.formats.capture import UNIT_NAMES

FIND_S = 10.0
"""How long a stream is looked for [s]."""
WAIT_S = 0.1
"""How long a sample is waited for, before it is looked whether to stop [s]."""
HAND, LEFT_OUT = "hand", "-"
CHANNEL = re.compile(r"(.+?)[._ :-]?([xyz])", re.IGNORECASE)


@dataclass(frozen=True)
class Channels:
    """Where the tracks are among n channels: name -> the indices of x, y, z; the hand is apart."""

    hand: list[int]
    places: dict[str, list[int]]
    unit: str
    n: int

    @property
    def objects(self) -> list[str]:
        """The names of the objects."""
        return list(self.places)

    @classmethod
    def of(cls, inlet: Any, given: str | None, unit: str | None) -> Channels:
        """Return the channels of an inlet: by the names given, else by its description. Ends the command."""
        info = inlet.info(timeout=FIND_S)
        described = list(_described(info))
        names = [name for name, _ in described] if given is None else given.split(",")
        if len(names) != info.channel_count():
            raise failure(f"the stream has {info.channel_count()} channels, {len(names)} have names")
        tracks = _tracks(names)
        hand = next((name for name in tracks if name.casefold() == HAND), None)
        if hand is None:
            raise failure(
                f"no track is called {HAND}; its channels are {', '.join(names) or 'without names'}: "
                "name them by --channels hand.x,hand.y,hand.z,…"
            )
        used = {index for places in tracks.values() for index in places}
        units = {UNIT_NAMES.get(described[index][1].casefold()) for index in used if index < len(described)}
        said = next(iter(units)) if len(units) == 1 else None
        if unit and said and unit != said:
            raise failure(f"--unit is {unit}, the stream says {said}")
        if not (chosen := unit or said):
            raise failure("the stream does not say its length unit: declare it by --unit")
        return cls(tracks.pop(hand), tracks, chosen, len(names))


@contextmanager
def opened_inlet(name: str) -> Iterator[Any]:
    """Give the inlet of the stream of this name. Ends the command where there is none."""
    if find_spec("pylsl") is None:
        raise failure("it needs pylsl, which is missing: pip install 'gesta[lsl]'")
    pylsl = import_module("pylsl")
    found = pylsl.resolve_byprop("name", name, 1, FIND_S)
    if not found:
        raise failure(f"there is no LSL stream called {name}")
    if found[0].channel_format() == pylsl.cf_string:
        raise failure(f"the LSL stream {name} has texts, no numbers")
    inlet = pylsl.StreamInlet(found[0])
    try:
        yield inlet
    finally:
        inlet.close_stream()


def samples(inlet: Any, channels: Channels, stopped: threading.Event) -> Iterator[Block]:
    """Yield samples as they come until ``stopped``, by the clock of who sends them."""
    last, n_late = -np.inf, 0
    while not stopped.is_set():
        first, at = inlet.pull_sample(timeout=WAIT_S)
        further, times_of_further = inlet.pull_chunk(timeout=0.0) if first else ([], [])
        rows = np.array([first, *further] if first else [], float).reshape(-1, channels.n)
        times = np.array([at, *times_of_further] if first else [], float)
        later = times > np.maximum.accumulate(np.concatenate([[last], times]))[:-1]
        n_late += len(times) - int(later.sum())
        rows, times = rows[later], times[later]
        last = times[-1] if len(times) else last
        objects = {name: rows[:, places] for name, places in channels.places.items()}
        yield Block(times, rows[:, channels.hand], objects)
    if n_late:
        tell(f"{n_late} samples were not later than one before, and left out", "yellow")


def _described(info: Any) -> Iterator[tuple[str, str]]:
    """Yield label and unit of each channel that the stream describes."""
    channel = info.desc().child("channels").child("channel")
    while not channel.empty():
        yield channel.child_value("label"), channel.child_value("unit")
        channel = channel.next_sibling("channel")


def _tracks(names: list[str]) -> dict[str, list[int]]:
    """Return the channels x, y, z of each name that has all three."""
    found: dict[str, dict[str, int]] = {}
    for index, name in enumerate(names):
        if name.strip() != LEFT_OUT and (parts := CHANNEL.fullmatch(name.strip())):
            found.setdefault(parts[1], {})[parts[2].casefold()] = index
    return {name: [axes[axis] for axis in "xyz"] for name, axes in found.items() if len(axes) == 3}
