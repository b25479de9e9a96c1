"""What recognition costs while frames come in: in this process and through a real server.

python benchmarks/stream.py [--output PAGE]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.client import Stream
from app.motion.conditioning import Tracks, condition
from app.motion.criterion import Criterion
from app.motion.decoding import Decoder, limits_of
from app.motion.foresight import Foresight, Outlook
from app.motion.model import Model
from app.motion.recogniser import Recogniser
from app.motion.resampling import resample, stack
from app.motion.roles import fillings
from app.motion.search import Found
from app.motion.simulation import RATE, Conditions, demonstrations, recording
from app.motion.trajectory import Floats, Indices, Trajectory
from app.motion.warming import warm
from benchmarks import page
from benchmarks.by_hmmlearn import PlainCriterion
from benchmarks.served import Taught, server, teach_demonstrations

TRAINING_SEED, SEED = 0, 1
LONG_ACTIONS, PACED_ACTIONS, SHORT_ACTIONS = 200, 75, 3
"""Actions of the recordings that are pushed, streamed in real time, and searched with hmmlearn."""

PAUSES = (0.5, 3.0)
STILL_S = 120.0
FLUSH_EVERY = 97
"""Frames between two questions whether all is durable; it shares no factor with the rate of anything."""

REPETITIONS = 5
MOST_MS = 2.0
"""What the 99th percentile of the cost of a frame may be [ms]."""

INTRODUCTION = """\
A model of four action classes, one object, trained by the server on the simulated demonstrations of the
paper's protocol; frames come at {rate:g} Hz."""

COST = """\
`Recogniser.push` of one frame at a time with the default method, one thread; *hypotheses* is the cost of
asking for one, `Recogniser.hypothesis`, after each frame of the motion above. *Wall* is what the clock on the
wall says, *CPU* what the thread itself has used of its core, which other processes of the machine do not
lengthen."""

RATIO = """\
The same decoder, frame by frame, over the same {frames} frames at the internal rate, with the compiled
criterion and with one `decode` of hmmlearn per segment and class; the outlook of movements under way is the
compiled one in both. Both find the same segments; their criterion differs by at most {off:.1g} nat. {n} pairs
of runs, in turn, by the time that the process has used of its core."""

TRIP = """\
{seconds:.0f} s streamed in real time over WebSocket, each frame in a message of its own. *Accepted*: from
sending a frame until the server says that it has it (it says so at intervals, not for each frame). *Flushed*:
from asking whether all that was sent is decided and durable until the answer. *Decided*: from sending the
frame that is a segment's goal until its `segment` event is there; this is the wait of the method for
the evidence behind the boundary, in stream time, and everything else."""


@dataclass(frozen=True)
class Waits:
    """How long it took until the answer was there [s]."""

    accepted: Floats
    flushed: Floats
    decided: Floats


def push_costs(model: Model, motion: Trajectory) -> tuple[Floats, Floats]:
    """Return (n_frames,) costs of each frame [ms] on the wall's clock and on the thread's."""
    frames = [motion.part(at, at + 1) for at in range(len(motion))]
    recogniser = Recogniser(model)
    wall, own = np.empty(len(frames)), np.empty(len(frames))
    for at, frame in enumerate(frames):
        begin, begin_own = time.perf_counter_ns(), time.thread_time_ns()
        recogniser.push(frame)
        own[at], wall[at] = time.thread_time_ns() - begin_own, time.perf_counter_ns() - begin
    return wall / 1e6, own / 1e6


def hypothesis_costs(model: Model, motion: Trajectory) -> tuple[Floats, Floats]:
    """Return (n_frames,) costs of asking for a hypothesis after each frame [ms], likewise."""
    recogniser = Recogniser(model)
    wall, own = np.empty(len(motion)), np.empty(len(motion))
    for at in range(len(motion)):
        recogniser.push(motion.part(at, at + 1))
        begin, begin_own = time.perf_counter_ns(), time.thread_time_ns()
        recogniser.hypothesis()
        own[at], wall[at] = time.thread_time_ns() - begin_own, time.perf_counter_ns() - begin
    return wall / 1e6, own / 1e6


