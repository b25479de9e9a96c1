"""Labelled motion from a folder of CSV files, and how it is divided into training and test.

``sequences/*.csv`` hold frames (``time_s``, ``hand_x`` …, ``object_x`` …), ``segments.csv`` their segments
(``sequence, start_row, end_row, action``); ``recordings/*.csv`` are longer and labelled frame by frame
(``label``, ``action``). Standing still is no action: ``idle``, ``unlabelled`` and unnamed rows are rest.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.motion.trajectory import Floats, Recording, Segment, Trajectory

SHARED = Path(__file__).parents[1].parent / "shared" / "data"
"""Where motion data lies beside the project, if it does."""

ROLE = "object"
REST = ("", "idle", "unlabelled")

Row = dict[str, str]


@dataclass(frozen=True)
class Labelled:
    """A recording and its name, which begins with its person's: ``subject1_run1``."""

    name: str
    recording: Recording

    @property
    def person(self) -> str:
        """Whose motion it is."""
        return self.name.partition("_")[0]

    @property
    def actions(self) -> set[str | None]:
        """The classes it shows."""
        return {segment.action for segment in self.recording.segments}


@dataclass(frozen=True)
class Fold:
    """What a model is trained on and what it has to recognise; by_person: of another person."""

    name: str
    by_person: bool
    training: Sequence[Labelled]
    test: Sequence[Labelled]


def known_folders() -> list[Path]:
    """Return the folders beside the project that have this layout."""
    return sorted(place.parent for place in SHARED.glob("*/segments.csv"))


def load_sequences(folder: Path, classes: str = "action") -> list[Labelled]:
    """Return the sequences of a folder by name; classes: the column of ``segments.csv`` that names them."""
    segments: dict[str, list[Segment]] = {}
    for row in read_rows(folder / "segments.csv"):
        if row[classes] not in REST:
            span = Segment(int(row["start_row"]), int(row["end_row"]), row[classes])
            segments.setdefault(row["sequence"], []).append(span)
    return [
        Labelled(file.stem, Recording(_motion(read_rows(file)), tuple(segments.get(file.stem, ()))))
        for file in sorted(folder.glob("sequences/*.csv"))
    ]


def load_recordings(folder: Path) -> list[Labelled]:
    """Return the longer recordings of a folder by name; it need not have any."""
    return [
        Labelled(file.stem, Recording(_motion(rows), tuple(_runs(rows))))
        for file in sorted(folder.glob("recordings/*.csv"))
        if (rows := read_rows(file))
    ]


def split(sequences: Sequence[Labelled], recordings: Sequence[Labelled] = ()) -> list[tuple[Fold, Fold]]:
    """Return per fold its sequences and its longer recordings to be recognised, both by the same training.

    Each person is tested on what all others have shown. Where persons do not show the same actions, the
    names are no persons': then every other sequence is one half, and each half is tested on the other.
    """
    groups: dict[str, list[Labelled]] = {}
    for each in sequences:
        groups.setdefault(each.person, []).append(each)
    shown = [set().union(*(each.actions for each in group)) for group in groups.values()]
    persons = len(groups) > 1 and all(actions == shown[0] for actions in shown)
    if not persons:
        groups = {"even": list(sequences[0::2]), "odd": list(sequences[1::2])}
    folds = []
    for name, test in groups.items():
        training = [each for other, group in groups.items() if other != name for each in group]
        longer = [each for each in recordings if each.person == name]
        folds.append((Fold(name, persons, training, test), Fold(name, persons, training, longer)))
    return folds


def read_rows(file: Path) -> list[Row]:
    """Return the rows of a file with a heading."""
    with file.open(newline="") as lines:
        return list(csv.DictReader(lines))


def _motion(rows: Sequence[Row]) -> Trajectory:
    times = np.array([float(row["time_s"]) for row in rows])
    return Trajectory(times, track(rows, "hand"), {ROLE: track(rows, ROLE)})


def track(rows: Sequence[Row], name: str) -> Floats:
    """Return (n_frames, 3) positions [m]; where a coordinate is missing the whole frame is a dropout."""
    positions = np.array([[float(row[f"{name}_{axis}"] or "nan") for axis in "xyz"] for row in rows])
    positions[np.isnan(positions).any(axis=1)] = np.nan
    return positions


def _runs(rows: Sequence[Row]) -> Iterator[Segment]:
    """Yield a segment for each run of frames with the same label; its goal is its successor's start."""
    labels = [(row["label"], row["action"]) for row in rows]
    changes = [at for at in range(1, len(labels)) if labels[at] != labels[at - 1]]
    for start, end in zip([0, *changes], [*changes, len(labels)], strict=True):
        if labels[start][1] not in REST:
            yield Segment(start, end, labels[start][1])
