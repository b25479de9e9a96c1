"""What alternatives say together: shares of one, the likely first, and goals by how near they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.motion.decoding import Alternative
from app.motion.foresight import PHASES, Outlook
from app.motion.hypothesis import REST, believe, expected, likely_goals

NAMES = ("grasp", "push", "retract")

seeds = st.integers(0, 2**32 - 1)


def alternatives_of(rng: np.random.Generator, n_begun: int, n_resting: int) -> list[Alternative]:
    """Return so many movements under way, and so many rests."""
    shape = (len(NAMES), len(PHASES))
    begun = [
        Outlook(rng.normal(0.0, 5.0, shape), rng.normal(0.0, 0.3, (*shape, 3)), rng.uniform(0.0, 0.1, shape))
        for _ in range(n_begun)
    ]
    return [
        Alternative(value, base, unknown, at, at, outlook)
        for at, outlook in enumerate([*begun, *[None] * n_resting])
        for value, base, unknown in [rng.normal(0.0, 5.0, 3).tolist()]
    ]


@given(seeds, st.integers(0, 4), st.integers(0, 1))
def test_posteriors_are_shares_of_one_in_their_order(seed: int, n_begun: int, n_resting: int) -> None:
    rng = np.random.default_rng(seed)
    alternatives = alternatives_of(rng, n_begun, max(n_resting, 1 - n_begun))
    belief = believe(alternatives, len(NAMES))
    found = expected(belief, NAMES)
    assert {each.action for each in found} == {*NAMES, None, REST}
    posteriors = [each.posterior for each in found]
    assert sum(posteriors) == pytest.approx(1.0)
    assert posteriors == sorted(posteriors, reverse=True)
    assert min(posteriors) >= 0.0
    assert max(posteriors) <= 1.0
    for each in found:
        if each.action in NAMES:
            assert each.progress is not None
            assert PHASES[0] - 1e-9 <= each.progress <= PHASES[-1] + 1e-9
        else:
            assert each.progress is None


@given(seeds, st.integers(1, 4))
def test_posteriors_are_those_of_all_that_may_be(seed: int, n_begun: int) -> None:
    rng = np.random.default_rng(seed)
    alternatives = alternatives_of(rng, n_begun, 1)
    weights: dict[str | None, float] = {**dict.fromkeys(NAMES, 0.0), None: 0.0}
    weights[REST] = float(np.exp(alternatives[-1].value))
    gone: dict[str | None, float] = {**dict.fromkeys(NAMES, 0.0)}
    for each in alternatives[:-1]:
        assert each.outlook is not None
        weights[None] += np.exp(each.unknown)
        for name, values in zip(NAMES, each.outlook.values, strict=True):
            weights[name] += np.exp(each.base + values).sum()
            gone[name] += (np.exp(each.base + values) * PHASES).sum()
    for found in expected(believe(alternatives, len(NAMES)), NAMES):
        assert found.posterior == pytest.approx(weights[found.action] / sum(weights.values()))
        if found.action in gone:
            assert found.progress == pytest.approx(gone[found.action] / weights[found.action])


@given(seeds, st.floats(-1e6, 1e6))
def test_only_differences_matter(seed: int, off: float) -> None:
    alternatives = alternatives_of(np.random.default_rng(seed), 2, 1)
    lifted = [
        each._replace(value=each.value + off, base=each.base + off, unknown=each.unknown + off)
        for each in alternatives
    ]
    one, other = (believe(each, len(NAMES)) for each in (alternatives, lifted))
    np.testing.assert_allclose(other.classes, one.classes, atol=1e-8)
    assert (other.rest, other.unknown) == pytest.approx((one.rest, one.unknown), abs=1e-8)


@given(seeds, st.integers(1, 5))
def test_goals_are_shares_of_one(seed: int, n_candidates: int) -> None:
    rng = np.random.default_rng(seed)
    candidates = {f"place {at}": rng.normal(0.0, 0.5, 3) for at in range(n_candidates)}
    belief = believe(alternatives_of(rng, 2, 1), len(NAMES))
    found = likely_goals(belief, candidates)
    assert found.keys() == candidates.keys()
    assert sum(found.values()) == pytest.approx(1.0)
    assert min(found.values()) >= 0.0


def test_the_nearer_goal_is_the_likelier_and_the_surer_the_less_is_left() -> None:
    rng = np.random.default_rng(1)
    [begun] = alternatives_of(rng, 1, 0)
    assert begun.outlook is not None
    candidates = {"near": np.array([0.3, 0.02, 0.0]), "far": np.array([0.3, 0.2, 0.0])}
    shares = []
    for spread in (0.3, 0.1, 0.0):
        outlook = Outlook(
            begun.outlook.values,
            np.broadcast_to([0.3, 0.0, 0.0], begun.outlook.goals.shape),
            np.full_like(begun.outlook.spreads, spread),
        )
        belief = believe([begun._replace(outlook=outlook, unknown=-1e9)], len(NAMES))
        shares.append(likely_goals(belief, candidates)["near"])
    assert 0.5 < shares[0] < shares[1] < shares[2]


def test_without_candidates_or_movement_no_goal_is_told() -> None:
    rng = np.random.default_rng(1)
    moving = believe(alternatives_of(rng, 1, 1), len(NAMES))
    assert likely_goals(moving, {}) == {}
    resting = believe(alternatives_of(rng, 0, 1), len(NAMES))
    assert likely_goals(resting, {"cup": np.zeros(3)}) == {}
    assert resting.rest == 1.0
    nothing = replace(moving, weights=np.zeros_like(moving.weights))
    assert likely_goals(nothing, {"cup": np.zeros(3)}) == {}
