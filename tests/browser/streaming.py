"""Streams that go on beside a test, at the pace of their frames."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import count
from typing import Any

import numpy as np

from app.client import GestaClient
from app.motion.simulation import Conditions, recording
from app.motion.trajectory import Trajectory

RATE = 100.0


def long_motion(seed: int, seconds: float) -> Trajectory:
    """Return movements one after the other, each session of them from the rest point and back."""
    parts, length = [], 0
    for number in count(seed):
        if length >= seconds * RATE:
            break
        parts.append(recording(number, 5, Conditions(rest=(0.1, 0.5))).trajectory)
        length += len(parts[-1])
    hand = np.concatenate([part.hand for part in parts])
    things = np.concatenate([part.objects["object"] for part in parts])
    return Trajectory(np.arange(len(hand)) / RATE, hand, {"object": things})


@contextmanager
def streaming(url: str, name: str, n_streams: int, seconds: float) -> Iterator[list[list[dict[str, Any]]]]:
    """Stream for so long; yield what each stream has been told, which is complete at the end."""
    told: list[list[dict[str, Any]]] = [[] for _ in range(n_streams)]
    with ThreadPoolExecutor(n_streams) as pool:
        running = [
            pool.submit(_stream, url, f"{name} {n + 1}", long_motion(100 * n, seconds), told[n])
            for n in range(n_streams)
        ]
        yield told
        for each in running:
            each.result(120)


def _stream(url: str, name: str, motion: Trajectory, told: list[dict[str, Any]]) -> None:
    with GestaClient(url) as gesta, gesta.stream("table-top", rate_hz=RATE, name=name) as stream:
        begin, sent = time.monotonic(), 0
        with ThreadPoolExecutor(1) as reading:
            heard = reading.submit(lambda: told.extend(stream))
            while sent < len(motion):
                due = min(int((time.monotonic() - begin) * RATE), len(motion))
                if due > sent:
                    stream.send(None, motion.hand[sent:due], {"object": motion.objects["object"][sent:due]})
                sent = due
                time.sleep(0.03)
            stream.end()
            heard.result(60)
