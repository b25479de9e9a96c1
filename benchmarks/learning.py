"""Learning on: what a new person's recognised and reviewed segments are worth (Sec. V of the paper)."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from statistics import mean

from app.motion.errors import UnusableDemonstration
from app.motion.evaluation import Evaluation, evaluate
from app.motion.model import Model
from app.motion.training import check_demonstration
from app.motion.trajectory import Demonstration, Recording
from benchmarks import page
from benchmarks.comparison import REAL, Measure, Outcome, told
from benchmarks.matching import matched
from benchmarks.methods import OURS, Core, model_of
from benchmarks.teaching import Source, model, shown, tests

N_REVIEWED = 2
"""Runs of the new person that are learned from; all others are the test."""

MEASURES = ("F1@50", "F1@75", "Frames")

TEXT = """\
A model of one person recognises the first {n} runs of another. The segments of these whose class is right (a
person says so: the label is the true one) become demonstrations as they were found, with the boundaries that
were found, and training goes over all. The person's other runs are recognised before and after."""


@dataclass(frozen=True)
class Progress:
    """One person's runs, recognised before and after learning from n_new segments of two other ones."""

    source: Source
    n_new: int
    before: Evaluation
    after: Evaluation


def reviewed(core: Core, recording: Recording) -> list[Demonstration]:
    """Return what is found with the right class, as demonstrations between the boundaries found."""
    found = matched(recording.trajectory.times, recording.segments, core.events(recording.trajectory))
    right = [
        Demonstration(match.action, recording.trajectory.part(match.start, match.end + 1), recording.scene)
        for truth, match in zip(recording.segments, found, strict=True)
        if match is not None and match.action is not None and match.action == truth.action
    ]
    return [each for each in right if _usable(each, core.model)]


def _usable(demonstration: Demonstration, of: Model) -> bool:
    try:
        check_demonstration(0, demonstration, of.features)
    except UnusableDemonstration:
        return False
    return True


def learn_on(source: Source) -> Progress:
    """Return what learning from two runs of a fold's person does to the recognition of the others."""
    runs = [each.recording for each in tests(source, 0)]
    before = Core(model(source))
    new = [each for run in runs[:N_REVIEWED] for each in reviewed(before, run)]
    after = Core(model_of([*shown(source), *new]))
    others = runs[N_REVIEWED:]
    return Progress(source, len(new), _measured(before, others), _measured(after, others))


def _measured(core: Core, runs: Sequence[Recording]) -> Evaluation:
    return evaluate([(each.trajectory.times, each.segments, core(each.trajectory)) for each in runs])


def section(pool: Executor, sources: Sequence[Source]) -> tuple[str, list[page.Goal]]:
    """Return the section on learning on, and whether what is asked of it is met; sources: by person."""
    results = [job.result() for job in [pool.submit(learn_on, source) for source in sources]]
    rows = []
    for each in results:
        for name, measures in (("before", each.before), ("after", each.after)):
            values = [told(_value(REAL[measure], measures)) for measure in MEASURES]
            rows.append([each.source.title, each.source.name, name, str(each.n_new), *values])
    goals = []
    for title in dict.fromkeys(source.title for source in sources):
        goals += _asked(title, [each for each in results if each.source.title == title])
    table = page.table(["", "learned from", "", "segments", *MEASURES], rows, n_words=3)
    return f"## Learning on\n\n{TEXT.format(n=N_REVIEWED)}\n\n{table}", goals


def _asked(title: str, results: Sequence[Progress]) -> list[page.Goal]:
    goals = []
    for measure in MEASURES:
        before, after = (
            mean(_value(REAL[measure], getattr(each, name)) for each in results)
            for name in ("before", "after")
        )
        up = measure == "F1@75" and before < 1.0
        asked = f"{title}: learning on, {measure} {'up' if up else 'not down'} (mean over persons)"
        goals.append(
            page.Goal(asked, f"{told(before)} → {told(after)}", after > before if up else after >= before)
        )
    return goals


def _value(measure: Measure, measures: Evaluation) -> float:
    return measure(Outcome("", "", OURS, measures, 0.0)) or 0.0
