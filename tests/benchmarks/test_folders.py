"""Folders of CSV files, as the benchmark of recognition reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.motion.trajectory import Segment
from benchmarks.folders import SHARED, load_recordings, load_sequences, split

NAMES = "frame,time_s,hand_x,hand_y,hand_z,object_x,object_y,object_z,label,action"


def _write(file: Path, labels: list[tuple[str, str]], lost: int | None = None) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    rows = [
        f"{7 + at},{at / 60:.5f},{'' if at == lost else at},0.5,0.25,1,2,3,{label},{action}"
        for at, (label, action) in enumerate(labels)
    ]
    file.write_text("\n".join([NAMES, *rows]) + "\n")


def _folder(folder: Path, *names: str) -> Path:
    lines = ["sequence,start_row,end_row,start_s,end_s,label,action"]
    for name in names:
        _write(folder / "sequences" / f"{name}.csv", [("", "")] * 9, lost=1)
        lines += [
            f"{name},0,3,0,0.05,reach,grasp",
            f"{name},3,5,0,0,still,idle",
            f"{name},5,9,0,0,go,retract",
        ]
    (folder / "segments.csv").write_text("\n".join(lines) + "\n")
    return folder


def test_sequences_have_their_segments_and_idle_is_rest(tmp_path: Path) -> None:
    [one] = load_sequences(_folder(tmp_path, "anna_1"))
    assert (one.name, one.person) == ("anna_1", "anna")
    assert one.recording.segments == (Segment(0, 3, "grasp"), Segment(5, 9, "retract"))
    motion = one.recording.trajectory
    np.testing.assert_allclose(motion.times, np.arange(9) / 60, atol=1e-5)
    np.testing.assert_array_equal(motion.hand[2], [2, 0.5, 0.25])
    np.testing.assert_array_equal(motion.objects["object"][1], [1, 2, 3])


def test_a_frame_with_a_coordinate_missing_is_a_dropout(tmp_path: Path) -> None:
    [one] = load_sequences(_folder(tmp_path, "anna_1"))
    assert np.isnan(one.recording.trajectory.hand).all(axis=1).tolist() == [at == 1 for at in range(9)]


def test_a_recording_is_labelled_by_its_frames(tmp_path: Path) -> None:
    labels = (
        [("reach", "grasp")] * 2 + [("carry", "displace")] + [("", "unlabelled")] + [("put", "displace")] * 2
    )
    _write(tmp_path / "recordings" / "anna_long.csv", labels)
    [one] = load_recordings(tmp_path)
    assert one.recording.segments == (
        Segment(0, 2, "grasp"),
        Segment(2, 3, "displace"),
        Segment(4, 6, "displace"),
    )


def test_each_person_is_tested_on_what_the_others_show(tmp_path: Path) -> None:
    sequences = load_sequences(_folder(tmp_path, "anna_1", "anna_2", "bela_1", "carl_1"))
    folds = {fold.name: fold for fold, _ in split(sequences)}
    assert set(folds) == {"anna", "bela", "carl"}
    assert all(fold.by_person for fold in folds.values())
    assert [each.name for each in folds["bela"].training] == ["anna_1", "anna_2", "carl_1"]
    assert [each.name for each in folds["bela"].test] == ["bela_1"]


def test_where_names_are_no_persons_every_other_sequence_is_a_half(tmp_path: Path) -> None:
    sequences = load_sequences(_folder(tmp_path, "run_1", "run_2", "run_3"))
    folds = [fold for fold, _ in split(sequences)]
    assert [[each.name for each in fold.test] for fold in folds] == [["run_1", "run_3"], ["run_2"]]
    assert [[each.name for each in fold.training] for fold in folds] == [["run_2"], ["run_1", "run_3"]]
    assert not any(fold.by_person for fold in folds)


@pytest.mark.shared
def test_real_motion_has_ninety_actions_of_three_classes() -> None:
    folder = SHARED / "vmci_pick_place"
    sequences, recordings = load_sequences(folder), load_recordings(folder)
    actions = [segment.action for each in sequences for segment in each.recording.segments]
    assert len(actions) == 90
    assert set(actions) == {"grasp", "displace", "retract"}
    assert [len(each.recording.segments) for each in recordings] == [18, 18]
    assert [fold.name for fold, _ in split(sequences, recordings)] == ["subject1", "subject2"]
    assert [len(longer.test) for _, longer in split(sequences, recordings)] == [0, 2]
