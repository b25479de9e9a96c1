"""What is learned from what, once in each process: by a simulator's seed, or by a folder's fold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from app.motion.model import Model
from app.motion.simulation import demonstrations
from app.motion.trajectory import Demonstration, Recording
from benchmarks.conditions import COLUMNS
from benchmarks.folders import Labelled, load_recordings, load_sequences, split
from benchmarks.methods import Find, model_of, train


@dataclass(frozen=True)
class Source:
    """Where motion to learn from and to recognise comes from: a fold of a folder, or the simulator.

    name: of the fold, of the simulator its seed.
    """

    folder: Path | None
    name: str

    @property
    def title(self) -> str:
        """Of the folder, or of the simulator."""
        return self.folder.name if self.folder else "simulator"


def simulator(seed: int) -> Source:
    """Return the simulator trained with a seed."""
    return Source(None, str(seed))


@cache
def shown(source: Source) -> tuple[Demonstration, ...]:
    """Return the demonstrations of a source."""
    if source.folder is None:
        return demonstrations(int(source.name))
    fold, _ = _folds(source.folder)[source.name]
    return tuple(each for labelled in fold for each in labelled.recording.demonstrations())


@cache
def model(source: Source) -> Model:
    """Return the core's model of a source."""
    return model_of(shown(source))


@cache
def methods(source: Source) -> dict[str, Find]:
    """Return every method as learned from a source."""
    return train(shown(source), model(source))


def tests(source: Source, n: int) -> list[Labelled]:
    """Return what is to be recognised: a fold's sequences by name, or n clean ones of the simulator."""
    if source.folder is None:
        simulated = COLUMNS["clean"].recordings(int(source.name), n)
        return [Labelled(f"simulated_{index}", each) for index, each in enumerate(simulated)]
    return list(_folds(source.folder)[source.name][1][0])


def joined(source: Source) -> list[Recording]:
    """Return the longer recordings of a fold; there need not be any."""
    return [each.recording for each in _folds(source.folder)[source.name][1][1]] if source.folder else []


def folds(folder: Path) -> list[Source]:
    """Return the folds of a folder."""
    return [Source(folder, name) for name in _folds(folder)]


Tests = tuple[Sequence[Labelled], Sequence[Labelled]]


@cache
def _folds(folder: Path) -> dict[str, tuple[Sequence[Labelled], Tests]]:
    """Return per fold what it trains on, and its sequences and longer recordings."""
    of_folder = split(load_sequences(folder), load_recordings(folder))
    return {short.name: (short.training, (short.test, longer.test)) for short, longer in of_folder}


def by_person(folder: Path) -> bool:
    """Return whether the folds of a folder are persons."""
    return all(short.by_person for short, _ in split(load_sequences(folder)))
