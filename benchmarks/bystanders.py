"""Several objects: which of those on the table is the one that is manipulated."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from app.motion.simulation import REST_POINT, Conditions
from app.motion.trajectory import Floats, Recording, Trajectory
from benchmarks import page
from benchmarks.comparison import told
from benchmarks.folders import ROLE
from benchmarks.matching import matched
from benchmarks.methods import Core
from benchmarks.teaching import Source, model, tests

NAMES = ("amber", "birch", "cedar")
"""Of the objects; none is called like the role."""

DISTANCES = (0.15, 0.45)
"""Between these from the rest point stand the bystanders [m]."""

APART = 0.08
"""At least so far from where the manipulated object ever stands, and from each other [m]."""

NAMED = 0.99
"""What is asked for."""

TEXT = """\
The simulator's clean sequences with two more objects standing on the table, {near:g}-{far:g} m from the rest
point and at least {apart:g} m from wherever the manipulated one stands; no name says which is which. *Named*
is the share of the found segments that match a true one at 0.5 and name the manipulated object, over all
training seeds; *matched* the share of true segments that are matched."""


@dataclass(frozen=True)
class Counts:
    """True segments, those that are matched, and those of which the right object is named."""

    n_true: int
    n_matched: int
    n_named: int


def with_bystanders(recording: Recording, seed: int) -> tuple[Recording, str]:
    """Return a simulated recording with two more objects, and the name of the manipulated one."""
    rng = np.random.default_rng(seed)
    motion = recording.trajectory
    moved = motion.objects[ROLE]
    last = len(motion) - 1
    at = [frame for each in recording.segments for frame in (each.start, min(each.end, last))]
    taken = list(moved[at])
    tracks = [moved]
    for _ in NAMES[1:]:
        place = _place(rng)
        while min(float(np.linalg.norm(place - other)) for other in taken) < APART:
            place = _place(rng)
        taken.append(place)
        tracks.append(place + rng.normal(0.0, Conditions().noise, moved.shape))
    names = [NAMES[index] for index in rng.permutation(len(NAMES)).tolist()]
    order = rng.permutation(len(names)).tolist()
    objects = {names[index]: tracks[index] for index in order}
    among = Recording(Trajectory(motion.times, motion.hand, objects), recording.segments, recording.scene)
    return among, names[0]


def _place(rng: np.random.Generator) -> Floats:
    """Return a random place on the table, where a marker has the height of the object's [m]."""
    distance, angle = rng.uniform(*DISTANCES), rng.uniform(-np.pi / 2, np.pi / 2)
    return np.array([REST_POINT[0], REST_POINT[1], 0.0]) + distance * np.array(
        [np.sin(angle), np.cos(angle), 0.0]
    )


def naming(source: Source, n_sequences: int) -> Counts:
    """Return how often the manipulated object is named."""
    core = Core(model(source))
    n_true = n_matched = n_named = 0
    for seed, labelled in enumerate(tests(source, n_sequences)):
        among, manipulated = with_bystanders(labelled.recording, seed)
        found = matched(among.trajectory.times, among.segments, core.events(among.trajectory))
        n_true += len(found)
        n_matched += sum(match is not None for match in found)
        n_named += sum(match is not None and match.objects[ROLE] == manipulated for match in found)
    return Counts(n_true, n_matched, n_named)


def section(pool: Executor, sources: Sequence[Source], n_sequences: int) -> tuple[str, list[page.Goal]]:
    """Return the section on several objects, and whether what is asked of it is met; of the simulator."""
    jobs = [pool.submit(naming, source, n_sequences) for source in sources]
    counts = [job.result() for job in jobs]
    n_true, n_matched, n_named = (
        sum(getattr(each, name) for each in counts) for name in ("n_true", "n_matched", "n_named")
    )
    named = n_named / max(n_matched, 1)
    text = TEXT.format(near=DISTANCES[0], far=DISTANCES[1], apart=APART)
    row = [str(n_true), told(n_matched / n_true), told(named)]
    goal = page.Goal(f"three objects: the manipulated one named ≥ {NAMED:g}", told(named), named >= NAMED)
    return f"## Several objects\n\n{text}\n\n{page.table(['true', 'matched', 'named'], [row], 0)}", [goal]
