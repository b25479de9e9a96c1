"""Live streams of the client in a process of their own, and what each of them heard.

Reads one line of JSON with the fields of ``Order`` from standard input and writes ``Heard`` for each stream,
one a line, when all have ended.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.client import AsyncStream
from app.motion.simulation import RATE, recording
from app.motion.trajectory import Trajectory

CHUNK = 5
"""Frames a message."""
PATIENCE_S = 120.0
"""How long a client tries to come back [s]."""


@dataclass(frozen=True)
class Order:
    """What is streamed: for each stream the seed of its motion; n_frames: of each."""

    url: str
    model: str
    seeds: list[int]
    n_frames: int


@dataclass
class Heard:
    """What a stream was told: its durable events as they came, and when it was told what.

    Times are of the machine's monotonic clock [s]: acknowledgements, and answers to ``start`` and ``resume``.
    """

    seed: int
    events: list[dict[str, Any]] = field(default_factory=list)
    accepted: list[float] = field(default_factory=list)
    started: list[float] = field(default_factory=list)

    @property
    def longest_pause(self) -> float:
        """The longest time between two acknowledgements [s]."""
        return float(np.diff(self.accepted).max())


def motion_of(seed: int, n_frames: int) -> Trajectory:
    """Return the frames that a stream of a seed sends."""
    n_actions = n_frames // 60
    while len(motion := recording(seed, n_actions).trajectory) < n_frames:
        n_actions *= 2
    return motion.part(0, n_frames)


async def follow(order: Order, seed: int, late: float) -> Heard:
    """Stream motion in real time, beginning ``late`` seconds from now."""
    motion, heard = motion_of(seed, order.n_frames), Heard(seed)
    await asyncio.sleep(late)
    async with AsyncStream(order.url, order.model, rate_hz=RATE, reconnect_s=PATIENCE_S) as stream:
        playing = asyncio.create_task(_play(stream, motion))
        async for message in stream:
            now = time.monotonic()
            if message["type"] == "accepted":
                heard.accepted.append(now)
            elif message["type"] == "started":
                heard.started.append(now)
            elif "event" in message:
                heard.events.append(message)
        await playing
    return heard


async def _play(stream: AsyncStream, motion: Trajectory) -> None:
    loop = asyncio.get_running_loop()
    begin = loop.time()
    for first in range(0, len(motion), CHUNK):
        await asyncio.sleep(begin + first / RATE - loop.time())
        part = motion.part(first, min(first + CHUNK, len(motion)))
        await stream.send(None, part.hand, part.objects)
    await stream.end()


class Streams:
    """Such a process at work."""

    def __init__(self, order: Order) -> None:
        self._process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdin is not None  # noqa: S101 (it was asked for)
        self._process.stdin.write(json.dumps(asdict(order)) + "\n")
        self._process.stdin.flush()

    def heard(self) -> Sequence[Heard]:
        """Wait until all streams have ended, and return what they heard."""
        output, _ = self._process.communicate()
        if self._process.returncode:
            raise RuntimeError("the streams did not end")
        return [Heard(**json.loads(line)) for line in output.splitlines()]


async def main() -> None:
    """Do what is ordered."""
    order = Order(**json.loads(sys.stdin.readline()))
    late = np.linspace(0.0, CHUNK / RATE, len(order.seeds), endpoint=False)
    follows = (follow(order, seed, wait) for seed, wait in zip(order.seeds, late.tolist(), strict=True))
    for heard in await asyncio.gather(*follows):
        print(json.dumps(asdict(heard)))


if __name__ == "__main__":
    asyncio.run(main())
