"""How well actions are recognised: through a real server, on simulated and on real motion.

    python benchmarks/recognition.py [--data DIR]... [--output PAGE]

Every folder is laid out like ``vmci_pick_place``; without ``--data`` all that are known are run.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.client import GestaClient
from app.motion.evaluation import Evaluation, evaluate
from app.motion.recogniser import SegmentEvent, recognise
from app.motion.simulation import Conditions, demonstrations, recording
from app.motion.trajectory import Recording, Segment, Trajectory
from benchmarks import page
from benchmarks.folders import Labelled, known_folders, load_recordings, load_sequences, split
from benchmarks.served import Taught, server, teach_demonstrations, teach_recordings

N_SEQUENCES, N_ACTIONS = 107, 3
"""The paper's test: so many sequences of so many actions (Sec. IV-A)."""

N_LONG, LONG_ACTIONS = 10, 20
"""So many recordings of more actions, as in the paper's Fig. 8."""

TRAINING_SEED, FIRST_SEED = 0, 1
"""Of the simulated demonstrations, and of the first of the sequences."""

SWEEP = 3.0

DELINEATED, LEAD, F1 = 0.98, 0.03, 0.95
"""What is asked for: the share delineated, how far greedy stays behind, F1@50 from person to person."""

INTRODUCTION = """\
Steps 1-3 run in a server: demonstrations are uploaded and trained over HTTP, then every sequence is
streamed over WebSocket; the segments that come back are measured against the truth. *Greedy* is Step 1
alone, without look-ahead, run in this process with the same model: the server offers only Steps 1-3.
The measures are those of `app.motion.evaluation`: *classified* is the share of the delineated actions whose
class is right; standing still is rest, and *in rest* is the share of its frames in which an action was
found."""

SIMULATED = """\
The paper's protocol (Sec. IV-A): trained on demonstrations of four actions at six places (seed {training}),
{n} sequences of {actions} actions at places nobody demonstrated (seeds {first}-{last}). In *sweeping* ones
bow and deviations are {sweep:g} times as large as in training. *Long* ones are {n_long}
of {long_actions} actions (Fig. 8)."""

FOLDER = """\
Each row is a model trained on all others' sequences: {folds}. The mean is over the rows of sequences."""

Method = Callable[[Taught, Trajectory], list[Segment]]


@dataclass(frozen=True)
class Result:
    """The measures of one method on one test."""

    test: str
    method: str
    measures: Evaluation


def steps(taught: Taught, motion: Trajectory) -> list[Segment]:
    """Return what the server finds."""
    return taught.recognise(motion)


def greedy(taught: Taught, motion: Trajectory) -> list[Segment]:
    """Return what is found without look-ahead."""
    events = recognise(taught.model, motion, method="greedy")
    return [Segment(each.start, each.end, each.action) for each in events if isinstance(each, SegmentEvent)]


METHODS: dict[str, Method] = {"Steps 1-3": steps, "greedy": greedy}


def measure(taught: Taught, test: str, recordings: Sequence[Recording]) -> list[Result]:
    """Return the measures of every method."""
    results = []
    for name, method in METHODS.items():
        begin = time.monotonic()
        found = [
            (each.trajectory.times, each.segments, method(taught, each.trajectory)) for each in recordings
        ]
        results.append(Result(test, name, evaluate(found)))
        page.tell(f"{test}, {name}: {len(recordings)} recordings in {time.monotonic() - begin:.1f} s")
    return results


def simulated(client: GestaClient) -> tuple[str, list[page.Goal]]:
    """Return the section on the paper's protocol, and whether what is asked of it is met."""
    taught = teach_demonstrations(client, "simulated", demonstrations(TRAINING_SEED))
    seeds = range(FIRST_SEED, FIRST_SEED + N_SEQUENCES)
    results = []
    for test, conditions in (("as trained", Conditions()), ("sweeping", Conditions(sweep=SWEEP))):
        results += measure(taught, test, [recording(seed, N_ACTIONS, conditions) for seed in seeds])
    results += measure(taught, "long", [recording(seed, LONG_ACTIONS) for seed in seeds[:N_LONG]])
    text = SIMULATED.format(
        training=TRAINING_SEED,
        n=N_SEQUENCES,
        actions=N_ACTIONS,
        first=seeds[0],
        last=seeds[-1],
        sweep=SWEEP,
        n_long=N_LONG,
        long_actions=LONG_ACTIONS,
    )
    ours, plain, *_ = (result.measures for result in results)
    return _section("Simulated", text, [_row(result) for result in results]), _paper_goals(ours, plain)


