"""The parts of the benchmark of recognition, each on little."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.motion.evaluation import evaluate
from app.motion.hypothesis import REST
from app.motion.model import Model
from app.motion.recogniser import Recogniser, SegmentEvent
from app.motion.simulation import REST_POINT, STYLES, Conditions, demonstrations, recording
from app.motion.trajectory import Recording, Segment
from benchmarks import anticipation, bystanders, delay, learning, novelty, page, plots, teaching
from benchmarks.asked import asked
from benchmarks.comparison import REAL, SIMULATED, Comparison, Outcome, on_fold, on_simulator, outcome
from benchmarks.folders import ROLE
from benchmarks.matching import matched
from benchmarks.methods import OURS, Core, model_of
from benchmarks.teaching import folds, simulator

CARRYING = Conditions(styles={action: STYLES[action] for action in ("grasp", "displace", "retract")})
SOURCE = simulator(1)
METHODS = [
    OURS,
    "Steps 1-3",
    "greedy",
    "one HMM, positions",
    "one HMM, velocities",
    "change points",
    "garbage model",
]


@pytest.fixture(autouse=True)
def _taught(trained: Model, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The simulator's seed 1 has taught the small model of the tests."""
    real = teaching.model

    def known(source: teaching.Source) -> Model:
        return trained if source == SOURCE else real(source)

    for module in (teaching, anticipation, bystanders, delay, learning, novelty):
        monkeypatch.setattr(module, "model", known)
    teaching.methods.cache_clear()
    yield
    teaching.methods.cache_clear()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two people who carry things, anna and bela."""
    folder = tmp_path_factory.mktemp("data") / "carrying"
    (folder / "sequences").mkdir(parents=True)
    lines = ["sequence,start_row,end_row,action"]
    for seed in range(8):
        name = f"{('anna', 'bela')[seed % 2]}_{seed}"
        lines += _write(folder / "sequences" / f"{name}.csv", recording(seed, 3, CARRYING))
    (folder / "segments.csv").write_text("\n".join(lines) + "\n")
    return folder


def _write(file: Path, labelled: Recording) -> list[str]:
    """Write a sequence; return the rows of its segments."""
    motion = labelled.trajectory
    table = np.column_stack([motion.times, motion.hand, motion.objects["object"]])
    names = ["time_s", *(f"{track}_{axis}" for track in ("hand", "object") for axis in "xyz")]
    rows = [",".join(f"{value:.5f}" for value in row) for row in table]
    file.write_text("\n".join([",".join(names), *rows]) + "\n")
    return [f"{file.stem},{each.start},{each.end},{each.action}" for each in labelled.segments]


def _event(start: float, end: float, action: str | None = "grasp") -> SegmentEvent:
    return SegmentEvent(round(start * 100), round(end * 100), action, {}, {}, None, 0.0, start, end)


def test_a_true_segment_is_the_found_one_that_covers_its_time() -> None:
    times = np.arange(400) / 100
    truth = [Segment(0, 100, "grasp"), Segment(100, 200, "push"), Segment(300, 400, "retract")]
    found = [_event(0.1, 1.05), _event(1.05, 1.3), _event(1.3, 2.0, None)]
    assert matched(times, truth, found) == [found[0], found[2], None]
    assert matched(times, truth, []) == [None, None, None]


def test_all_methods_are_compared_in_a_column() -> None:
    outcomes = on_simulator("clean", 1, 3)
    assert [each.method for each in outcomes] == METHODS
    ours = outcomes[0]
    assert (ours.measures.n_true, ours.measures.delineated, ours.sequences_with_extra) == (9, 1.0, 0.0)


def test_a_folder_is_compared_from_person_to_person(folder: Path) -> None:
    sources = folds(folder)
    assert [source.name for source in sources] == ["anna", "bela"]
    outcomes = [each for source in sources for each in on_fold(source)]
    compared = Comparison(outcomes, [], [folder.name])
    assert compared.methods == METHODS
    assert (compared.value(REAL["F1@50"], OURS, folder.name) or 0.0) > 0.5
    assert compared.details().count(f"| {OURS} |") == 2
    goals = asked(compared, [folder])
    assert {goal.asked.partition(":")[0] for goal in goals} == {folder.name, "F1@50", "F1@75", "Frames"}


def test_an_extra_segment_counts_once_for_its_sequence() -> None:
    motion = recording(3)
    extra = [Segment(0, 5, "grasp"), Segment(5, 9, "grasp"), *motion.segments]
    one = outcome("clean", "", "m", lambda _: extra, [motion])
    none = outcome("clean", "", "m", lambda _: list(motion.segments), [motion])
    assert (one.sequences_with_extra, none.sequences_with_extra) == (1.0, 0.0)


def _outcomes(ours: list[list[Segment]], theirs: list[list[Segment]]) -> list[Outcome]:
    times, truth = np.arange(300) / 100, [Segment(0, 100, "grasp"), Segment(100, 200, "push")]
    return [
        Outcome("clean", f"seed {seed}", method, evaluate([(times, truth, found)]), 0.0)
        for method, of_method in ((OURS, ours), ("other", theirs))
        for seed, found in enumerate(of_method)
    ]


RIGHT, HALF, WRONG = (
    [Segment(0, 100, "grasp"), Segment(100, 200, "push")],
    [Segment(0, 100, "grasp")],
    [Segment(0, 100, "push"), Segment(100, 200, "push")],
)


def test_a_table_has_the_median_over_seeds() -> None:
    compared = Comparison(_outcomes([RIGHT, HALF, RIGHT], [HALF, HALF, RIGHT]), ["clean"], [])
    table = compared.tables(SIMULATED, ["clean"])
    assert "### Delineated\n\n|  | clean |\n| --- | ---: |\n| ours | 1.000 |\n| other | 0.500 |" in table


def test_goals_are_met_or_not() -> None:
    met = {g.asked: g.met for g in asked(Comparison(_outcomes([RIGHT], [HALF]), ["clean"], []), [])}
    assert set(met.values()) == {True}
    for ours, failing in ((HALF, "simulator: delineated"), (WRONG, "simulator: all delineated classified")):
        goals = asked(Comparison(_outcomes([ours], [RIGHT]), ["clean"], []), [])
        assert [g.met for g in goals if g.asked.startswith(failing)] == [False]
    behind = asked(Comparison(_outcomes([HALF], [RIGHT]), ["clean"], []), [])[-1]
    assert (behind.measured, behind.met) == ("other (clean)", False)


def test_auroc_takes_what_is_not_found_for_found_out() -> None:
    is_new = np.array([0.0, 0.0, 1.0, 1.0])
    assert novelty.auroc(np.array([0.1, 0.3, 0.4, np.inf]), is_new) == 1.0
    assert novelty.auroc(np.array([0.1, 0.5, 0.4, np.inf]), is_new) == 0.75
    assert novelty.auroc(np.array([0.4, np.inf, 0.1, 0.2]), is_new) == 0.0
    assert novelty.auroc(np.array([0.1, 0.2]), np.zeros(2)) is None


def test_a_class_that_was_left_out_is_more_novel() -> None:
    few = [each for each in demonstrations(1)[::3] if each.action != "retract"]
    values, is_new = novelty.novelties(model_of(few), [recording(50 + seed) for seed in range(4)], "retract")
    assert int(is_new.sum()) == 4
    assert (novelty.auroc(values, is_new) or 0.0) > 0.9


def test_few_known_actions_are_lost() -> None:
    lost = novelty.losses(SOURCE, 5)
    assert lost.n_known == 15
    assert 0 <= lost.n_lost <= 1


def test_bystanders_stand_apart_and_bear_no_role() -> None:
    for seed in range(10):
        plain = recording(seed)
        among, manipulated = bystanders.with_bystanders(plain, seed)
        objects = among.trajectory.objects
        assert len(objects) == 3
        assert ROLE not in objects
        np.testing.assert_array_equal(objects[manipulated], plain.trajectory.objects[ROLE])
        frames = [min(at, len(plain.trajectory) - 1) for s in plain.segments for at in (s.start, s.end)]
        for name in set(objects) - {manipulated}:
            track = objects[name]
            assert np.ptp(track, axis=0).max() < 0.01
            away = np.linalg.norm(plain.trajectory.objects[ROLE][frames] - track.mean(axis=0), axis=1)
            assert away.min() > bystanders.APART - 0.005
            assert 0.14 < np.linalg.norm((track.mean(axis=0) - REST_POINT)[:2]) < 0.46
    named = {bystanders.with_bystanders(recording(0), seed)[1] for seed in range(20)}
    assert named == set(bystanders.NAMES)


def test_the_manipulated_object_is_named_among_three() -> None:
    counts = bystanders.naming(SOURCE, 5)
    assert counts.n_true == 15
    assert counts.n_named >= 0.9 * counts.n_matched > 10


def test_a_recording_is_held_where_it_ended() -> None:
    plain = recording(2)
    held = delay.held(plain, 0)
    assert held.trajectory.times[-1] - plain.trajectory.times[-1] == pytest.approx(delay.HELD)
    assert held.segments == plain.segments
    more = held.trajectory.hand[len(plain.trajectory) :]
    assert np.abs(more - plain.trajectory.hand[-1]).max() < 0.005


def test_delays_are_in_stream_time_and_frame_by_frame_is_whole(trained: Model) -> None:
    motion = delay.held(recording(2), 0).trajectory
    pushed = delay.pushed(Recogniser(trained), motion)
    assert [event for event, _ in pushed] == Core(trained).events(motion)
    assert all(0.0 <= waited <= motion.times[-1] for _, waited in pushed)


def test_a_bound_shortens_delays() -> None:
    short, long = delay.waiting(SOURCE, 0.2, 10), delay.waiting(SOURCE, None, 10)
    assert len(short.delays) >= 5
    assert short.delays.max() <= long.delays.max()
    assert 0.5 <= short.found <= 1.0


def test_the_same_figures_draw_the_same_plot(tmp_path: Path) -> None:
    of = {"simulator": ([1.0, 2.0, 4.0], [0.5, 0.6, 0.7])}
    for name in ("a.svg", "b.svg"):
        plots.curves(of, "classes", "cost", tmp_path / "images" / name, logarithmic=True)
    first, second = (tmp_path / "images" / f"{name}.svg" for name in "ab")
    assert first.read_bytes() == second.read_bytes()
    assert b"<svg" in first.read_bytes()


def test_calibration_is_how_far_posteriors_lie_from_shares() -> None:
    sure = [anticipation.Guess(0.5, right, 0.95) for right in (True, True, False, False)]
    assert anticipation.calibration_error(sure) == pytest.approx(0.45)
    honest = [anticipation.Guess(0.5, index < 3, 0.75) for index in range(4)]
    assert anticipation.calibration_error(honest) == pytest.approx(0.0)
    assert anticipation.calibration_error([replace(each, posterior=None) for each in sure]) == 1.0


def test_actions_are_known_before_they_end() -> None:
    guesses = anticipation.actions(SOURCE, 5)
    assert len(guesses) == 5 * 3 * len(anticipation.SHARES)
    early, middle, late = anticipation.accuracies(guesses)
    assert early > 0.5
    assert min(middle, late) > 0.8


def test_what_is_likeliest_is_held_against_the_truth(trained: Model) -> None:
    moved = recording(9)
    wrong = Recording(moved.trajectory, tuple(Segment(s.start, s.end, "dance") for s in moved.segments))
    for segment, _, said in anticipation.under_way(Recogniser(trained), wrong):
        assert segment.action == "dance"
        assert said is None or {each.action for each in said.actions} <= {*trained.names, None, REST}


def test_candidates_hold_where_segments_go() -> None:
    plain = recording(4)
    places, truth = anticipation.candidates(plain, 4)
    assert len(places) == len(set(truth.values())) + anticipation.N_ELSEWHERE
    for segment, name in truth.items():
        end = plain.trajectory.hand[min(segment.end, len(plain.trajectory) - 1)]
        assert min(places, key=lambda at: float(np.linalg.norm(places[at] - end))) == name
        np.testing.assert_allclose(places[name], end, atol=0.05)


def test_goals_are_told_among_candidates() -> None:
    guesses = anticipation.goals(SOURCE, 4)
    assert len(guesses) == 4 * 3 * len(anticipation.SHARES)
    assert anticipation.accuracies(guesses)[-1] > 0.6


def test_only_what_was_found_right_is_learned_on(trained: Model) -> None:
    plain = recording(6)
    right = learning.reviewed(Core(trained), plain)
    assert [each.action for each in right] == [each.action for each in plain.segments]
    mislabelled = Recording(plain.trajectory, tuple(replace(s, action="dance") for s in plain.segments))
    assert learning.reviewed(Core(trained), mislabelled) == []


def test_learning_on_measures_before_and_after(folder: Path) -> None:
    progress = learning.learn_on(folds(folder)[0])
    assert 0 < progress.n_new <= 6
    assert progress.before.n_true == progress.after.n_true == 6


def test_the_program_writes_what_was_asked_for(tmp_path: Path) -> None:
    output = tmp_path / "docs" / "page.md"
    arguments = ["--seeds", "1", "--sequences", "2", "--only", "clean", "--output", str(output)]
    program = str(page.ROOT / "benchmarks" / "recognition.py")
    subprocess.run([sys.executable, program, *arguments], check=True, capture_output=True, timeout=300)
    text = output.read_text()
    assert "|  | clean |" in text
    assert "## Recorded" not in text
    for method in METHODS:
        assert text.count(f"| {method} |") == 3
    command = [sys.executable, program, "--only", "nonsense"]
    refused = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert refused.returncode == 2
    assert "nonsense" in refused.stderr
