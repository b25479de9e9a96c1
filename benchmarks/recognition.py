"""How well actions are recognised, by which method, under which conditions: on simulated and on real motion.

    python benchmarks/recognition.py [--data DIR]... [--seeds N] [--sequences N] [--only NAME]...
        [--output PAGE]

Every folder is laid out like ``vmci_pick_place``; without ``--data`` all that are known are run. NAME is a
condition, a folder, or one of the sections; without ``--only`` everything is run.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.motion.simulation import demonstrations
from benchmarks import anticipation, bystanders, delay, learning, novelty, page
from benchmarks.asked import asked
from benchmarks.comparison import REAL, SIMULATED, compare
from benchmarks.conditions import COLUMNS, LONG_ACTIONS, N_ACTIONS, N_LONG
from benchmarks.folders import known_folders
from benchmarks.methods import Core
from benchmarks.served import server, teach_demonstrations
from benchmarks.teaching import Source, by_person, folds, simulator

N_SEEDS, N_SEQUENCES = 5, 107
"""By default; the paper's test has so many sequences (Sec. IV-A)."""

N_SERVED = 10
"""Sequences that go through a server, too."""

INTRODUCTION = """\
*Ours* is `recognise` of the core as it is if nothing else is asked for; *Steps 1-3* is the paper's search and
*greedy* its Step 1 alone, with the same models. *One HMM* joins left-right HMMs on positions or velocities in
the world and decodes the whole with Viterbi (hmmlearn). *Change points* cuts where the directions of hand and
object change (ruptures, penalty set on the demonstrations) and classifies the pieces with our criterion.
The *garbage model* is that of Elmezain, Al-Hamadi and Michaelis (ICIP 2009), the paper's reference [5]. All
are trained on the same demonstrations. The measures are those of `app.motion.evaluation`: *classified* is the
share of the delineated actions whose class is right; standing still is rest, and *in rest* is the share
of its frames in which an action was found; an *extra* segment matches no true one at 0.5, whatever its
class.

Where another method is ahead: *Steps 1-3* and *greedy* are not quite those of the paper here; they observe
what ours observes and go by our criterion, and only the search is theirs. It decides once the successor is
complete, seconds later, with more evidence than ours waits for. That is worth a few actions where noise or
sweeps make the evidence thin, and where a person hesitates. Methods that know no rest give it to the actions
beside it: that adds *frames* where actions follow each other after short pauses, at the cost of *in rest* and
F1@75."""

SIMULATOR = """\
The paper's protocol (Sec. IV-A): trained on clean demonstrations of four actions at six places, {n} sequences
of {actions} actions at places nobody demonstrated; of {long} actions {n_long}. Medians over {seeds} seed(s)
of training, each with sequences of its own. At other rates and jittered, the motion is that of the clean
ones."""

FOLDERS = """\
Trained on what all other people show and tested on one, each in turn; where names are no people's, trained on
one half of the sequences and tested on the other. *Joined*: longer recordings of several runs. Means over the
folds."""

SERVED = """\
The clean sequences of the first seed, streamed to a real server that was taught the same demonstrations."""


@dataclass(frozen=True)
class Scale:
    """How much is run; compared: the folders in which methods are compared, the sections use all."""

    n_seeds: int
    n_sequences: int
    folders: Sequence[Path]
    compared: Sequence[Path]
    columns: Sequence[str]
    output: Path | None

    @property
    def simulators(self) -> list[Source]:
        """The simulator, trained with each seed."""
        return [simulator(seed) for seed in range(self.n_seeds)]

    def folds(self, people: Collection[bool] = (True, False)) -> list[Source]:
        """Return the folds of the folders that are, or are not, by person."""
        return [source for folder in self.folders if by_person(folder) in people for source in folds(folder)]


Part = tuple[str, list[page.Goal]]


