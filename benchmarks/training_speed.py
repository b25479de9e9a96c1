"""How fast it trains: the paper's protocol, compiled and through hmmlearn.

Run as ``python -m benchmarks.training_speed``.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.motion.baum_welch import COMPILED, Estimator
from app.motion.by_hmmlearn import HMMLEARN
from app.motion.model import FeatureSpecification, Model
from app.motion.simulation import demonstrations
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Demonstration, Floats, Indices
from app.motion.validation import Validation, cross_validate
from app.motion.warming import warm
from benchmarks import page

SEED = 0
FEATURES = FeatureSpecification(("object",))
REPETITIONS = 3

EVERY = 5
"""Of hmmlearn's folds one in so many is measured, and counts for the others."""

LEAST_RATIO = 20.0
"""How many times faster than through hmmlearn it must be."""

INTRODUCTION = """\
A model of the {n} simulated demonstrations of the paper's protocol: four classes, one object. *Fit*: numbers of
states chosen for each class (three folds, five candidates), then the model of all. *Leave one out*: each
demonstration classified by a model that was trained without it, with these numbers of states. Both estimators
run the same code but for Baum-Welch, likelihoods and best paths, in turn; {repetitions} pairs of runs, by the
time that the process has used of its core. Of the {n} folds through hmmlearn one in {every} is run and
measured, and counts for all. Both choose {states} states, and their models differ by at most {off:.1g} of a
parameter; accuracy is {accuracy:.1%}."""


@dataclass(frozen=True)
class Speed:
    """What training takes, through both estimators.

    compiled, hmmlearn: (n_repetitions, 2) seconds of a core for the fit and for leaving one out [s]; n:
    demonstrations; n_states: by class; off: largest relative difference of the parameters of the two models;
    accuracy: share of the demonstrations classified right, each by a model without it.
    """

    compiled: Floats
    hmmlearn: Floats
    n: int
    n_states: dict[str, int]
    off: float
    accuracy: float

    @property
    def ratio(self) -> Floats:
        """How many times faster the compiled one is, all in all: (n_repetitions,)."""
        of_runs: Floats = self.hmmlearn.sum(axis=1) / self.compiled.sum(axis=1)
        return of_runs


def measure(repetitions: int = REPETITIONS, every: int = EVERY) -> Speed:
    """Train and evaluate through both estimators, in turn; raise RuntimeError where they do not agree.

    every: of hmmlearn's folds one in so many is measured.
    """
    shown = demonstrations(SEED)
    alone = np.arange(len(shown))
    sampled = np.where(alone % every == 0, alone // every, -1)
    compiled, hmmlearn = np.empty((repetitions, 2)), np.empty((repetitions, 2))
    warm()
    for run in range(repetitions):
        compiled[run], ours, accuracy = timed(shown, COMPILED, alone)
        hmmlearn[run], theirs, _ = timed(shown, HMMLEARN, sampled)
        page.tell(f"compiled {compiled[run].sum():.2f} s, hmmlearn {hmmlearn[run].sum():.1f} s")
    return Speed(
        compiled,
        hmmlearn,
        n=len(shown),
        n_states={action.action: action.n_states for action in ours.actions},
        off=_difference(ours, theirs),
        accuracy=accuracy,
    )


def timed(
    shown: Sequence[Demonstration], estimator: Estimator, folds: Indices
) -> tuple[tuple[float, float], Model, float]:
    """Return what the fit and the whole evaluation take of a core [s], the model, and the accuracy."""
    begin, options = time.process_time(), TrainingOptions()
    model = fit_model(shown, FEATURES, options, estimator=estimator)
    fitted = time.process_time()
    found = cross_validate(model, shown, options, folds=folds, estimator=estimator)
    seconds = time.process_time() - fitted
    if not isinstance(found, Validation):
        raise RuntimeError("nothing was classified")
    return (fitted - begin, seconds * len(shown) / found.n), model, found.accuracy


def _difference(model: Model, other: Model) -> float:
    """Return the largest relative difference between the parameters of two models."""
    off = 0.0
    for one, two in zip(model.actions, other.actions, strict=True):
        if one.n_states != two.n_states:
            raise RuntimeError(f"{one.action} has {one.n_states} and {two.n_states} states")
        for name in ("means", "variances", "stay", "weights", "repetition"):
            ours, theirs = np.asarray(getattr(one, name)), np.asarray(getattr(two, name))
            off = max(off, float((np.abs(ours - theirs) / np.abs(theirs).max()).max()))
    return off


def section(speed: Speed) -> str:
    """Return the table of what was measured."""
    parts = zip(speed.compiled.T, speed.hmmlearn.T, ("fit", "leave one out"), strict=True)
    rows = [_row(name, "s", each) for *both, part in parts for name, each in _named(part, both)]
    rows += [_row(name, "s", each) for name, each in _named("all", _totals(speed))]
    rows.append(_row("**hmmlearn / compiled**", "", speed.ratio))
    return page.table(["", "median", "least", "most"], rows)


def _totals(speed: Speed) -> list[Floats]:
    return [speed.compiled.sum(axis=1), speed.hmmlearn.sum(axis=1)]


def _named(part: str, both: Sequence[Floats]) -> list[tuple[str, Floats]]:
    return [(f"{part}, {name}", each) for name, each in zip(("compiled", "hmmlearn"), both, strict=True)]


def _row(name: str, unit: str, values: Floats) -> list[str]:
    told = (float(np.median(values)), float(values.min()), float(values.max()))
    return [f"{name} [{unit}]" if unit else name, *(f"{value:.3g}" for value in told)]


def goal(speed: Speed) -> page.Goal:
    """Return whether it is fast enough."""
    found = float(np.median(speed.ratio))
    asked = f"state selection and leave-one-out ≥ {LEAST_RATIO:g} times faster than through hmmlearn"
    return page.Goal(asked, f"{found:.0f} times", found >= LEAST_RATIO)


def main() -> None:
    """Measure and print the page."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--output", type=Path, help="page to write")
    given = options.parse_args()
    speed = measure()
    text = INTRODUCTION.format(
        n=speed.n,
        repetitions=len(speed.ratio),
        every=EVERY,
        states=", ".join(f"{name} {n}" for name, n in speed.n_states.items()),
        off=speed.off,
        accuracy=speed.accuracy,
    )
    head = page.heading("Training", text)
    page.publish("\n".join([head, page.goals([goal(speed)]), section(speed)]), given.output)


if __name__ == "__main__":
    main()
