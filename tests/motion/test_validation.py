"""Cross-validation: nothing is classified by a model that has seen it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from app.motion import validation
from app.motion.by_hmmlearn import HMMLEARN
from app.motion.model import ActionModel, FeatureSpecification, Model
from app.motion.simulation import STYLES, demonstrations
from app.motion.training import Example, TrainingOptions, fit_action, fit_model
from app.motion.trajectory import Demonstration, Indices
from app.motion.validation import classify, cross_validate

SPECIFICATION = FeatureSpecification(("object",))
OPTIONS = TrainingOptions(n_states=4)
SHOWN = [d for action in STYLES for d in [x for x in demonstrations(7) if x.action == action][::8]]


@pytest.fixture(scope="module")
def model() -> Model:
    return fit_model(SHOWN, SPECIFICATION, OPTIONS)


def test_classes_that_differ_are_told_apart(model: Model) -> None:
    found = cross_validate(model, SHOWN, OPTIONS)
    assert found is not None
    assert found.n == len(SHOWN)
    assert found.accuracy >= 0.95
    assert set(found.per_class) == set(STYLES)
    assert sum(count for row in found.confusion.values() for count in row.values()) == len(SHOWN)


def test_labels_without_sense_are_guessed(model: Model) -> None:
    rng = np.random.default_rng(0)
    labels = rng.permutation([d.action for d in SHOWN])
    mixed = [Demonstration(str(a), d.trajectory) for a, d in zip(labels, SHOWN, strict=True)]
    found = cross_validate(fit_model(mixed, SPECIFICATION, OPTIONS), mixed, OPTIONS)
    assert found is not None
    assert found.accuracy < 0.6


@pytest.mark.parametrize("folds", [None, np.arange(len(SHOWN))])
def test_each_is_classified_by_a_model_without_it(
    model: Model, monkeypatch: pytest.MonkeyPatch, folds: Indices | None
) -> None:
    learned, held = dict[int, set[int]](), list[int]()

    def noted(examples: list[Example], *args: Any) -> ActionModel:
        action = fit_action(examples, *args)
        learned[id(action)] = {example.place for example in examples}
        return action

    def seen(model: Model, examples: list[Example]) -> list[str]:
        places = {example.place for example in examples}
        for action in model.actions:
            of_class = {place for place, d in enumerate(SHOWN) if d.action == action.action}
            assert learned[id(action)] == of_class - places
        held.extend(places)
        return classify(model, examples)

    monkeypatch.setattr(validation, "fit_action", noted)
    monkeypatch.setattr(validation, "classify", seen)
    cross_validate(model, SHOWN, OPTIONS, folds=folds)
    assert sorted(held) == list(range(len(SHOWN)))


def test_the_same_seed_gives_the_same(model: Model) -> None:
    assert cross_validate(model, SHOWN, OPTIONS) == cross_validate(model, SHOWN, OPTIONS)


def test_through_hmmlearn_it_is_the_same(model: Model) -> None:
    assert cross_validate(model, SHOWN, OPTIONS, estimator=HMMLEARN) == cross_validate(model, SHOWN, OPTIONS)


def test_classes_with_too_few_are_left_alone() -> None:
    few = [next(d for d in SHOWN if d.action == "push")] * 2
    pushes = fit_model(few, SPECIFICATION, OPTIONS)
    assert cross_validate(pushes, few, OPTIONS) is None
    shown = [*few, *(d for d in SHOWN if d.action == "grasp")]
    found = cross_validate(fit_model(shown, SPECIFICATION, OPTIONS), shown, OPTIONS)
    assert found is not None
    assert set(found.per_class) == {"grasp"}


def test_what_is_raised_before_a_fold_ends_it(model: Model) -> None:
    class Enough(Exception):
        pass

    def stop() -> None:
        raise Enough

    with pytest.raises(Enough):
        cross_validate(model, SHOWN, OPTIONS, stop)
