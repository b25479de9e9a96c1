"""Movements of people and of the simulator, and how they are divided into training and test.

What a person shows is tested on what another person has taught (``vmci_pick_place``, all six labels), or,
where there is but one, on what the other trials have taught (``kinesis_reach_to_grasp``). Folders whose
names are no people's are halved, as they are for recognition.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.motion.errors import UnusableDemonstration
from app.motion.model import FeatureSpecification
from app.motion.simulation import demonstrations, recording
from app.motion.training import check_demonstration
from app.motion.trajectory import Demonstration, Flags, Floats, Trajectory
from benchmarks.folders import ROLE, Row, load_sequences, read_rows, split, track

N_ELSEWHERE = 60
"""Simulated sequences of four actions that go where nobody has shown."""

N_PAIRS = 5
"""Of seeds of the simulator, one to teach and one to test."""

N_FOLDS = 9
"""By which the trials of a single person are divided."""

REACHED_S, RETURN_S = 1.0, 1.5
"""A trial's reach is fastest before the one, its return after the other [s]; between them the hand holds."""

HELD_S = 2.3
"""A reach is over by then [s]."""

STILL, MOVING = 0.1, 0.25
"""Shares of a movement's highest speed: slower than the one it has not begun, and a movement that begins or
ends faster than the other is cut off."""

SPAN_S = 0.05
"""Speed is that over so long a time [s]."""

NEXT_S = 0.004
"""Frames that follow the one before it sooner are a stutter of the clock [s]."""

LOST_S = 0.1
"""A movement is left out where the finger is lost for longer [s]."""

FASTEST = 3.0
"""No finger is faster: where it seems so, its marker was mistaken for another [m/s]."""

TOLD = f"""\
The tip of the index finger of one person in {{n_trials}} trials, every {N_FOLDS}th held out in turn. A
movement is the run of frames about its fastest that are faster than {100 * STILL:g} % of that. A reach is
fastest in the first {REACHED_S:g} s and ends within {HELD_S:g} s, a return is fastest after {RETURN_S:g} s.
Of {{n_rows}} frames {{n_dropped}} are left out: the finger is hidden, its sample is repeated or comes less
than {1000 * NEXT_S:g} ms after another. A movement is left out where the finger is lost for over {LOST_S:g} s
or seems faster than {FASTEST:g} m/s: {{n_reaches}} reaches and {{n_returns}} returns remain. Of these,
{{n_begun}} reaches begin and {{n_cut}} returns end at over {100 * MOVING:g} % of their highest speed, as the
recording was cut there: what rests at its ends cannot meet them in time."""


@dataclass(frozen=True)
class Fold:
    """Movements that are shown and others that have to be met; held: whose they are."""

    held: str
    training: Sequence[Demonstration]
    test: Sequence[Demonstration]


@dataclass(frozen=True)
class Source:
    """Movements from one place: text says what they are; roles: the objects that all of them have."""

    name: str
    text: str
    folds: Sequence[Fold]
    roles: tuple[str, ...] = ()

    @property
    def classes(self) -> list[str]:
        """The classes, by name."""
        return sorted({each.action for fold in self.folds for each in fold.test})


def simulated() -> Source:
    """Return the paper's training set by one seed, to be met by another's, N_PAIRS times."""
    text = (
        f"The paper's training set, simulated, at the same places: taught by one seed, tested by another, "
        f"{N_PAIRS} times."
    )
    folds = [
        Fold(f"seed {2 * pair}", demonstrations(2 * pair - 1), demonstrations(2 * pair))
        for pair in range(1, N_PAIRS + 1)
    ]
    return Source("simulated", text, folds, (ROLE,))


def elsewhere() -> Source:
    """Return the same trainings, to be met by movements between places that nobody has shown."""
    sequences = [recording(seed, 4) for seed in range(N_ELSEWHERE)]
    tests = [
        [each for sequence in sequences[pair::N_PAIRS] for each in sequence.demonstrations()]
        for pair in range(N_PAIRS)
    ]
    n_test = sum(len(test) for test in tests)
    text = f"The same trainings; tested on {n_test} movements between places that nobody has shown."
    folds = [Fold(f"untrained {pair}", demonstrations(2 * pair + 1), test) for pair, test in enumerate(tests)]
    return Source("simulated elsewhere", text, folds, (ROLE,))


def of_folder(folder: Path) -> Source:
    """Return the movements of a folder laid out like ``vmci_pick_place``, by their labels if it has any."""
    labelled = "label" in read_rows(folder / "segments.csv")[0]
    folds, n_refused = [], 0
    for fold, _ in split(load_sequences(folder, "label" if labelled else "action")):
        shown, met = (
            [each for one in of for each in one.recording.demonstrations()]
            for of in (fold.training, fold.test)
        )
        folds.append(Fold(fold.name, usable(shown, (ROLE,)), usable(met, (ROLE,))))
        n_refused += len(met) - len(folds[-1].test)
    n_test, held = sum(len(fold.test) for fold in folds), ", ".join(fold.held for fold in folds)
    text = f"{n_test} movements; held out in turn, and met by what all others have taught: {held}."
    text += f" {n_refused} more are such as training refuses." if n_refused else ""
    return Source(folder.name, text, folds, (ROLE,))