def motions() -> Iterator[tuple[str, Trajectory]]:
    """Yield what is pushed: actions in a row, actions with pauses, standing still, moving about aimlessly."""
    yield "actions", recording(SEED, LONG_ACTIONS).trajectory
    pauses = Conditions(rest=PAUSES)
    yield "actions with pauses", recording(SEED + 1, LONG_ACTIONS // 2, pauses).trajectory
    rng = np.random.default_rng(SEED)
    times = np.arange(round(STILL_S * RATE)) / RATE
    still = np.full((len(times), 3), 0.1)
    yield "standing still", _sensed(rng, times, still)
    waves = rng.uniform(0.1, 1.0, (8, 1, 3)) * times[None, :, None] + rng.uniform(0.0, 1.0, (8, 1, 3))
    yield "moving about", _sensed(rng, times, 0.3 + 0.08 * np.sin(2 * np.pi * waves).sum(axis=0))


def _sensed(rng: np.random.Generator, times: Floats, hand: Floats) -> Trajectory:
    noise = rng.normal(0.0, Conditions().noise, (2, *hand.shape))
    return Trajectory(times, hand + noise[0], {"object": np.array([0.0, 0.3, 0.0]) + noise[1]})


def cost_section(model: Model) -> tuple[str, list[page.Goal]]:
    """Return the section on the cost of a frame, and whether it is little enough."""
    rows, goals = [], []
    warm()
    for name, motion in motions():
        costs = push_costs(model, motion)
        asked_for = hypothesis_costs(model, motion)
        for told, pair in ((name, costs), ("hypotheses", asked_for)):
            figures = (f"{value:.3f}" for cost in pair for value in _told(cost))
            rows.append([told, f"{len(motion)}", *figures])
        page.tell(f"{name}: {len(motion)} frames")
        worst = float(np.percentile(costs[1], 99))
        asked = f"{name}: p99 of a frame ≤ {MOST_MS:g} ms of one core"
        goals.append(page.Goal(asked, f"{worst:.3f} ms", worst <= MOST_MS))
    names = [f"{clock} {name}" for clock in ("wall", "CPU") for name in ("median", "p99", "max")]
    return f"## Cost of a frame [ms]\n\n{COST}\n\n{page.table(['motion', 'frames', *names], rows)}", goals


def _told(cost: Floats) -> list[float]:
    return [float(value) for value in (np.median(cost), np.percentile(cost, 99), cost.max())]


@dataclass(frozen=True)
class Whole:
    """What divisions of a whole motion consist of; its hand is always seen."""

    criteria: Criterion
    foresight: Foresight
    tracks: Tracks
    bounds: Floats

    @property
    def typical(self) -> float:
        """What a frame of a typical action counts [nat]."""
        return self.criteria.typical

    def seen(self, point: int) -> bool:
        """Return whether the hand was seen at a point."""
        return not np.isnan(self.tracks.pace[point])

    def best(self, segments: Indices, before: Floats, least: Floats) -> Floats:
        """Return the (n,) values of (n, 2) segments that can give the best division [nat]."""
        return self.criteria.best(self.tracks, segments, self.bounds, before, least)

    def rest(self, start: int, stop: int) -> float:
        """Return the value of points ``start..stop-1`` at rest [nat]."""
        return float(self.criteria.rest(self.tracks.pace[start:stop]).sum())

    def outlook(self, origin: int, through: int) -> Outlook:
        """Return what a movement under way since ``origin`` may become."""
        return self.foresight(self.tracks, origin, through)


def ratio_section(model: Model) -> str:
    """Return the section on the same search with hmmlearn."""
    roles = model.features.objects
    even = resample(recording(SEED, SHORT_ACTIONS).trajectory, model.features.rate)
    tracks = condition(stack(even, roles), model.features)
    filling = fillings(roles, roles)
    compiled = Criterion(model, 0.0, filling)
    most = [compiled.most(tracks, frame) for frame in range(len(tracks.pace))]
    bounds = np.cumsum([np.zeros(len(model.actions)), *most], axis=0)
    kinds = [
        Whole(criterion, Foresight(model, 0.0, filling), tracks, bounds)
        for criterion in (compiled, PlainCriterion(model, 0.0, filling))
    ]
    seconds, off = np.empty((REPETITIONS, len(kinds))), 0.0
    for run in seconds:
        (run[0], ours), (run[1], theirs) = (timed(model, parts) for parts in kinds)
        if ours != theirs:
            raise RuntimeError(f"the two searches do not agree: {ours} and {theirs}")
        found = np.array([(each.start, each.end) for each in ours])
        one, other = (parts.criteria(tracks, found).criterion for parts in kinds)
        off = max(off, float(np.abs(one - other)[np.isfinite(one)].max()))
        page.tell(f"compiled {run[0]:.4f} s, hmmlearn {run[1]:.2f} s")
    factor, n_frames = seconds[:, 1] / seconds[:, 0], len(tracks.pace)
    rows = [
        [name, *(f"{value:.{digits}f}" for value in (np.median(values), values.min(), values.max()))]
        for name, values, digits in (
            ("compiled [ms a frame]", seconds[:, 0] / n_frames * 1e3, 3),
            ("hmmlearn [ms a frame]", seconds[:, 1] / n_frames * 1e3, 1),
            ("**hmmlearn / compiled**", factor, 0),
        )
    ]
    text = RATIO.format(frames=n_frames, off=off, n=REPETITIONS)
    return f"## Against hmmlearn\n\n{text}\n\n{page.table(['', 'median', 'least', 'most'], rows)}"


def timed(model: Model, parts: Whole) -> tuple[float, list[Found]]:
    """Return the time of the processor that a search takes [s], and what it finds, frame by frame."""
    begin, decoder = time.process_time(), Decoder(parts, limits_of(model))
    found = [each for _ in parts.tracks.pace for each in decoder.frame()] + decoder.finish()
    return time.process_time() - begin, found


def trip_section(taught: Taught) -> str:
    """Return the section on the way through a server and back."""
    motion = recording(SEED, PACED_ACTIONS).trajectory
    page.tell(f"streaming {motion.times[-1]:.0f} s in real time")
    waits = round_trip(taught, motion)
    rows = []
    for name, values in vars(waits).items():
        told = np.percentile(values, [50, 90, 99, 100]) * 1e3
        rows.append([name, str(len(values)), *(f"{value:.1f}" for value in told)])
    table = page.table(["", "n", "median", "p90", "p99", "max"], rows)
    return f"## Through a server [ms]\n\n{TRIP.format(seconds=motion.times[-1])}\n\n{table}"


def round_trip(taught: Taught, motion: Trajectory) -> Waits:
    """Stream frames at the pace of their times; return how long the answers took."""
    sent, asked = np.full(len(motion), np.nan), np.full(len(motion), np.nan)
    waits: dict[str, list[float]] = {"accepted": [], "flushed": [], "decided": []}
    with taught.client.stream(taught.name, version=taught.version) as stream, ThreadPoolExecutor(1) as pool:
        playing = pool.submit(_play, stream, motion, sent, asked)
        through = -1
        for message in stream:
            now = time.perf_counter()
            if message["type"] == "accepted":
                covered = sent[through + 1 : message["through_seq"] + 1]
                waits["accepted"] += (now - covered).tolist()
                through = max(through, message["through_seq"])
            elif message["type"] == "flushed":
                waits["flushed"].append(now - float(asked[message["id"]]))
            elif message["type"] == "segment" and not playing.done():
                waits["decided"].append(now - float(sent[message["end_seq"]]))
        playing.result()
    return Waits(**{name: np.array(values) for name, values in waits.items()})


def _play(stream: Stream, motion: Trajectory, sent: Floats, asked: Floats) -> None:
    """Send each frame at its time, noting when; now and then ask whether all is durable."""
    begin = time.perf_counter()
    for at in range(len(motion)):
        time.sleep(max(float(motion.times[at]) - (time.perf_counter() - begin), 0.0))
        frame = motion.part(at, at + 1)
        sent[at] = time.perf_counter()
        stream.send(frame.times, frame.hand, frame.objects)
        if at % FLUSH_EVERY == FLUSH_EVERY - 1:
            asked[at] = time.perf_counter()
            stream.flush(at)
    stream.end()


def main() -> None:
    """Measure, print and write the page."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--output", type=Path, help="page to write")
    given = options.parse_args()
    with server() as client:
        taught = teach_demonstrations(client, "stream", demonstrations(TRAINING_SEED))
        trip = trip_section(taught)
    cost, goals = cost_section(taught.model)
    ratio = ratio_section(taught.model)
    head = page.heading("Streaming", INTRODUCTION.format(rate=RATE))
    page.publish("\n".join([head, page.goals(goals), cost, ratio, trip]), given.output)


if __name__ == "__main__":
    main()
