"""Methods under conditions: what each finds, and the tables of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, median

from app.motion.evaluation import Evaluation, evaluate
from app.motion.trajectory import Recording
from benchmarks import page
from benchmarks.conditions import COLUMNS
from benchmarks.methods import Find
from benchmarks.teaching import Source, folds, joined, methods, simulator, tests

JOINED = ", joined"


@dataclass(frozen=True)
class Outcome:
    """The measures of one method in one column, trained on one seed or fold.

    sequences_with_extra: share of the sequences in which a segment matches no true one at 0.5.
    """

    column: str
    fold: str
    method: str
    measures: Evaluation
    sequences_with_extra: float


Measure = Callable[[Outcome], float | None]

SIMULATED: dict[str, Measure] = {
    "Delineated": lambda outcome: outcome.measures.delineated,
    "Classified, of the delineated": lambda outcome: outcome.measures.classified_of_delineated,
    "Sequences with an extra segment": lambda outcome: outcome.sequences_with_extra,
}

REAL: dict[str, Measure] = {
    "F1@50": lambda outcome: outcome.measures.f1_50,
    "F1@75": lambda outcome: outcome.measures.f1_75,
    "Frames": lambda outcome: outcome.measures.frame_accuracy,
    "Boundary [ms]": lambda outcome: outcome.measures.median_boundary_error_ms,
}


@dataclass(frozen=True)
class Comparison:
    """All outcomes, and the names of the columns that were run."""

    outcomes: Sequence[Outcome]
    simulated: Sequence[str]
    real: Sequence[str]

    @property
    def methods(self) -> list[str]:
        """The names of the methods, in their order."""
        return list(dict.fromkeys(outcome.method for outcome in self.outcomes))

    def value(self, measure: Measure, method: str, column: str) -> float | None:
        """Return the median over seeds, or the mean over folds."""
        at = [each for each in self.outcomes if (each.method, each.column) == (method, column)]
        values = [value for each in at if (value := measure(each)) is not None]
        if not values:
            return None
        return median(values) if column in self.simulated else mean(values)

    def tables(self, measures: dict[str, Measure], columns: Sequence[str]) -> str:
        """Return one table for each measure, methods by columns."""
        parts = []
        for title, measure in measures.items():
            rows = [
                [method, *(told(self.value(measure, method, column)) for column in columns)]
                for method in self.methods
            ]
            parts.append(f"### {title}\n\n{page.table(['', *columns], rows)}")
        return "\n".join(parts) if columns else ""

    def details(self) -> str:
        """Return the table of every fold."""
        names = ["folder", "trained for", "method", "true", "found", "delineated", *REAL, "in rest"]
        rows = [
            [
                each.column,
                each.fold,
                each.method,
                str(each.measures.n_true),
                str(each.measures.n_found),
                told(each.measures.delineated),
                *(told(measure(each)) for measure in REAL.values()),
                told(each.measures.action_in_rest),
            ]
            for each in self.outcomes
            if each.column in self.real
        ]
        return page.table(names, rows, n_words=3)


def told(value: float | None) -> str:
    """Return a figure as a table has it: a share with three digits, milliseconds with none."""
    if value is None:
        return ""
    return f"{value:.3f}" if value <= 1.0 else f"{value:.0f}"


def compare(
    pool: Executor, n_seeds: int, n_sequences: int, columns: Sequence[str], folders: Iterable[Path]
) -> Comparison:
    """Return what every method finds in these columns of the simulator and in these folders."""
    jobs = [
        pool.submit(on_simulator, column, seed, n_sequences) for seed in range(n_seeds) for column in columns
    ]
    sources = [source for folder in folders for source in folds(folder)]
    jobs += [pool.submit(on_fold, source) for source in sources]
    outcomes = []
    for job in jobs:
        outcomes += job.result()
        page.tell(f"{outcomes[-1].column}, {outcomes[-1].fold}")
    real = dict.fromkeys(each.column for each in outcomes if each.column not in columns)
    return Comparison(outcomes, columns, sorted(real))


def on_simulator(column: str, seed: int, n_sequences: int) -> list[Outcome]:
    """Return what every method, trained on a seed, finds in one column."""
    recordings = COLUMNS[column].recordings(seed, n_sequences)
    return [
        outcome(column, f"seed {seed}", name, find, recordings)
        for name, find in methods(simulator(seed)).items()
    ]


def on_fold(source: Source) -> list[Outcome]:
    """Return what every method finds in a fold's sequences and in its longer recordings."""
    outcomes = []
    sets = {
        source.title: [each.recording for each in tests(source, 0)],
        source.title + JOINED: joined(source),
    }
    for column, recordings in sets.items():
        if recordings:
            of_column = [
                outcome(column, source.name, name, find, recordings) for name, find in methods(source).items()
            ]
            outcomes += of_column
    return outcomes


def outcome(column: str, fold: str, method: str, find: Find, recordings: Sequence[Recording]) -> Outcome:
    """Return the measures of what a method finds in recordings."""
    found = [(each.trajectory.times, each.segments, find(each.trajectory)) for each in recordings]
    extra = [evaluate([each]).n_extra > 0 for each in found]
    return Outcome(column, fold, method, evaluate(found), sum(extra) / len(extra))