def reach_to_grasp(folder: Path) -> Source:
    """Return reaches and returns of ``kinesis_reach_to_grasp``, a ninth of its trials in turn held out."""
    trials: dict[int, list[Row]] = {}
    for row in read_rows(folder / "rtg_trials.csv"):
        trials.setdefault(int(row["trial"]), []).append(row)
    fingers = {trial: finger(rows) for trial, rows in trials.items()}
    found = {trial: dict(reach_and_return(each)) for trial, each in fingers.items()}
    sound = {
        trial: usable([Demonstration(*each) for each in of.items() if not lost(each[1])])
        for trial, of in found.items()
    }
    folds = [
        Fold(
            f"trials {rest} mod {N_FOLDS}",
            [each for trial, of in sound.items() if trial % N_FOLDS != rest for each in of],
            [each for trial, of in sound.items() if trial % N_FOLDS == rest for each in of],
        )
        for rest in range(N_FOLDS)
    ]
    return Source(folder.name, _told(trials, fingers, [each for of in sound.values() for each in of]), folds)


def usable(shown: Iterable[Demonstration], roles: tuple[str, ...] = ()) -> list[Demonstration]:
    """Return the demonstrations that training does not refuse."""
    result = []
    for index, each in enumerate(shown):
        try:
            check_demonstration(index, each, FeatureSpecification(roles))
        except UnusableDemonstration:
            continue
        result.append(each)
    return result


def finger(rows: Sequence[Row]) -> Trajectory:
    """Return the index fingertip of a trial, z up [m], without what is no measurement.

    That are frames in which it is hidden, or stands to the last digit where it stood before, and those that
    come too soon.
    """
    times = np.array([float(row["time_s"]) for row in rows])
    x, y, z = track(rows, "index").T / 1000.0
    hand = np.column_stack([x, -z, y])
    hidden = np.array([row["fingers_occluded"] != "0" for row in rows])
    again = np.concatenate([[False], (hand[1:] == hand[:-1]).all(axis=1)])
    kept: list[int] = []
    for frame in np.flatnonzero(~(hidden | again | np.isnan(hand).any(axis=1))).tolist():
        if not kept or times[frame] - times[kept[-1]] >= NEXT_S:
            kept.append(frame)
    return Trajectory(times[kept], hand[kept])


def speed(motion: Trajectory) -> Floats:
    """Return (n_frames,) speeds over SPAN_S about every frame [m/s]."""
    before, after = (
        np.clip(motion.times + shift, motion.times[0], motion.times[-1])
        for shift in (-SPAN_S / 2, SPAN_S / 2)
    )
    way = np.column_stack(
        [np.interp(after, motion.times, of) - np.interp(before, motion.times, of) for of in motion.hand.T]
    )
    speeds: Floats = np.linalg.norm(way, axis=1) / (after - before)
    return speeds


def reach_and_return(motion: Trajectory) -> Iterator[tuple[str, Trajectory]]:
    """Yield the two movements of a trial by class."""
    speeds, times = speed(motion), motion.times
    begin, end = _run(speeds, times <= REACHED_S, times <= HELD_S)
    yield "reach", motion.part(begin, end)
    later = np.arange(len(times)) >= end
    yield "return", motion.part(*_run(speeds, later & (times >= RETURN_S), later))


def lost(motion: Trajectory) -> bool:
    """Return whether the finger is lost for long, or seems to leap."""
    lapse = np.diff(motion.times)
    steps = np.linalg.norm(np.diff(motion.hand, axis=0), axis=1)
    return bool((lapse > LOST_S).any() or (steps > FASTEST * lapse).any())


def _run(speeds: Floats, fastest: Flags, within: Flags) -> tuple[int, int]:
    """Return the run of frames, end exclusive, about the fastest of some frames; within: where it may lie."""
    top = int(np.argmax(np.where(fastest, speeds, -1.0)))
    slow = np.flatnonzero((speeds < STILL * speeds[top]) | ~within)
    place = int(np.searchsorted(slow, top))
    begin = int(slow[place - 1]) + 1 if place else 0
    return begin, int(slow[place]) if place < len(slow) else len(speeds)


def _told(
    trials: Mapping[int, Sequence[Row]], fingers: Mapping[int, Trajectory], sound: Sequence[Demonstration]
) -> str:
    """Return what was taken of the trials, and what was left out."""
    n_rows = sum(map(len, trials.values()))
    n_dropped = n_rows - sum(map(len, fingers.values()))
    n_kept = {name: sum(each.action == name for each in sound) for name in ("reach", "return")}
    moving = {"reach": 0, "return": 0}
    for each in sound:
        speeds = speed(each.trajectory)
        moving[each.action] += bool(speeds[0 if each.action == "reach" else -1] > MOVING * speeds.max())
    return TOLD.format(
        n_trials=len(trials),
        n_rows=n_rows,
        n_dropped=n_dropped,
        n_reaches=n_kept["reach"],
        n_returns=n_kept["return"],
        n_begun=moving["reach"],
        n_cut=moving["return"],
    )
