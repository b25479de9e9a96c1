"""What demonstrations say of a model: familiarity and rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.motion.conditioning import Tracks
from app.motion.model import Model
from app.motion.simulation import demonstrations
from app.motion.standing import REST_SPREAD, SHARPER, familiarity_of, rest_of
from app.motion.training import conditioned


def paced(first: float, last: float) -> Tracks:
    pace = np.array([first, 2.0, 1.0, last])
    return Tracks(np.zeros((4, 3)), pace, np.empty((0, 4, 3)), np.empty((0, 4)))


def test_rest_is_the_pace_at_the_ends() -> None:
    found = rest_of([paced(-3.0, -2.0), paced(-2.5, -1.0), paced(-2.0, -2.0)])
    assert found.pace == np.median([-3.0, -2.0, -2.5, -1.0, -2.0, -2.0])
    assert found.spread == pytest.approx(SHARPER * np.std([-3.0, -2.0, -2.5, -1.0, -2.0, -2.0]))


def test_rest_is_never_without_spread() -> None:
    assert rest_of([paced(-3.0, -3.0)]).spread == REST_SPREAD


def test_hands_that_stand_still_rest_at_the_pace_of_stillness(trained: Model) -> None:
    assert 0.0 < trained.rest.pace < np.log1p(0.07 / trained.features.still)


def shown(trained: Model) -> list[tuple[Tracks, float, str]]:
    return [(conditioned(each, trained.features), 0.0, each.action) for each in demonstrations(5)[::5]]


def test_a_class_knows_its_own_better_than_others(trained: Model) -> None:
    found = familiarity_of(trained.actions, trained.background, shown(trained))
    assert (found.typical > 0.0).all()
    assert (found.least >= 0.0).all()
    assert (found.least <= found.typical / 2.0).all()


def test_a_class_is_typical_of_its_own_alone(trained: Model) -> None:
    of_all = familiarity_of(trained.actions, trained.background, shown(trained))
    for k, name in enumerate(trained.names):
        own = [each for each in shown(trained) if each[2] == name]
        found = familiarity_of(trained.actions, trained.background, own)
        assert found.typical[k] == of_all.typical[k]
        assert found.least[k] == 0.0
        np.testing.assert_array_equal(np.delete(found.typical, k), 0.0)


def test_what_others_get_is_what_a_movement_must_get(trained: Model) -> None:
    """Half of the demonstrations of other classes get less, unless half of what is typical is less still."""
    alike = (replace(trained.action("push"), action="shove"), trained.action("push"))
    mixed = [(*each[:2], name) for each in shown(trained) if each[2] == "push" for name in ("push", "shove")]
    found = familiarity_of(alike, trained.background, mixed)
    np.testing.assert_allclose(found.least, found.typical / 2.0)