def comparison(pool: Executor, scale: Scale) -> Part:
    """Return the sections that compare methods, and whether what is asked of them is met."""
    compared = compare(pool, scale.n_seeds, scale.n_sequences, scale.columns, scale.compared)
    parts = []
    if scale.columns:
        text = SIMULATOR.format(
            n=scale.n_sequences,
            actions=N_ACTIONS,
            long=LONG_ACTIONS,
            n_long=min(N_LONG, scale.n_sequences),
            seeds=scale.n_seeds,
        )
        parts.append(f"## Simulated\n\n{text}\n\n{compared.tables(SIMULATED, compared.simulated)}")
    if compared.real:
        parts.append(f"## Recorded\n\n{FOLDERS}\n\n{compared.tables(REAL, compared.real)}")
        parts.append(f"### Each fold\n\n{compared.details()}")
    return "\n".join(parts), asked(compared, scale.compared)


def through_server(n_sequences: int) -> Part:
    """Return whether a server finds what is found in this process."""
    recordings = COLUMNS["clean"].recordings(0, min(n_sequences, N_SERVED))
    with server() as client:
        taught = teach_demonstrations(client, "simulated", demonstrations(0))
        theirs = [taught.recognise(each.trajectory) for each in recordings]
    ours = [Core(taught.model)(each.trajectory) for each in recordings]
    same = sum(a == b for a, b in zip(ours, theirs, strict=True))
    row = [str(len(recordings)), str(sum(map(len, theirs))), str(sum(map(len, ours))), str(same)]
    names = ["sequences", "segments by the server", "in this process", "sequences with the same segments"]
    goal = page.Goal(
        "through a server: the same segments", f"{same} of {len(recordings)}", same == len(recordings)
    )
    return f"## Through a server\n\n{SERVED}\n\n{page.table(names, [row], n_words=0)}", [goal]


SERVER = "server"
SECTIONS: dict[str, Callable[[Executor, Scale], Part]] = {
    "unknown": lambda pool, scale: novelty.section(
        pool, [*scale.simulators, *scale.folds(people=[False])], scale.n_sequences
    ),
    "objects": lambda pool, scale: bystanders.section(pool, scale.simulators, scale.n_sequences),
    "soon": lambda pool, scale: delay.section(
        pool, [*scale.simulators, *scale.folds()], scale.n_sequences, scale.output
    ),
    "before": lambda pool, scale: anticipation.section(
        pool, [*scale.simulators, *scale.folds()], scale.n_sequences
    ),
    "learning": lambda pool, scale: learning.section(pool, scale.folds(people=[True])),
}


def main() -> None:
    """Measure, print and write the page."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--data", type=Path, action="append", help="a folder; may be given again")
    options.add_argument("--seeds", type=int, default=N_SEEDS, help="of the simulator's demonstrations")
    options.add_argument("--sequences", type=int, default=N_SEQUENCES, help="simulated for each seed")
    options.add_argument("--only", action="append", help="a condition, folder or section; may be given again")
    options.add_argument("--output", type=Path, help="page to write; images go beside it")
    given = options.parse_args()
    folders = [folder.resolve() for folder in given.data or known_folders()]
    names = [*COLUMNS, *(folder.name for folder in folders), SERVER, *SECTIONS]
    wanted = given.only or names
    if unknown := sorted(set(wanted) - set(names)):
        options.error(f"--only {', '.join(unknown)}: there are {', '.join(names)}")
    chosen = [folder for folder in folders if folder.name in wanted]
    columns = [name for name in COLUMNS if name in wanted]
    scale = Scale(given.seeds, given.sequences, folders, chosen, columns, given.output)
    served = [through_server(given.sequences)] if SERVER in wanted else []
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        parts = [comparison(pool, scale), *served] if columns or chosen else served
        for name in (name for name in SECTIONS if name in wanted):
            begin = time.monotonic()
            parts.append(SECTIONS[name](pool, scale))
            page.tell(f"{name}: {time.monotonic() - begin:.0f} s")
    goals = [goal for _, of_part in parts for goal in of_part]
    sections = [page.heading("Recognition", INTRODUCTION), page.goals(goals), *(text for text, _ in parts)]
    page.publish("\n".join(sections), given.output)


if __name__ == "__main__":
    main()