def _paper_goals(ours: Evaluation, plain: Evaluation) -> list[page.Goal]:
    delineated, classified = ours.delineated or 0.0, ours.classified_of_delineated or 0.0
    lead = delineated - (plain.delineated or 0.0)
    return [
        page.Goal(
            f"simulated: Steps 1-3 delineate ≥ {DELINEATED:.2f}",
            f"{delineated:.3f}",
            delineated >= DELINEATED,
        ),
        page.Goal("simulated: all of those classified right", f"{classified:.3f}", classified == 1.0),
        page.Goal(f"simulated: greedy ≥ {LEAD:.2f} below", f"{lead:.3f} below", lead >= LEAD),
    ]


def on_folder(client: GestaClient, folder: Path) -> tuple[str, list[page.Goal]]:
    """Return the section on a folder, and whether what is asked from person to person is met."""
    folds = split(load_sequences(folder), load_recordings(folder))
    results: list[Result] = []
    means: list[Result] = []
    for sequences, longer in folds:
        shown = [each.recording for each in sequences.training]
        taught = teach_recordings(client, f"{folder.name}-{sequences.name}", shown)
        means += measure(taught, f"{sequences.name}, sequences", _recordings(sequences.test))
        results += means[-len(METHODS) :]
        if longer.test:
            results += measure(taught, f"{sequences.name}, joined", _recordings(longer.test))
    rows = [_row(result) for result in results]
    rows += [_mean_row(name, [result for result in means if result.method == name]) for name in METHODS]
    told = ", ".join(f"{fold.name} ({len(fold.test)} sequences)" for fold, _ in folds)
    f1 = _mean([result.measures.f1_50 for result in means if result.method == "Steps 1-3"]) or 0.0
    asked = f"{folder.name}: from person to person F1@50 ≥ {F1:.2f}"
    goals = [page.Goal(asked, f"{f1:.3f}", f1 >= F1)] if folds[0][0].by_person else []
    return _section(folder.name, FOLDER.format(folds=told), rows), goals


def _section(title: str, text: str, rows: Sequence[Sequence[str]]) -> str:
    return f"## {title}\n\n{text}\n\n{page.table(COLUMNS, rows, n_words=2)}"


def _recordings(labelled: Sequence[Labelled]) -> list[Recording]:
    return [each.recording for each in labelled]


COLUMNS = (
    "test",
    "method",
    "true",
    "found",
    "delineated",
    "classified",
    "F1@50",
    "F1@75",
    "frames",
    "in rest",
    "boundary [ms]",
)


def _shares(measures: Evaluation) -> list[float | None]:
    return [
        measures.delineated,
        measures.classified_of_delineated,
        measures.f1_50,
        measures.f1_75,
        measures.frame_accuracy,
        measures.action_in_rest,
    ]


def _row(result: Result) -> list[str]:
    found = result.measures
    shares = [_share(value) for value in _shares(found)]
    error = _milliseconds(found.median_boundary_error_ms)
    return [result.test, result.method, str(found.n_true), str(found.n_found), *shares, error]


def _mean_row(method: str, results: Sequence[Result]) -> list[str]:
    columns = zip(*(_shares(result.measures) for result in results), strict=True)
    errors = [result.measures.median_boundary_error_ms for result in results]
    shares = [_share(_mean(column)) for column in columns]
    return ["**mean of sequences**", method, "", "", *shares, _milliseconds(_mean(errors))]


def _mean(values: Sequence[float | None]) -> float | None:
    there = [value for value in values if value is not None]
    return sum(there) / len(there) if there else None


def _share(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"


def _milliseconds(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}"


def main() -> None:
    """Measure, print and write the page."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--data", type=Path, action="append", help="a folder; may be given again")
    options.add_argument("--output", type=Path, help="page to write")
    given = options.parse_args()
    with server() as client:
        parts = [simulated(client)]
        parts += [on_folder(client, folder.resolve()) for folder in given.data or known_folders()]
    goals = [goal for _, of_part in parts for goal in of_part]
    sections = [page.heading("Recognition", INTRODUCTION), page.goals(goals), *(text for text, _ in parts)]
    page.publish("\n".join(sections), given.output)


if __name__ == "__main__":
    main()
