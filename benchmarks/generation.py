"""How like generated movements are to those that people and the simulator make, by which method.

    python benchmarks/generation.py [--data DIR] [--only NAME]... [--output PAGE]

DIR holds the folders of motion data, by default those beside the project. NAME is a source of movements or
``speed``; without ``--only`` everything is run.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from threadpoolctl import threadpool_limits

from app.motion.model import FeatureSpecification
from app.motion.simulation import demonstrations
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Demonstration, Floats
from benchmarks import page
from benchmarks.folders import SHARED
from benchmarks.generators import (
    AS_THEY_ARE,
    OURS,
    PEERS,
    Aligned,
    Generate,
    Probabilistic,
    align,
    shown_of,
    teach,
)
from benchmarks.likeness import BANDS, Likeness, at_phases, compare, mean
from benchmarks.movements import Source, elsewhere, of_folder, reach_to_grasp, simulated

SOURCES: dict[str, Callable[[Path], Source]] = {
    "simulated": lambda _: simulated(),
    "simulated elsewhere": lambda _: elsewhere(),
    "vmci_pick_place": lambda data: of_folder(data / "vmci_pick_place"),
    "kinesis_reach_to_grasp": lambda data: reach_to_grasp(data / "kinesis_reach_to_grasp"),
    "metaworld_scripted": lambda data: of_folder(data / "metaworld_scripted"),
}
FOLDERS = ("vmci_pick_place", "kinesis_reach_to_grasp", "metaworld_scripted")
REPORTED = ("metaworld_scripted",)
"""Nothing is asked of these: a scripted policy is no person."""

BEST = "every peer at its best"
SIMULATED = ("simulated", "simulated elsewhere")
SPEED = "speed"
MADE = "as it was made"
PROMP_MEAN = "ProMP, its mean"
HINDSIGHT = "ProMP, aligned, in hindsight"
Distance = Callable[[Likeness], float]
DISTANCES: dict[str, Distance] = {"RMSE": lambda of: of.apart, "DTW": lambda of: of.warped}

BETTER = 0.25
"""Ours has to be better than the best peer by this share."""

ENDS = 1e-9
"""And to miss no end point by more [m]."""

SLACK = {68: 5.0, 95: 3.0}
"""And to cover these shares, give or take [per cent]."""

SLOWEST = 1e-3
"""And to take no longer for N_POINTS points [s]."""

N_POINTS, N_CALLS, N_REPEATS = 100, 100, 9

INTRODUCTION = """\
Each movement that was held out is generated from its own first and last point and its duration, by methods
that were all taught the same others, and compared with what was made at 101 instants. *Ours* is `generate` of
the core as it is if nothing else is asked for; *the paper's* is its plain method (Sec. III-D). *DMP* (of the
mean demonstration; 20 basis functions) and *ProMP* (conditioned on both end points; 15 basis functions) are
those of `movement_primitives`, in the world as the library has them. The *minimum-jerk line* has learned
nothing. Then what can be made of them with knowledge of the test: *smooth* scaling of the DMP; weights of the
ProMP by *least squares*, 1 cm of spread added to each, instead of the library's expectation maximisation;
*aligned* they are taught in our frame of start and goal, where a movement to somewhere else is like one that
was shown. All of this, and the numbers of basis functions, was chosen as serves them best on these movements.

