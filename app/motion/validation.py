"""Class accuracy on correctly delineated segments: how well a model tells its own demonstrations apart.

Every demonstration is classified by a model that was trained without it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.motion.criterion import Criterion
from app.motion.model import ActionModel, Model
from app.motion.roles import fillings
from app.motion.training import MIN_DEMONSTRATIONS, TrainingOptions, conditioned, fit_model
from app.motion.trajectory import Demonstration

N_FOLDS = 3


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


def classify(model: Model, demonstrations: Sequence[Demonstration]) -> list[str]:
    """Return the class that each whole demonstration is of by the criterion of recognition."""
    found, roles = [], model.features.objects
    for demonstration in demonstrations:
        tracks = conditioned(demonstration, model.features)
        criterion = Criterion(model, demonstration.scene.table_height, fillings(roles, roles))
        [of_classes] = criterion(tracks, np.array([[0, len(tracks.pace) - 1]])).criterion
        found.append(model.names[int(of_classes.argmax())])
    return found


def cross_validate(
    model: Model,
    demonstrations: Sequence[Demonstration],
    options: TrainingOptions,
    before_fold: Callable[[], None] = lambda: None,
) -> Validation | None:
    """Return how models like ``model``, with its numbers of states, classify what they have not seen.

    None where no class can do without a demonstration.
    ``before_fold`` is called before each of the folds; what it raises ends the validation. Classes are dealt
    out to the folds evenly, by ``options.seed``.
    """
    folds = _folds([demonstration.action for demonstration in demonstrations], options.seed)
    pairs: Counter[tuple[str, str]] = Counter()
    for fold in range(N_FOLDS):
        before_fold()
        held = [shown for shown, of in zip(demonstrations, folds, strict=True) if of == fold]
        if held:
            kept = [shown for shown, of in zip(demonstrations, folds, strict=True) if of != fold]
            found = classify(_fit_like(model, kept, options), held)
            pairs.update((d.action, action) for d, action in zip(held, found, strict=True))
    return _validation(pairs)


def _folds(actions: Sequence[str], seed: int) -> NDArray[np.int64]:
    """Return the fold of each demonstration, -1 for those of classes too small to do without one."""
    rng, folds = np.random.default_rng(seed), np.full(len(actions), -1)
    for action in sorted(set(actions)):
        [members] = np.nonzero(np.array(actions) == action)
        if len(members) > MIN_DEMONSTRATIONS:
            folds[members] = rng.permutation(len(members)) % N_FOLDS
    return folds


def _fit_like(model: Model, demonstrations: Sequence[Demonstration], options: TrainingOptions) -> Model:
    actions: list[ActionModel] = []
    for known in model.actions:
        of_class = [shown for shown in demonstrations if shown.action == known.action]
        alike = replace(options, n_states=known.n_states)
        actions += fit_model(of_class, model.features, alike).actions
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
