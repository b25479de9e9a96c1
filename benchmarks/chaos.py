"""Nothing acknowledged is lost: hundreds of kills under clients that write down what they are told.

python benchmarks/chaos.py [--rounds N] [--database D] [--seed S] [--part FILE] [--output PAGE]

With ``--part`` each act is added to a file as it ends, and the page is of all acts in the file: the rounds
may be run in several goes, each with a seed of its own, and what is interrupted keeps what it has.
"""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks import page
from tests.chaos.house import housing, postgresql
from tests.chaos.rounds import Act, play

Part = dict[str, Any]
ROUNDS, AN_ACT = 500, 25
"""Kills of each database, and after how many of them a new one begins."""
BACK_S = 0.5
"""How long clients may take to be back once the server is ready, p99 [s]."""
KINDS = ("lost", "doubled", "contradicted", "refused")

INTRODUCTION = """\
Three clients stream motion, eight times as fast as real time; one sends some frames twice, one sometimes \
too early, and somebody listens to the sessions of one. A teacher uploads, trains and promotes; an alias is \
moved to and fro twenty times a second. At a random moment something is killed with -9 and started again; \
when all streams have got on, the next round begins. All clients go on by themselves and write down what \
they are told.

Acts of {an_act} rounds with an odd seed have two servers on the database, and a client comes back to either \
by chance, also to the one that is being started again. A worker that is paused wakes four rounds later, \
when the other has long gone on with its job.

After every {an_act} rounds everything comes to its end and is compared: with what the server has then, and \
with the same motion through the recogniser undisturbed, event by event and bit by bit. *Lost*, *doubled* \
and *contradicted* count segments, events, frames, versions, demonstrations, jobs and moves of aliases; \
*refused* is an answer that a client had not deserved. Resume: from the first 200 of `/readyz` to the answer \
of a resumed session, for every client that was cut off; where another server is there, from the kill.
"""


def run(kind: str, n_rounds: int, seed: int, keep: Path) -> Part:
    """Play an act on a new database, of odd seeds with two servers; files that show a fault are kept."""
    with ExitStack() as stack:
        folder = Path(tempfile.mkdtemp(prefix="gesta-chaos-"))
        postgres = stack.enter_context(postgresql()) if kind == "postgresql" else None
        with housing(folder, postgres, n_servers=1 + seed % 2, n_workers=2) as house:
            act = play(house, kind, n_rounds, seed)
    if act.faults:
        shutil.copytree(folder, keep / f"{kind}-{seed}", dirs_exist_ok=True)
        for fault in act.faults:
            page.tell(f"{kind}, seed {seed}: {fault}")
    shutil.rmtree(folder)
    return _plain(kind, seed, act)


def _plain(kind: str, seed: int, act: Act) -> Part:
    faults = [asdict(fault) for fault in act.faults]
    return {
        "database": kind,
        "seed": seed,
        "rounds": act.rounds,
        "counts": act.counts,
        "resumed": act.resumed,
        "elsewhere": act.elsewhere,
        "faults": faults,
    }


def section(kind: str, parts: Sequence[Part]) -> tuple[str, list[page.Goal]]:
    """Return the section on a database, and what is asked for."""
    rounds, counts = _sum(part["rounds"] for part in parts), _sum(part["counts"] for part in parts)
    faults = Counter(fault["kind"] for part in parts for fault in part["faults"])
    n_back, p50, p99 = _times(parts, "resumed")
    names = {"sqlite": "SQLite", "postgresql": "PostgreSQL"}
    killed = page.table(["killed", "rounds"], [[what, f"{n:,}"] for what, n in sorted(rounds.items())])
    acknowledged = page.table(["told", "number"], [[what, f"{n:,}"] for what, n in counts.items()])
    found = page.table(["found", "number"], [[each, str(faults[each])] for each in KINDS])
    resume = f"Resume: median {p50 * 1e3:.0f} ms, p99 {p99 * 1e3:.0f} ms, of {n_back:,}."
    n_back, median, most = _times(parts, "elsewhere")
    resume += f" At another server: median {median:.2f} s, p99 {most:.2f} s after the kill, of {n_back:,}."
    text = "\n".join([f"## {names[kind]}", "", killed, acknowledged, found, resume, ""])
    n_rounds, n_faults = rounds.total(), sum(faults.values())
    return text, [
        page.Goal(f"{names[kind]}: ≥ {ROUNDS} rounds", f"{n_rounds:,}", n_rounds >= ROUNDS),
        page.Goal(f"{names[kind]}: none lost, doubled, contradicted or refused", f"{n_faults}", not n_faults),
        page.Goal(f"{names[kind]}: resume ≤ {BACK_S:g} s (p99)", f"{p99:.2f} s", bool(p99 <= BACK_S)),
    ]


def _times(parts: Sequence[Part], name: str) -> tuple[int, float, float]:
    """Return how many times there are, their median and their 99th percentile [s]."""
    times = np.array([value for part in parts for value in part[name]])
    if len(times) == 0:
        return 0, np.inf, np.inf
    median, most = np.percentile(times, [50, 99], method="higher").tolist()
    return len(times), median, most


def _sum(counted: Iterable[dict[str, int]]) -> Counter[str]:
    total = Counter[str]()
    for counts in counted:
        total.update(counts)
    return total


def written(parts: Sequence[Part]) -> str:
    """Return the page."""
    of = {kind: [part for part in parts if part["database"] == kind] for kind in ("sqlite", "postgresql")}
    sections = [section(kind, some) for kind, some in of.items() if some]
    goals = [goal for _, goals in sections for goal in goals]
    head = page.heading("Chaos", INTRODUCTION.format(an_act=AN_ACT))
    return "\n".join([head, page.goals(goals), *(text for text, _ in sections)])


def _options() -> argparse.Namespace:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--rounds", type=int, default=ROUNDS, help="kills of each database")
    options.add_argument("--database", choices=["sqlite", "postgresql", "both"], default="both")
    options.add_argument("--seed", type=int, default=0, help="of the first act; each has the next")
    options.add_argument("--part", type=Path, help="file that every act is added to")
    options.add_argument(
        "--keep",
        type=Path,
        default=Path(tempfile.gettempdir()) / "gesta-chaos",
        help="where what went wrong is kept",
    )
    options.add_argument("--output", type=Path, help="page to write")
    return options.parse_args()


def main() -> None:
    """Play the rounds, print and write the page; a first interrupt ends the act that is played."""
    given = _options()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    parts: list[Part] = json.loads(given.part.read_text()) if given.part and given.part.exists() else []
    kinds = ["sqlite", "postgresql"] if given.database == "both" else [given.database]
    acts = [
        (kind, min(AN_ACT, given.rounds - first), given.seed + first // AN_ACT)
        for first in range(0, given.rounds, AN_ACT)
        for kind in kinds
    ]
    try:
        for kind, n_rounds, seed in acts:
            parts.append(run(kind, n_rounds, seed, given.keep))
            page.tell(f"{kind}, seed {seed}: {dict(parts[-1]['counts'])}, {len(parts[-1]['faults'])} faults")
            if given.part:
                given.part.write_text(json.dumps(parts))
    except KeyboardInterrupt:
        page.tell("interrupted; what was finished counts")
    page.publish(written(parts), given.output)


if __name__ == "__main__":
    main()
