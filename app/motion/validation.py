"""Class accuracy on correctly delineated segments: how well a model tells its own demonstrations apart.

Every demonstration is classified by a model that was trained without it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.motion.baum_welch import COMPILED, Estimator
from app.motion.criterion import Criterion
from app.motion.model import ActionModel, Model
from app.motion.roles import fillings
from app.motion.training import MIN_DEMONSTRATIONS, Example, TrainingOptions, examples_of, fit_action
from app.motion.trajectory import Demonstration, Indices

N_FOLDS = 3

Fitted = dict[tuple[int, ...], ActionModel]
"""Action models by the places of the demonstrations that they were fitted to."""


@dataclass(frozen=True)
class Validation:
    """Cross-validated classification of delineated demonstrations.

    n: demonstrations classified; accuracy: share of them that were classified right; per_class: that share
    by class; confusion: {true class: {class found: count}}.
    """

    n: int
    accuracy: float
    per_class: dict[str, float]
    confusion: dict[str, dict[str, int]]


def classify(model: Model, examples: Sequence[Example]) -> list[str]:
    """Return the class that each whole demonstration is of by the criterion of recognition."""
    found, filled = [], fillings(model.features.objects, model.features.objects)
    heights = {example.table_height for example in examples}
    criteria = {height: Criterion(model, height, filled) for height in heights}
    for example in examples:
        whole = np.array([[0, len(example.tracks.pace) - 1]])
        [of_classes] = criteria[example.table_height](example.tracks, whole).criterion
        found.append(model.names[int(of_classes.argmax())])
    return found


def cross_validate(
    model: Model,
    demonstrations: Sequence[Demonstration],
    options: TrainingOptions,
    before_fold: Callable[[], None] = lambda: None,
    folds: Indices | None = None,
    estimator: Estimator = COMPILED,
) -> Validation | None:
    """Return how models like ``model``, with its numbers of states, classify what they have not seen.

    None where no class can do without a demonstration.
    ``before_fold`` is called before each of the folds; what it raises ends the validation. folds: (n,) the
    one that each demonstration is left out in, -1 for none; by default classes are dealt out to N_FOLDS
    evenly, by ``options.seed``.
    """
    examples = examples_of(demonstrations, model.features)
    if folds is None:
        folds = _folds([example.action for example in examples], options.seed)
    pairs: Counter[tuple[str, str]] = Counter()
    fitted: Fitted = {}
    for fold in range(folds.max() + 1):
        before_fold()
        held = [example for example in examples if folds[example.place] == fold]
        kept = [example for example in examples if folds[example.place] != fold]
        found = classify(_fit_like(model, kept, options, estimator, fitted), held)
        pairs.update((example.action, action) for example, action in zip(held, found, strict=True))
    return _validation(pairs)


def _folds(actions: Sequence[str], seed: int) -> Indices:
    """Return the fold of each demonstration, -1 for those of classes too small to do without one."""
    rng, folds = np.random.default_rng(seed), np.full(len(actions), -1)
    for action in sorted(set(actions)):
        [members] = np.nonzero(np.array(actions) == action)
        if len(members) > MIN_DEMONSTRATIONS:
            folds[members] = rng.permutation(len(members)) % N_FOLDS
    return folds


def _fit_like(
    model: Model,
    examples: Sequence[Example],
    options: TrainingOptions,
    estimator: Estimator,
    fitted: Fitted,
) -> Model:
    """Return a model like ``model``, but fitted to these examples; what is new is added to ``fitted``."""
    actions = []
    for known in model.actions:
        of_class = [example for example in examples if example.action == known.action]
        places = tuple(example.place for example in of_class)
        if places not in fitted:
            alike = replace(options, n_states=known.n_states)
            fitted[places] = fit_action(of_class, model.features, alike, estimator)
        actions.append(fitted[places])
    return replace(model, actions=tuple(actions))


def _validation(pairs: Counter[tuple[str, str]]) -> Validation | None:
    if not pairs:
        return None
    confusion: dict[str, dict[str, int]] = {}
    for (true, found), count in sorted(pairs.items()):
        confusion.setdefault(true, {})[found] = count
    right = {true: row.get(true, 0) for true, row in confusion.items()}
    return Validation(
        n=pairs.total(),
        accuracy=sum(right.values()) / pairs.total(),
        per_class={true: right[true] / sum(row.values()) for true, row in confusion.items()},
        confusion=confusion,
    )
