"""How many streams a core holds: frame by frame, against a server that only spends the time.

python benchmarks/load.py [--seconds S] [--output PAGE]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.motion.model import FeatureSpecification, Model
from app.motion.recogniser import Recogniser
from app.motion.resampling import stack
from app.motion.simulation import RATE, demonstrations, recording
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Floats
from app.motion.warming import warm
from benchmarks import page
from benchmarks.load_server import NAME, Cost, Place, register, serving
from benchmarks.load_streams import Answers, Load, Wire, ended, offer, on_cores, opened

TRAINING_SEED, SEED, N_ACTIONS = 0, 1, 60
SECONDS = 6.0
MOST_S = 0.010
"""What the 99th percentile of the waits may be [s]."""
FIRST, STEP = 30, 1.1
"""Streams that are tried first, and by how much more they are next."""
TRIALS = 3
"""So many times a load is tried before it is too much: other work on the machine disturbs it."""
SHARE, GAIN, MOST_KB = 0.8, 1.4, 200.0
N_IDLE, IDLE_S = 50, 10.0
"""Sessions that memory is measured with, beside as many others, and how long they take in motion [s]."""

INTRODUCTION = """\
Binary streams of one object at {rate:g} Hz over WebSocket, staggered over the interval between two
messages and begun at different frames, with hypotheses and acknowledgements as by default, {seconds:g} s
at a time. The server has one core, the load comes from the other. A *wait* is the time from when a
message was due until the `pong` to the `ping` right behind it is there: by then its frames are through
the recogniser. Streams are *held* if the 99th percentile of the waits is ≤ {most:g} ms; {step:g} times as
many are tried as long as they are. *Spin* is the same server with a loop in place of the recogniser that
spends what the recogniser costs: {frame:.0f} us a frame, {hypothesis:.0f} us a hypothesis. *Two workers*
are two servers on one database, one on each core, which they share with the load."""


@dataclass(frozen=True)
class Held:
    """The most streams that were held, and how that went."""

    streams: int
    answers: Answers


@dataclass(frozen=True)
class Found:
    """What was measured; session: memory of one that is open [KB]."""

    cost: Cost
    recogniser: Held
    spin: Held
    tens: Held
    two: Held
    session: float
    seconds: float


def measure(seconds: float = SECONDS) -> Found:
    """Load servers until they are late."""
    warm()
    model = _model()
    rows = _rows()
    cost = cost_of(model, rows)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        register(folder, model)
        on_cores(1)
        held = {}
        for title, chunk, spin in (("recogniser", 1, None), ("spin", 1, cost), ("tens", 10, None)):
            page.tell(title)
            with serving(folder, 0, spin) as place:
                held[title] = _held([place], chunk, rows, seconds)
        page.tell("two workers")
        on_cores(0, 1)
        with ExitStack() as stack_of:
            places = [stack_of.enter_context(serving(folder, core)) for core in (0, 1)]
            held["two"] = _held(places, 1, rows, seconds)
        with serving(folder, 0) as place:
            session = _memory(place, rows)
    return Found(cost, held["recogniser"], held["spin"], held["tens"], held["two"], session, seconds)


def _model() -> Model:
    shown = list(demonstrations(TRAINING_SEED))
    return fit_model(shown, FeatureSpecification(("object",)), TrainingOptions())


def _rows() -> Floats:
    """Return the positions of hand and object (n_frames, 6) of a long recording [m]."""
    motion = recording(SEED, N_ACTIONS).trajectory
    return np.ascontiguousarray(stack(motion, ("object",)).reshape(len(motion), -1))


def cost_of(model: Model, rows: Floats) -> Cost:
    """Return what a recogniser spends on a frame and on a hypothesis, ten times a second, on average."""
    recogniser, frame, hypothesis = Recogniser(model, rate=RATE), 0, 0
    times, positions = np.arange(len(rows)) / RATE, rows.reshape(len(rows), 2, 3)
    for at in range(len(rows)):
        begin = time.thread_time_ns()
        recogniser.take(times[at : at + 1], positions[at : at + 1])
        frame += time.thread_time_ns() - begin
        if at % 10 == 0:
            begin = time.thread_time_ns()
            recogniser.hypothesis()
            hypothesis += time.thread_time_ns() - begin
    return Cost(frame / len(rows), hypothesis / len(range(0, len(rows), 10)))


def _held(places: Sequence[Place], chunk: int, rows: Floats, seconds: float) -> Held:
    """Return the most streams that servers hold together."""
    best, streams = Held(0, Answers(np.zeros(1), np.zeros(1))), FIRST
    while True:
        for _ in range(TRIALS):
            found = _trial(places, Load(streams, RATE, chunk, seconds), rows)
            if found is None:
                page.tell(f"{streams} streams: the server let go")
                continue
            page.tell(f"{streams} streams: p99 {found.p99 * 1e3:.1f} ms, sent {found.late * 1e3:.1f} ms late")
            if found.p99 <= MOST_S:
                break
        else:
            return best
        assert found is not None  # noqa: S101 (the loop ended by its break)
        best, streams = Held(streams, found), int(np.ceil(streams * STEP))


def _trial(places: Sequence[Place], load: Load, rows: Floats) -> Answers | None:
    """Return how a load went, None where a server let go of a stream."""
    wires: list[Wire] = []
    try:
        of = [places[number % len(places)] for number in range(load.streams)]
        wires.extend(opened(place.port, NAME, load.rate) for place in of)
        answers = offer(load, wires, rows)
        ended(wires)
    except (ConnectionError, TimeoutError):
        for wire in wires:
            wire.socket.close()
        return None
    return answers


def _memory(place: Place, rows: Floats) -> float:
    """Return the memory of one more open session after some seconds of motion [KB]."""
    grown, every = 0.0, list[Wire]()
    for _ in range(2):
        before, wires = place.memory, [opened(place.port, NAME, RATE) for _ in range(N_IDLE)]
        offer(Load(N_IDLE, RATE, 10, IDLE_S), wires, rows)
        grown, every = (place.memory - before) / N_IDLE / 1e3, every + wires
    ended(every)
    return grown


def section(found: Found) -> tuple[str, list[page.Goal]]:
    """Return the section on load, and whether enough is held."""
    rows = []
    for title, held in (
        ("one core, a frame a message", found.recogniser),
        ("the same, spin", found.spin),
        ("one core, ten frames a message", found.tens),
        ("two workers, a frame a message", found.two),
    ):
        waits = np.percentile(held.answers.waits, [50, 90, 99]) * 1e3
        figures = [*waits, held.answers.late * 1e3]
        rows.append([title, str(held.streams), *(f"{value:.1f}" for value in figures)])
    names = ["", "streams held", "median wait [ms]", "p90", "p99", "p99 of sending late"]
    share = found.recogniser.streams / found.spin.streams
    gain = found.two.streams / found.recogniser.streams
    goals = [
        page.Goal(f"≥ {SHARE:.0%} of the streams that a spin holds", f"{share:.0%}", share >= SHARE),
        page.Goal(f"two workers ≥ {GAIN:g} times one", f"{gain:.2f}", gain >= GAIN),
        page.Goal(f"≤ {MOST_KB:g} KB a session", f"{found.session:.0f} KB", found.session <= MOST_KB),
    ]
    text = INTRODUCTION.format(
        rate=RATE,
        seconds=found.seconds,
        most=MOST_S * 1e3,
        step=STEP,
        frame=found.cost.frame / 1e3,
        hypothesis=found.cost.hypothesis / 1e3,
    )
    return f"## Streams\n\n{text}\n\n{page.table(names, rows)}", goals


def main() -> None:
    """Measure, print and write the page."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--seconds", type=float, default=SECONDS, help="time of each trial [s]")
    options.add_argument("--output", type=Path, help="page to write")
    given = options.parse_args()
    text, goals = section(measure(given.seconds))
    head = page.heading("Load", "A server of its own on loopback.")
    page.publish("\n".join([head, page.goals(goals), text]), given.output)


if __name__ == "__main__":
    main()
