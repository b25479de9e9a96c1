"""How fast an archive of recordings is done by one worker and by two.

python benchmarks/archive.py [--recordings N] [--output PAGE]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.demo import stop
from app.motion.model import FeatureSpecification
from app.motion.simulation import RATE, demonstrations, recording
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Recording
from app.motion.warming import warm
from app.registry import jobs, workers
from app.registry.artifacts import dump_recording
from app.service import recognition
from app.service.lab import Lab, open_lab
from benchmarks import page
from benchmarks.load_server import NAME, ROOT, register, settings_of

TRAINING_SEED, N_ACTIONS = 0, 60
N_RECORDINGS = 40
TRIALS = 3
"""Times that each number of workers is measured; the best counts, for other work disturbs it."""
GAIN = 1.7
POLL_S = 0.01

INTRODUCTION = """\
{n} recordings of {seconds:.0f} s each, {frames} frames in all, are segmented as jobs: from when workers that
are at work see them until the last has ended. Workers are processes on any core; the database is SQLite, the
store a directory."""


@dataclass(frozen=True)
class Found:
    """What was measured; took: how long the archive takes by number of workers [s]."""

    n_recordings: int
    n_frames: int
    took: dict[int, float]


def measure(n_recordings: int = N_RECORDINGS) -> Found:
    """Let one worker and two segment the same archive."""
    warm()
    model = fit_model(
        list(demonstrations(TRAINING_SEED)), FeatureSpecification(("object",)), TrainingOptions()
    )
    archive = [recording(seed, N_ACTIONS) for seed in range(n_recordings)]
    took = dict.fromkeys((1, 2), float("inf"))
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        register(folder, model)
        given = settings_of(folder)
        lab = open_lab(given["GESTA_DATABASE_URL"], given["GESTA_STORE_URL"])
        for trial in range(TRIALS):
            for number in took:
                with ExitStack() as stack:
                    for _ in range(number):
                        stack.enter_context(_working(folder))
                    _await_workers(lab, number)
                    _segment(lab, archive[:number])
                    seconds = _segment(lab, archive)
                page.tell(f"trial {trial + 1}, {number} workers: {seconds:.1f} s")
                took[number] = min(took[number], seconds)
        lab.close()
    return Found(n_recordings, sum(len(each.trajectory) for each in archive), took)


@contextmanager
def _working(folder: Path) -> Iterator[None]:
    """Run a worker on what is registered in ``folder``."""
    with (folder / "worker.log").open("ab") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "app.cli", "worker", "--parent", str(os.getpid())],
            cwd=ROOT,
            env={**os.environ, **settings_of(folder)},
            stdout=output,
            stderr=output,
        )
    try:
        yield
    finally:
        stop(process)


def _await_workers(lab: Lab, number: int) -> None:
    """Wait until so many workers beat."""
    while True:
        with lab.database.reading() as tx:
            if len([beats for beats in workers.beats(tx).values() if beats]) == number:
                return
        time.sleep(POLL_S)


def _segment(lab: Lab, archive: list[Recording]) -> float:
    """Return how long the jobs of an archive take [s]."""
    digests = [lab.store.put(dump_recording(each)) for each in archive]
    with lab.database.transaction() as tx:
        for digest in digests:
            request = {"version": 1, "recording": digest}
            jobs.create(tx, kind=recognition.SEGMENTATION, request=request, model=NAME, scope=NAME)
    begin = time.perf_counter()
    while True:
        with lab.database.reading() as tx:
            if not jobs.unfinished(tx, 1):
                return time.perf_counter() - begin
        time.sleep(POLL_S)


def section(found: Found) -> tuple[str, list[page.Goal]]:
    """Return the section on archives, and whether a second worker pays."""
    rows = [
        [
            str(number),
            f"{seconds:.1f}",
            f"{found.n_recordings / seconds:.2f}",
            f"{found.n_frames / RATE / seconds:.0f}",
        ]
        for number, seconds in found.took.items()
    ]
    gain = found.took[1] / found.took[2]
    goals = [page.Goal(f"two workers ≥ {GAIN:g} times one", f"{gain:.2f}", gain >= GAIN)]
    text = INTRODUCTION.format(
        n=found.n_recordings, seconds=found.n_frames / RATE / found.n_recordings, frames=found.n_frames
    )
    names = ["workers", "time [s]", "recordings a second", "times real time"]
    return f"## Archives\n\n{text}\n\n{page.table(names, rows)}", goals


def main() -> None:
    """Measure, print and write the page."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--recordings", type=int, default=N_RECORDINGS, help="in the archive")
    options.add_argument("--output", type=Path, help="page to write")
    given = options.parse_args()
    text, goals = section(measure(given.recordings))
    head = page.heading("Archives", "Recordings segmented by workers, the server idle.")
    page.publish("\n".join([head, page.goals(goals), text]), given.output)


if __name__ == "__main__":
    main()
