"""How well actions are recognised: small samples of what the benchmarks measure in full."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pytest

from app.motion.evaluation import Evaluation, evaluate
from app.motion.model import FeatureSpecification, Model
from app.motion.recogniser import Method, SegmentEvent, recognise
from app.motion.simulation import Conditions, demonstrations, recording
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Floats, Recording, Segment, Trajectory

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
SPECIFICATION = FeatureSpecification(("object",))
ACTIONS = ("grasp", "displace", "push", "retract")


def measured(model: Model, recordings: Iterable[Recording], method: Method = "viterbi") -> Evaluation:
    """Return the measures of what a model finds in recordings."""
    found = []
    for shown in recordings:
        events = recognise(model, shown.trajectory, shown.scene, method)
        segments = [Segment(e.start, e.end, e.action) for e in events if isinstance(e, SegmentEvent)]
        truth = [segment for segment in shown.segments if segment.action in ACTIONS]
        found.append((shown.trajectory.times, truth, segments))
    return evaluate(found)


def simulated(n: int, conditions: Conditions = Conditions()) -> list[Recording]:
    """Return n recordings of three actions at untrained places."""
    return [recording(7000 + seed, 3, conditions) for seed in range(n)]


@pytest.fixture(scope="module")
def taught() -> Model:
    """A model of the paper's demonstrations."""
    return fit_model(demonstrations(0), SPECIFICATION, TrainingOptions(n_states=8))


def test_the_papers_protocol(taught: Model) -> None:
    found = measured(taught, simulated(107))
    assert found.delineated is not None
    assert found.delineated >= 0.98
    assert found.classified_of_delineated == 1.0


def test_the_papers_own_steps_are_better_than_greed(taught: Model) -> None:
    methods: tuple[Method, ...] = ("steps", "greedy")
    steps, greedy = (measured(taught, simulated(30), method) for method in methods)
    assert steps.delineated is not None
    assert steps.delineated >= 0.95
    assert steps.f1_75 is not None
    assert greedy.f1_75 is not None
    assert greedy.f1_75 < steps.f1_75


@pytest.mark.parametrize(
    ("conditions", "least"),
    [
        (Conditions(outlier_share=0.01), 0.98),
        (Conditions(gap_share=0.5), 0.98),
        (Conditions(noise=0.003), 0.98),
        (Conditions(rest=(0.5, 2.0)), 0.98),
        (Conditions(sweep=3.0), 0.95),
    ],
    ids=["outliers", "gaps", "noise", "rest", "sweeping"],
)
def test_what_makes_motion_harder(taught: Model, conditions: Conditions, least: float) -> None:
    found = measured(taught, simulated(30, conditions))
    assert found.delineated is not None
    assert found.delineated >= least
    assert found.classified_of_delineated is not None
    assert found.classified_of_delineated >= 0.98


def test_rest_belongs_to_no_segment(taught: Model) -> None:
    found = measured(taught, simulated(30, Conditions(rest=(1.0, 2.0))))
    assert found.n_found <= found.n_true
    assert found.action_in_rest is not None
    assert found.action_in_rest < 0.1


def test_a_longer_sequence(taught: Model) -> None:
    found = measured(taught, [recording(7100, 12)])
    assert (found.delineated, found.classified_of_delineated) == (1.0, 1.0)


def read(folder: Path) -> dict[str, Recording]:
    """Return the labelled sequences of a folder of the data beside the project, by name."""
    segments: dict[str, list[Segment]] = defaultdict(list)
    for row in table(folder / "segments.csv"):
        segments[row["sequence"]].append(Segment(int(row["start_row"]), int(row["end_row"]), row["action"]))
    result = {}
    for path in sorted((folder / "sequences").glob("*.csv")):
        rows = table(path)
        trajectory = Trajectory(
            column(rows, "time_s"), track(rows, "hand"), {"object": track(rows, "object")}
        )
        result[path.stem] = Recording(trajectory, tuple(segments[path.stem]))
    return result


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def column(rows: Sequence[dict[str, str]], name: str) -> Floats:
    return np.array([float(row[name] or "nan") for row in rows])


def track(rows: Sequence[dict[str, str]], name: str) -> Floats:
    return np.column_stack([column(rows, f"{name}_{axis}") for axis in "xyz"])


def taught_by(recordings: Iterable[Recording]) -> Model:
    shown = [each for of in recordings for each in of.demonstrations() if each.action in ACTIONS]
    return fit_model(shown, SPECIFICATION, TrainingOptions())


@pytest.mark.shared
def test_from_person_to_person() -> None:
    sequences = read(SHARED / "vmci_pick_place")
    people = [
        [shown for name, shown in sequences.items() if name.startswith(person)]
        for person in ("subject1", "subject2")
    ]
    found = [measured(taught_by(people[who]), people[1 - who]) for who in (0, 1)]
    assert np.mean([each.f1_50 for each in found]) >= 0.98
    assert np.mean([each.frame_accuracy for each in found]) >= 0.96
    assert min(each.frame_accuracy or 0.0 for each in found) >= 0.95


@pytest.mark.shared
def test_a_simulated_robot() -> None:
    sequences = list(read(SHARED / "metaworld_scripted").values())
    found = [measured(taught_by(sequences[half::2]), sequences[1 - half :: 2]) for half in (0, 1)]
    assert min(each.f1_50 or 0.0 for each in found) >= 0.98
