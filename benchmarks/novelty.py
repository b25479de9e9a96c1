"""Unknown actions: a class that was left out of training must stand out, and no known one may."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from statistics import mean

import numpy as np
from sklearn.metrics import roc_auc_score

from app.motion.model import Model
from app.motion.trajectory import Floats, Recording
from benchmarks import page
from benchmarks.comparison import told
from benchmarks.matching import matched
from benchmarks.methods import Core, model_of
from benchmarks.teaching import Source, model, shown, tests

AUROC, LOST = 0.98, 0.02
"""What is asked for: the mean over the classes left out, and the share of known actions called unknown."""

TEXT = """\
Trained without one class, a model is tested on all of them. *AUROC* is that of the novelty of the found
segments that match a true one at 0.5, whatever the class: left-out class against known ones, mean over
training seeds or folds. A segment of the left-out class that nothing matches counts as found out; a known one
that nothing matches does not count. *Lost* is the share of true segments that the full model finds and calls
unknown."""


@dataclass(frozen=True)
class Result:
    """How well a class stands out that was left out of training, None where the tests do not show it."""

    source: str
    left_out: str
    auroc: float | None


@dataclass(frozen=True)
class Lost:
    """Known actions, and those of them that are found and called unknown."""

    source: str
    n_known: int
    n_lost: int


def standing_out(source: Source, left_out: str, n_sequences: int) -> Result:
    """Return how well a class stands out if it is left out of what is learned from a source."""
    trained = model_of([each for each in shown(source) if each.action != left_out])
    recordings = [each.recording for each in tests(source, n_sequences)]
    novelty, is_new = novelties(trained, recordings, left_out)
    return Result(source.title, left_out, auroc(novelty, is_new))


def novelties(trained: Model, recordings: Sequence[Recording], left_out: str) -> tuple[Floats, Floats]:
    """Return (n,) the novelty of what is found [nat per frame], inf for nothing, and 1 for a new class."""
    novelty, is_new = [], []
    for each in recordings:
        found = matched(each.trajectory.times, each.segments, Core(trained).events(each.trajectory))
        for truth, match in zip(each.segments, found, strict=True):
            new = truth.action == left_out
            if match is not None or new:
                novelty.append(match.novelty if match is not None else np.inf)
                is_new.append(float(new))
    return np.array(novelty), np.array(is_new)


def auroc(novelty: Floats, is_new: Floats) -> float | None:
    """Return the probability that a new one is more novel than a known one; (n,) each, inf allowed.

    None where there are none of either.
    """
    if len(np.unique(is_new)) < 2:
        return None
    ranks = np.unique(novelty, return_inverse=True)[1]
    return float(roc_auc_score(is_new, ranks))


def losses(source: Source, n_sequences: int) -> Lost:
    """Return how many known actions the full model of a source loses."""
    n_known, n_lost = 0, 0
    for each in (labelled.recording for labelled in tests(source, n_sequences)):
        found = matched(each.trajectory.times, each.segments, Core(model(source)).events(each.trajectory))
        n_known += len(found)
        n_lost += sum(match is not None and match.action is None for match in found)
    return Lost(source.title, n_known, n_lost)


def section(pool: Executor, sources: Sequence[Source], n_sequences: int) -> tuple[str, list[page.Goal]]:
    """Return the section on unknown actions, and whether what is asked of it is met."""
    classes = {source: sorted({each.action for each in shown(source)}) for source in sources}
    jobs = [
        pool.submit(standing_out, source, left_out, n_sequences)
        for source, names in classes.items()
        for left_out in names
    ]
    losing = [pool.submit(losses, source, n_sequences) for source in sources]
    results = [result for job in jobs if (result := job.result()).auroc is not None]
    lost = [job.result() for job in losing]
    rows, goals = [], []
    for title in dict.fromkeys(source.title for source in sources):
        of_source = [each for each in results if each.source == title]
        names = list(dict.fromkeys(each.left_out for each in of_source))
        values = [mean(each.auroc or 0.0 for each in of_source if each.left_out == name) for name in names]
        rows += [[title, name, told(value), ""] for name, value in zip(names, values, strict=True)]
        known = sum(each.n_known for each in lost if each.source == title)
        share = sum(each.n_lost for each in lost if each.source == title) / known
        rows.append([title, "**mean**", told(mean(values)), told(share)])
        goals += [
            page.Goal(
                f"{title}: AUROC of classes left out ≥ {AUROC:g}", told(mean(values)), mean(values) >= AUROC
            ),
            page.Goal(f"{title}: known actions lost ≤ {LOST:g}", told(share), share <= LOST),
        ]
    table = page.table(["", "left out", "AUROC", "lost"], rows, n_words=2)
    return f"## Unknown actions\n\n{TEXT}\n\n{table}", goals
