"""How long training takes, with state selection and leave-one-out evaluation, against the same by hmmlearn.

python benchmarks/training_speed.py [--output PAGE]
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.motion.baum_welch import COMPILED, Estimator
from app.motion.by_hmmlearn import HMMLEARN
from app.motion.model import FeatureSpecification, Model
from app.motion.simulation import demonstrations
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Demonstration, Floats, Indices
from app.motion.validation import Validation, cross_validate
from app.motion.warming import warm
from benchmarks import page

N_RUNS = 3
EVERY = 4
"""By hmmlearn only every so-many-th demonstration is left out; with all, a run takes over half a minute."""

LEAST_TIMES = 20.0
"""What is asked for: how many times faster than hmmlearn."""

FEATURES, OPTIONS = FeatureSpecification(("object",)), TrainingOptions()

INTRODUCTION = """\
The paper's protocol, simulated ({shown} demonstrations, each run has its own): *training* conditions them,
chooses the number of states of each class and fits it; *leave-one-out* classifies each demonstration by a
model that was trained without it, with the numbers of states as chosen. The same code does both, with its own
compiled Baum-Welch and with hmmlearn's, one after the other in one process. By hmmlearn only every {every}th
demonstration is left out; the time is scaled by the number of classes that are fitted."""


@dataclass(frozen=True)
class Speed:
    """What training takes.

    compiled, by_hmmlearn: (n_runs, 2) times of training and of leave-one-out [s]; accuracy: (n_runs,) share
    of the demonstrations that are classified right; off: how far the means of the two are apart at most
    [standard deviations]; n_shown, n_left_out: demonstrations of a run, those that hmmlearn leaves out;
    alike: whether the two choose the same numbers of states and find the same classes.
    """

    compiled: Floats
    by_hmmlearn: Floats
    accuracy: Floats
    off: float
    n_shown: int
    n_left_out: int
    alike: bool

    @property
    def times(self) -> Floats:
        """(n_runs,) how many times faster it is compiled."""
        ratios: Floats = self.by_hmmlearn.sum(axis=1) / self.compiled.sum(axis=1)
        return ratios


def measure(n_runs: int = N_RUNS) -> Speed:
    """Train on the paper's protocol so many times, compiled and by hmmlearn."""
    warm()
    compiled, by_hmmlearn, accuracy, off, alike = [], [], [], [], []
    for seed in range(n_runs):
        shown = demonstrations(seed)
        everyone = np.arange(len(shown))
        some = np.where(everyone % EVERY == 0, everyone // EVERY, -1)
        model, whole, took = _timed(shown, everyone, COMPILED)
        other, part, took_other = _timed(shown, some, HMMLEARN)
        n_classes = len(model.actions)
        took_other[1] *= (len(shown) + n_classes) / (some.max() + 1 + n_classes)
        compiled.append(took)
        by_hmmlearn.append(took_other)
        accuracy.append(whole.accuracy)
        alike.append(_is_alike(model, other) and part == cross_validate(model, shown, OPTIONS, folds=some))
        off.append(_off(model, other) if alike[-1] else np.inf)
        page.tell(f"compiled {sum(took):.2f} s, by hmmlearn {sum(took_other):.1f} s")
    return Speed(
        np.array(compiled),
        np.array(by_hmmlearn),
        np.array(accuracy),
        max(off),
        len(shown),
        int(some.max()) + 1,
        all(alike),
    )


def _timed(
    shown: tuple[Demonstration, ...], folds: Indices, estimator: Estimator
) -> tuple[Model, Validation, list[float]]:
    """Return a model, how its like classify what they have not seen, and what both took [s]."""
    begin = time.perf_counter()
    model = fit_model(shown, FEATURES, OPTIONS, estimator=estimator)
    trained = time.perf_counter()
    found = cross_validate(model, shown, OPTIONS, folds=folds, estimator=estimator)
    ended = time.perf_counter()
    if found is None:
        raise RuntimeError("nothing was left out")
    return model, found, [trained - begin, ended - trained]


def _is_alike(model: Model, other: Model) -> bool:
    """Return whether two models have the same numbers of states."""
    return [action.n_states for action in model.actions] == [action.n_states for action in other.actions]


def _off(model: Model, other: Model) -> float:
    """Return how far the means of two models are apart at most [standard deviations]."""
    pairs = zip(model.actions, other.actions, strict=True)
    return max(float(np.max(np.abs(a.means - b.means) / np.sqrt(b.variances))) for a, b in pairs)


def section(found: Speed) -> tuple[str, list[page.Goal]]:
    """Return the section on the speed of training, and whether it is fast enough."""
    sides = (("compiled", found.compiled), ("by hmmlearn", found.by_hmmlearn))
    rows = [
        [f"{what}, {name} [s]", *_spread(values[:, part], 2)]
        for part, what in enumerate(("training", "leave-one-out"))
        for name, values in sides
    ]
    rows.append(["**both, hmmlearn / compiled**", *_spread(found.times, 0)])
    text = f"""\
By hmmlearn {found.n_left_out} of {found.n_shown} demonstrations are left out. Both choose the same numbers
of states and find the same classes: {"yes" if found.alike else "**no**"}; their means are at most
{found.off:.0e} standard deviations apart. Left out, {found.accuracy.min():.1%} are classified right in the
worst run."""
    times = float(np.median(found.times))
    goal = page.Goal(
        f"training and leave-one-out ≥ {LEAST_TIMES:g} times faster than through hmmlearn",
        f"{times:.0f} times",
        times >= LEAST_TIMES and found.alike,
    )
    head = f"## Training, {len(found.times)} times"
    return f"{head}\n\n{page.table(['', 'median', 'least', 'most'], rows)}\n{text}\n", [goal]


def _spread(values: Floats, digits: int) -> list[str]:
    return [f"{value:.{digits}f}" for value in (np.median(values), values.min(), values.max())]


def main() -> None:
    """Measure, print and write the page."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--output", type=Path, help="page to write")
    given = options.parse_args()
    found = measure()
    text, goals = section(found)
    head = page.heading("Training", INTRODUCTION.format(shown=found.n_shown, every=EVERY))
    page.publish("\n".join([head, page.goals(goals), text]), given.output)


if __name__ == "__main__":
    main()