*RMSE*: root mean square distance at the same instants. *DTW*: mean distance of the points that dynamic time
warping pairs, which forgives timing. *Smoothness*: log dimensionless jerk of Balasubramanian et al. (2015):
the higher, the smoother; derivatives over a fifth of the movement (Savitzky and Golay, degree 5). *Ends*: the
worse missed end point. *In 68 %*, *in 95 %*: share of the held-out positions between the ends that lie within
1 and 1.96 standard deviations of those generated, by the world's axes. Figures are means over the test
movements of a class; those of several classes are means of theirs."""

OVERALL = f"""\
*{HINDSIGHT}* has learned the very test movements. It tells how much of a movement its start
and goal leave open: where there are many of a class, hardly anything can be closer."""

RATIOS = """\
Ours divided by each peer, class by class and by RMSE and DTW alike, and the mean of that: below 1 ours is
closer. Asked for is {asked:g} beside the best peer, that of the highest mean over the data. Of {reported}
nothing is asked."""

BESIDE = """\
Ours beside the best peer of each class. *Difference*: by how much the peer is farther off, and the standard
error of that over the test movements."""

TIMES = f"""\
Processor time of one movement of {N_POINTS} points on one thread: median of {N_REPEATS} means over {N_CALLS}
calls, with all that depends on start, goal and duration. *{PROMP_MEAN}*: without the standard deviation."""


@dataclass(frozen=True)
class Measured:
    """What was found of each method in each class of a source, movement by movement."""

    source: Source
    found: Mapping[str, Mapping[str, Sequence[Likeness]]]

    def of(self, method: str, action: str) -> Likeness:
        """Return the mean over a class."""
        return mean(self.found[method][action])

    def overall(self, method: str) -> Likeness:
        """Return the mean over the means of all classes."""
        return mean([self.of(method, action) for action in self.source.classes])

    def ratio(self, peer: str) -> float:
        """Return how many times as far off as a peer ours is: mean over the classes and distances."""
        pairs = [(self.of(OURS, action), self.of(peer, action)) for action in self.source.classes]
        return statistics.mean(
            distance(ours) / distance(theirs) for ours, theirs in pairs for distance in DISTANCES.values()
        )

    def best_peer(self, action: str, distance: Distance, peers: Sequence[str] = PEERS) -> str:
        """Return which peer is closest in a class by a distance."""
        return min(peers, key=lambda peer: distance(self.of(peer, action)))

    def lead(self, action: str, distance: Distance, peers: Sequence[str] = PEERS) -> Floats:
        """Return (n_movements,) how much farther off than ours the best peer is by a distance [m]."""
        best = self.best_peer(action, distance, peers)
        theirs, ours = ([distance(each) for each in self.found[of][action]] for of in (best, OURS))
        return np.array(theirs, dtype=np.float64) - ours


def measure(source: Source) -> Measured:
    """Return how like the movements of every method are to those held out."""
    found: dict[str, dict[str, list[Likeness]]] = {}

    def note(method: str, action: str, likeness: Likeness) -> None:
        found.setdefault(method, {}).setdefault(action, []).append(likeness)

    for fold in source.folds:
        model = fit_model(fold.training, FeatureSpecification(source.roles), TrainingOptions())
        taught = {
            action: {**teach(action, fold.training, model), HINDSIGHT: in_hindsight(action, fold.test)}
            for action in source.classes
        }
        for each in fold.test:
            made, times = at_phases(each.trajectory), each.trajectory.times
            for name, generate in taught[each.action].items():
                generated = generate(made[0], made[-1], float(times[-1] - times[0]))
                note(name, each.action, compare(made, *generated))
            note(MADE, each.action, compare(made, made))
    return Measured(source, found)


def in_hindsight(action: str, test: Sequence[Demonstration]) -> Generate:
    """Return a method that has learned the very movements by which it will be tested."""
    return Aligned(Probabilistic([align(each) for each in shown_of(action, test)], least_squares=True))


def speeds() -> dict[str, float]:
    """Return the processor time of a movement of N_POINTS points by each method [s]."""
    shown = demonstrations(1)
    taught = teach("grasp", shown, fit_model(shown, FeatureSpecification(("object",)), TrainingOptions()))
    taught[PROMP_MEAN] = Probabilistic(shown_of("grasp", shown), least_squares=True, tells_std=False)
    with threadpool_limits(limits=1):
        return {name: processor_time(generate) for name, generate in taught.items()}


def processor_time(generate: Generate) -> float:
    """Return the processor time of a movement [s]."""
    start, goal = np.array([0.0, 0.0, 0.02]), np.array([0.1, 0.3, 0.04])
    repeats = []
    for _ in range(N_REPEATS):
        begin = time.process_time()
        for _ in range(N_CALLS):
            generate(start, goal, 0.8, N_POINTS)
        repeats.append((time.process_time() - begin) / N_CALLS)
    return statistics.median(repeats)


def asked(measured: Sequence[Measured], times: Mapping[str, float]) -> Iterator[page.Goal]:
    """Yield what is asked for, as far as it was measured."""
    counted = [each for each in measured if each.source.name not in REPORTED]
    if counted:
        for of, peers in ((f"every peer ({', '.join(AS_THEY_ARE)})", AS_THEY_ARE), (BEST, PEERS)):
            yield _closer_everywhere(counted, of, peers)
            yield _closer_overall(counted, of, peers)
        ends = max(of.ends for each in measured for one in each.found[OURS].values() for of in one)
        yield page.Goal(f"end points missed by {ENDS:g} m at most", f"{ends:.2g} m", ends <= ENDS)
    for each in measured:
        if each.source.name in SIMULATED:
            yield _covered(each)
    if times:
        yield _soon(times)


def _closer_everywhere(counted: Sequence[Measured], of: str, peers: Sequence[str]) -> page.Goal:
    ahead = {
        each.source.name: [
            each.lead(action, distance, peers).mean() > 0.0
            for action in each.source.classes
            for distance in DISTANCES.values()
        ]
        for each in counted
    }
    told = ", ".join(f"{name} {sum(each)} of {len(each)}" for name, each in ahead.items())
    met = all(all(each) for each in ahead.values())
    return page.Goal(f"closer than {of} in every class, by RMSE and by DTW", told, met)


def _closer_overall(counted: Sequence[Measured], of: str, peers: Sequence[str]) -> page.Goal:
    ratios = {peer: statistics.mean(each.ratio(peer) for each in counted) for peer in peers}
    best = max(peers, key=lambda peer: ratios[peer])
    by_source = ", ".join(
        f"{each.source.name} {each.ratio(peer):.2f} ({peer})"
        for each in counted
        for peer in [max(peers, key=each.ratio)]
    )
    return page.Goal(
        f"{100 * BETTER:g} % closer overall than {of}: at most {1.0 - BETTER:g} of the distance of the best",
        f"{ratios[best]:.2f} ({best}); {by_source}",
        ratios[best] <= 1.0 - BETTER,
    )


def _covered(measured: Measured) -> page.Goal:
    inside = dict(zip(BANDS, 100 * measured.overall(OURS).inside, strict=True))
    bands = " and ".join(f"{per_cent} ± {slack:g} %" for per_cent, slack in SLACK.items())
    return page.Goal(
        f"{measured.source.name}: {bands} of the positions in the bands, by axis",
        "; ".join(f"{per_cent} %: {_axes(of)}" for per_cent, of in inside.items()),
        all((np.abs(of - per_cent) <= SLACK[per_cent]).all() for per_cent, of in inside.items()),
    )


def _soon(times: Mapping[str, float]) -> page.Goal:
    rivals = {name: of for name, of in times.items() if name.startswith(("DMP", "ProMP"))}
    alone = rivals.pop(PROMP_MEAN)
    soonest = min(rivals, key=lambda name: rivals[name])
    return page.Goal(
        f"{N_POINTS} points in {1000 * SLOWEST:g} ms of processor time, sooner than DMP and ProMP",
        f"{1000 * times[OURS]:.2f} ms; {soonest}: {1000 * rivals[soonest]:.2f} ms; "
        f"{PROMP_MEAN}, which tells no more than positions: {1000 * alone:.2f} ms",
        times[OURS] <= min(SLOWEST, rivals[soonest]),
    )


def overall(measured: Sequence[Measured]) -> str:
    """Return the section that puts all data side by side."""
    names = [each.source.name for each in measured]
    parts = [f"## Overall\n\n{OVERALL}\n"]
    for name, distance in DISTANCES.items():
        rows = [
            [method, *(f"{100 * distance(each.overall(method)):.2f}" for each in measured)]
            for method in (OURS, *PEERS, HINDSIGHT)
        ]
        parts.append(page.table([f"{name} [cm]", *names], rows))
    ratios = [[peer, *(f"{each.ratio(peer):.2f}" for each in measured)] for peer in PEERS]
    parts.append(RATIOS.format(asked=1.0 - BETTER, reported=", ".join(REPORTED)) + "\n")
    parts.append(page.table(["ours by", *names], ratios))
    rows = [row for each in measured for row in _beside(each)]
    columns = ["source", "class", "distance", "best peer", "ours [cm]", "peer [cm]", "difference [mm]"]
    parts.append(f"{BESIDE}\n\n{page.table(columns, rows, n_words=4)}")
    return "\n".join(parts)


def _beside(measured: Measured) -> Iterator[list[str]]:
    """Yield a row for each class and distance: ours and its best peer."""
    for action in measured.source.classes:
        for name, distance in DISTANCES.items():
            best, lead = measured.best_peer(action, distance), measured.lead(action, distance)
            distances = (f"{100 * distance(measured.of(method, action)):.2f}" for method in (OURS, best))
            error = lead.std(ddof=1) / np.sqrt(len(lead))
            difference = f"{1000 * lead.mean():+.1f} ± {1000 * error:.1f}"
            yield [measured.source.name, action, name, best, *distances, difference]


def section(measured: Measured) -> str:
    """Return the section of a source: distances by class, then all else."""
    classes = measured.source.classes
    columns = ["method", *(f"{action} ({len(measured.found[OURS][action])})" for action in classes)]
    parts = [f"## {measured.source.name}\n\n{measured.source.text}\n"]
    for name, distance in DISTANCES.items():
        parts.append(page.table([f"{name} [cm]", *columns[1:]], _distances(measured, distance)))
    of_bands = [f"in {per_cent} %, x / y / z" for per_cent in BANDS]
    rest = [_rest(method, measured.overall(method)) for method in (OURS, *PEERS, MADE)]
    parts.append(page.table(["over all classes", "smoothness", "ends [mm]", *of_bands], rest))
    by_class = [
        row
        for action in classes
        for row in (_rest(f"{action}, {of}", measured.of(of, action)) for of in (OURS, MADE))
    ]
    parts.append(page.table(["by class", "smoothness", "ends [mm]", *of_bands], by_class))
    return "\n".join(parts)


def _distances(measured: Measured, distance: Distance) -> Iterator[list[str]]:
    """Yield the rows of a distance by class; the shortest of each class is bold."""
    classes, methods = measured.source.classes, (OURS, *PEERS)
    table = {method: [distance(measured.of(method, action)) for action in classes] for method in methods}
    shortest = [min(column) for column in zip(*table.values(), strict=True)]
    for method, row in table.items():
        figures = [f"{100 * of:.2f}" for of in row]
        yield [
            method,
            *(
                f"**{figure}**" if of == least else figure
                for figure, of, least in zip(figures, row, shortest, strict=True)
            ),
        ]


def _rest(name: str, of: Likeness) -> list[str]:
    bands = ["" if np.isnan(inside).any() else _axes(100 * inside) for inside in of.inside]
    return [name, f"{of.smoothness:.2f}", f"{1000 * of.ends:.2g}", *bands]


def _axes(per_cent: Floats) -> str:
    return " / ".join(f"{of:.0f}" for of in per_cent)


def main() -> None:
    """Measure, print and write the page."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--data", type=Path, default=SHARED, help="holds the folders of motion data")
    options.add_argument("--only", action="append", help="a source or speed; may be given again")
    options.add_argument("--output", type=Path, help="page to write")
    given = options.parse_args()
    names = [*SOURCES, SPEED]
    wanted = given.only or [name for name in names if name not in FOLDERS or (given.data / name).is_dir()]
    if unknown := sorted(set(wanted) - set(names)):
        options.error(f"--only {', '.join(unknown)}: there are {', '.join(names)}")
    measured = []
    for name in (name for name in SOURCES if name in wanted):
        begin = time.monotonic()
        measured.append(measure(SOURCES[name](given.data)))
        page.tell(f"{name}: {time.monotonic() - begin:.0f} s")
    times = speeds() if SPEED in wanted else {}
    parts = [page.heading("Generation", INTRODUCTION), page.goals(asked(measured, times))]
    parts += [overall(measured), *map(section, measured)] if measured else []
    if times:
        rows = [[name, f"{1000 * of:.3f}"] for name, of in times.items()]
        parts.append(f"## Speed\n\n{TIMES}\n\n{page.table(['method', 'processor time [ms]'], rows)}")
    page.publish("\n".join(parts), given.output)


if __name__ == "__main__":
    main()
