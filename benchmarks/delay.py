"""How soon a segment is final, and what it costs to want it sooner."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from statistics import mean

import numpy as np

from app.motion.evaluation import evaluate
from app.motion.recogniser import Recogniser, SegmentEvent
from app.motion.trajectory import Floats, Recording, Segment, Trajectory
from benchmarks import page, plots
from benchmarks.comparison import told
from benchmarks.teaching import Source, model, tests

BOUNDS = (0.2, 0.3, 0.4, 0.6, 1.0, 2.0, None)
"""Of how long after its end a segment is decided at the latest [s], None as it is by default."""

HELD = 2.0
"""After a recording the hand stays where it is for so long, so that the stream does not end with it [s]."""

TREMOR = 0.0005
"""Standard deviation of the noise meanwhile [m]."""

PART = 5
"""One sequence in so many, and at least two, of those that are simulated; of a fold at most as many."""

SOON = 0.4
"""What is asked for: the median at the default bound [s]."""

IMAGE = "images/recognition-bound.svg"

TEXT = (
    """\
Frames are pushed one at a time; the *delay* of a segment is the time of the newest frame when its event
comes, less the time of the segment's end. When a recording is over the hand stays where it is for {held:g} s.
*Bound* is the time after which a segment is decided whatever may come. At most {most} sequences of each seed
or fold; delays of all segments together, shares mean over seeds or folds.

![What is found against the bound]("""
    + IMAGE
    + ")"
)


@dataclass(frozen=True)
class Wait:
    """Delays of all segments [s] at a bound, and the share found: delineated (simulator), F1@50 (folders)."""

    source: str
    bound: float | None
    delays: Floats
    found: float


def held(recording: Recording, seed: int) -> Recording:
    """Return a recording with the hand at rest behind it, where it and all objects were seen last."""
    motion = recording.trajectory
    period = float(np.median(np.diff(motion.times)))
    n_more = round(HELD / period)
    rng = np.random.default_rng(seed)

    def longer(track: Floats) -> Floats:
        there = track[~np.isnan(track).any(axis=1)]
        return np.concatenate([track, there[-1] + rng.normal(0.0, TREMOR, (n_more, 3))])

    times = np.append(motion.times, motion.times[-1] + period * np.arange(1, n_more + 1))
    objects = {name: longer(track) for name, track in motion.objects.items()}
    return Recording(Trajectory(times, longer(motion.hand), objects), recording.segments, recording.scene)


def pushed(recogniser: Recogniser, motion: Trajectory) -> list[tuple[SegmentEvent, float]]:
    """Return each segment and its delay [s], frames pushed one by one."""
    events: list[tuple[SegmentEvent, float]] = []
    for at in range(len(motion)):
        decided = recogniser.push(motion.part(at, at + 1))
        events += [(each, float(motion.times[at])) for each in decided if isinstance(each, SegmentEvent)]
    left = [each for each in recogniser.finish() if isinstance(each, SegmentEvent)]
    events += [(each, float(motion.times[-1])) for each in left]
    return [(each, now - each.t_end) for each, now in events]


def waiting(source: Source, bound: float | None, n_sequences: int) -> Wait:
    """Return the delays at a bound, and what is found."""
    trained = model(source)
    delays, found = [], []
    for seed, labelled in enumerate(tests(source, n_sequences)[: _most(n_sequences)]):
        recording = held(labelled.recording, seed)
        events = pushed(Recogniser(trained, bound=bound), recording.trajectory)
        delays += [delay for _, delay in events]
        segments = [Segment(each.start, each.end, each.action) for each, _ in events]
        found.append((recording.trajectory.times, recording.segments, segments))
    measures = evaluate(found)
    share = measures.delineated if source.folder is None else measures.f1_50
    return Wait(source.title, bound, np.array(delays), share or 0.0)


def section(
    pool: Executor, sources: Sequence[Source], n_sequences: int, output: Path | None
) -> tuple[str, list[page.Goal]]:
    """Return the section on delays, and whether what is asked of it is met; draw the plot beside output."""
    jobs = [pool.submit(waiting, source, bound, n_sequences) for source in sources for bound in BOUNDS]
    waits = [job.result() for job in jobs]
    rows, goals = [], []
    curves: dict[str, list[float]] = {}
    for title in dict.fromkeys(source.title for source in sources):
        for bound in BOUNDS:
            at = [each for each in waits if (each.source, each.bound) == (title, bound)]
            delays = np.concatenate([each.delays for each in at])
            middle, late = (
                (float(np.percentile(delays, q)) for q in (50, 90)) if len(delays) else (np.inf,) * 2
            )
            found = mean(each.found for each in at)
            curves.setdefault(title, []).append(found)
            rows.append([title, _name(bound), f"{middle:.2f}", f"{late:.2f}", told(found)])
            if bound is None:
                asked = f"{title}: a segment is final after ≤ {SOON:g} s (median)"
                goals.append(page.Goal(asked, f"{middle:.2f} s", middle <= SOON))
    if output is not None:
        at_bounds = [_name(bound) for bound in BOUNDS]
        plots.curves(
            {title: (at_bounds, values) for title, values in curves.items()},
            "bound [s]",
            "delineated (simulator), F1@50",
            output.parent / IMAGE,
        )
    names = ["", "bound [s]", "median [s]", "p90 [s]", "delineated / F1@50"]
    text = TEXT.format(held=HELD, most=_most(n_sequences))
    return f"## How soon\n\n{text}\n\n{page.table(names, rows, n_words=2)}", goals


def _most(n_sequences: int) -> int:
    return max(n_sequences // PART, 2)


def _name(bound: float | None) -> str:
    return "default" if bound is None else f"{bound:g}"
