"""Baum-Welch against hmmlearn, every path, counting, and a forward pass by hand, and by its laws."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pytest
from hmmlearn.hmm import GaussianHMM
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from app.motion import baum_welch
from app.motion.baum_welch import COMPILED, Chain, Estimator, log_likelihoods, repetition, train_chain
from app.motion.by_hmmlearn import HMMLEARN
from app.motion.model import FeatureSpecification
from app.motion.simulation import STYLES, demonstrations
from app.motion.training import conditioned, observe
from app.motion.trajectory import Floats, Indices

LAW = settings(derandomize=True, deadline=None, max_examples=25)

N_FEATURES = 2
NO_FLOOR = np.full(N_FEATURES, 1e-12)

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 5)


def chain_of(rng: np.random.Generator, n_states: int, apart: float) -> Chain:
    """Return a chain whose states lie so many standard deviations apart."""
    means = rng.normal(0.0, 0.1, N_FEATURES) + apart * 0.01 * np.arange(n_states)[:, None]
    variances = rng.uniform(0.005, 0.01, (n_states, N_FEATURES)) ** 2
    return Chain(means, variances, rng.uniform(0.5, 0.9, n_states), np.ones(n_states))


def sample(rng: np.random.Generator, chain: Chain) -> tuple[Floats, Indices]:
    """Return a sequence (n_frames, n_features) that passes through the chain, and its states (n_frames,).

    It spends two frames or more in each state.
    """
    states = np.repeat(np.arange(len(chain.stay)), 1 + rng.geometric(1.0 - chain.stay))
    return rng.normal(chain.means[states], np.sqrt(chain.variances[states])), states


def samples(rng: np.random.Generator, chain: Chain, n_sequences: int) -> list[Floats]:
    return [sample(rng, chain)[0] for _ in range(n_sequences)]


def guess(chain: Chain, off: float = 0.004) -> Chain:
    """Return where training might begin: the chain, not quite [m]."""
    return chain._replace(
        means=chain.means + off, variances=4.0 * chain.variances, stay=0.0 * chain.stay + 0.7
    )


def forward(sequence: Floats, chain: Chain) -> float:
    """Return the log-likelihood over all paths that end in the last state."""
    density = norm.logpdf(sequence[:, None], chain.means, np.sqrt(chain.variances)).sum(axis=2)
    with np.errstate(divide="ignore"):
        stay, advance = np.log([*chain.stay[:-1], 1.0]), np.log(1.0 - chain.stay[:-1])
    paths = np.full(len(stay), -np.inf)
    paths[0] = density[0, 0]
    for of_frame in density[1:]:
        moved = np.concatenate([[-np.inf], paths[:-1] + advance])
        paths = np.logaddexp(paths + stay, moved) + of_frame
    return float(paths[-1])


def every_path(n_frames: int, n_states: int) -> list[Indices]:
    """Return the (n_frames,) states of all paths from the first state to the last."""
    entries = combinations(range(1, n_frames), n_states - 1)
    return [np.searchsorted(at, np.arange(n_frames), side="right") for at in entries]


def of_path(sequence: Floats, chain: Chain, path: Indices) -> float:
    """Return the log-probability of a sequence along a path [nat]."""
    density = norm.logpdf(sequence, chain.means[path], np.sqrt(chain.variances[path])).sum()
    stay, before = chain.stay[path[:-1]], path[:-1] == len(chain.stay) - 1
    moves = np.where(np.diff(path) == 0, np.where(before, 1.0, stay), 1.0 - stay)
    return float(density + np.log(moves).sum())


def total(sequences: Sequence[Floats], chain: Chain) -> float:
    return sum(forward(sequence, chain) for sequence in sequences)


def assert_close(chain: Chain, other: Chain, rtol: float = 1e-6) -> None:
    for values, others in zip(chain, other, strict=True):
        np.testing.assert_allclose(values, others, rtol=rtol, atol=1e-12)


@LAW
@given(seeds, sizes)
def test_log_likelihood_is_summed_over_all_paths(seed: int, n_states: int) -> None:
    rng = np.random.default_rng(seed)
    chain = chain_of(rng, n_states, apart=1.0)
    sequences = [rng.normal(0.0, 0.02, (n_frames, N_FEATURES)) for n_frames in (n_states, 9, 30)]
    expected = [forward(sequence, chain) for sequence in sequences]
    np.testing.assert_allclose(log_likelihoods(sequences, chain), expected, rtol=1e-9)


@LAW
@given(seeds, st.integers(1, 4), st.integers(0, 4), st.sampled_from([0.3, 3.0, 30.0]))
def test_it_is_the_sum_of_every_path_and_the_best_is_the_best_of_them(
    seed: int, n_states: int, n_more: int, apart: float
) -> None:
    rng = np.random.default_rng(seed)
    chain = chain_of(rng, n_states, apart)
    sequence = rng.normal(0.0, 0.03, (n_states + n_more, N_FEATURES))
    paths = every_path(len(sequence), n_states)
    values = [of_path(sequence, chain, path) for path in paths]
    np.testing.assert_allclose(log_likelihoods([sequence], chain), np.logaddexp.reduce(values), rtol=1e-9)
    best = paths[int(np.argmax(values))]
    deviations = (sequence - chain.means[best]) / np.sqrt(chain.variances[best])
    expected = max(float(np.mean(deviations.sum(axis=0) ** 2)) / len(sequence), 1.0)
    assert repetition([sequence], chain) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("off", [1.0, 10.0, 1e4])
def test_frames_far_from_all_states_leave_the_range_of_numbers_alone(off: float) -> None:
    """They say that the first states are best, then the last: paths of less than 1e-308 of others count."""
    rng = np.random.default_rng(2)
    chain = chain_of(rng, 5, apart=100.0)
    sequence = rng.normal(0.0, 0.01, (12, N_FEATURES)) + off * np.array([1.0, -1.0, 1.0, 0.0] * 3)[:, None]
    np.testing.assert_allclose(log_likelihoods([sequence], chain), forward(sequence, chain), rtol=1e-9)
    ours, theirs = (each.train_chain([sequence] * 3, chain, NO_FLOOR, None) for each in (COMPILED, HMMLEARN))
    assert_close(ours, theirs)


@pytest.mark.parametrize("stay", [[0.0, 0.0, 0.5, 0.5], [0.5, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
def test_states_that_last_one_frame_are_trained_as_by_hmmlearn(stay: list[float]) -> None:
    """Some states have no path to them then, at some frames: what is shared out there is nothing."""
    rng = np.random.default_rng(3)
    initial = chain_of(rng, 4, apart=1.0)._replace(stay=np.array(stay))
    sequences = [rng.normal(0.0, 0.02, (n_frames, N_FEATURES)) for n_frames in (5, 9, 9, 12)]
    assert_same(sequences, initial, np.full(N_FEATURES, 1e-6), None)


def test_a_sequence_that_cannot_end_has_no_likelihood() -> None:
    chain = chain_of(np.random.default_rng(0), 4, apart=1.0)
    assert log_likelihoods([chain.means[:3], chain.means], chain)[0] == -np.inf


def assert_same(sequences: Sequence[Floats], initial: Chain, floor: Floats, known: Chain | None) -> None:
    ours, theirs = (each.train_chain(sequences, initial, floor, known) for each in (COMPILED, HMMLEARN))
    assert_close(ours, theirs, rtol=1e-8)
    ours_, theirs_ = (each.log_likelihoods(sequences, theirs) for each in (COMPILED, HMMLEARN))
    np.testing.assert_allclose(ours_, theirs_, rtol=1e-10)
    one, other = (each.repetition(sequences, theirs) for each in (COMPILED, HMMLEARN))
    assert one == pytest.approx(other, rel=1e-10)


@LAW
@given(seeds, sizes, st.sampled_from([0.5, 2.0, 20.0]), st.booleans())
def test_agrees_with_hmmlearn(seed: int, n_states: int, apart: float, further: bool) -> None:
    rng = np.random.default_rng(seed)
    chain = chain_of(rng, n_states, apart)
    sequences, initial = samples(rng, chain, 8), guess(chain)
    floor = np.full(N_FEATURES, 1e-6)
    known = HMMLEARN.train_chain(samples(rng, chain, 5), initial, floor, None) if further else None
    assert_same(sequences, initial, floor, known)


@pytest.mark.parametrize("n_states", [1, 4, 12])
@pytest.mark.parametrize("action", STYLES)
def test_agrees_with_hmmlearn_on_simulated_motion(action: str, n_states: int) -> None:
    features = FeatureSpecification(("object",))
    shown = [each for each in demonstrations(3) if each.action == action][::3]
    sequences = [observe(conditioned(each, features), 0.0) for each in shown]
    floor = np.full(features.n_features, 1e-4)
    initial = evenly(sequences, n_states)
    assert_same(sequences, initial, floor, None)
    assert_same(sequences[8:], initial, floor, HMMLEARN.train_chain(sequences[:8], initial, floor, None))


def evenly(sequences: Sequence[Floats], n_states: int) -> Chain:
    """Return a chain whose states divide every sequence evenly."""
    parts = zip(*(np.array_split(sequence, n_states) for sequence in sequences), strict=True)
    frames = [np.concatenate(of_state) for of_state in parts]
    means, variances = (np.array([f(of, axis=0) for of in frames]) for f in (np.mean, np.var))
    return Chain(means, variances, np.full(n_states, 0.8), np.ones(n_states))


@pytest.mark.parametrize("seed", range(3))
def test_iterates_as_often_as_hmmlearn(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    rng = np.random.default_rng(seed)
    chain = chain_of(rng, 4, apart=1.5)
    sequences, initial = samples(rng, chain, 8), guess(chain)

    def n_iterations(estimator: Estimator) -> int:
        reached = []
        for n in range(1, 31):
            monkeypatch.setattr(baum_welch, "MAX_ITERATIONS", n)
            reached.append(estimator.train_chain(sequences, initial, NO_FLOOR, None).means)
        return sum(not np.array_equal(means, reached[-1]) for means in reached) + 1

    assert 1 < n_iterations(COMPILED) == n_iterations(HMMLEARN) < 30


def test_the_same_demonstrations_give_the_same_chain_and_are_left_as_they_were() -> None:
    rng = np.random.default_rng(1)
    chain = chain_of(rng, 4, apart=1.5)
    sequences, initial = samples(rng, chain, 8), guess(chain)
    for array in (*sequences, *initial):
        array.setflags(write=False)
    one, other = (train_chain(sequences, initial, NO_FLOOR, known=initial) for _ in range(2))
    assert all(np.array_equal(values, others) for values, others in zip(one, other, strict=True))


@LAW
@given(seeds, sizes)
def test_agrees_with_plain_hmmlearn_where_nothing_but_the_last_state_explains_the_end(
    seed: int, n_states: int
) -> None:
    rng = np.random.default_rng(seed)
    chain = chain_of(rng, n_states, apart=20.0)
    sequences, initial = samples(rng, chain, 8), guess(chain)
    n_frames = sum(map(len, sequences))
    hmm = GaussianHMM(
        n_states,
        "diag",
        covars_prior=0.0,
        init_params="",
        params="tmc",
        n_iter=baum_welch.MAX_ITERATIONS,
        tol=baum_welch.TOLERANCE * n_frames,
    )
    hmm.startprob_ = np.eye(n_states)[0]
    hmm.transmat_ = np.diag([*initial.stay[:-1], 1.0]) + np.diag(1.0 - initial.stay[:-1], 1)
    hmm.means_, hmm.covars_ = initial.means, initial.variances
    hmm.fit(np.concatenate(sequences), [len(sequence) for sequence in sequences])
    found = train_chain(sequences, initial, NO_FLOOR)
    np.testing.assert_allclose(found.means, hmm.means_, rtol=1e-9)
    np.testing.assert_allclose(found.variances, np.diagonal(hmm.covars_, axis1=1, axis2=2), rtol=1e-6)
    np.testing.assert_allclose(found.stay[:-1], np.diag(hmm.transmat_)[:-1], atol=1e-9)


@LAW
@given(seeds, sizes)
def test_counts_states_that_are_plain_to_see(seed: int, n_states: int) -> None:
    rng = np.random.default_rng(seed)
    chain = chain_of(rng, n_states, apart=100.0)
    sampled = [sample(rng, chain) for _ in range(10)]
    features = np.concatenate([sequence for sequence, _ in sampled])
    states = np.concatenate([of_sequence for _, of_sequence in sampled])
    frames = [features[states == state] for state in range(n_states)]
    weights = np.array([float(len(of_state)) for of_state in frames])
    expected = Chain(
        np.array([of_state.mean(axis=0) for of_state in frames]),
        np.maximum([of_state.var(axis=0) for of_state in frames], 1e-8),
        1.0 - 10 / weights,
        weights,
    )
    found = train_chain([sequence for sequence, _ in sampled], guess(chain), np.full(N_FEATURES, 1e-8))
    assert_close(found, expected)


@pytest.mark.parametrize("floor", [1e-12, 1e-4, 1e-2])
@pytest.mark.parametrize("seed", range(4))
def test_likelihood_never_worsens(monkeypatch: pytest.MonkeyPatch, seed: int, floor: float) -> None:
    rng = np.random.default_rng(seed)
    chain = chain_of(rng, 4, apart=1.5)
    sequences, initial = samples(rng, chain, 8), guess(chain, off=0.02)
    initial = initial._replace(variances=np.maximum(initial.variances, floor))
    monkeypatch.setattr(baum_welch, "TOLERANCE", 0.0)
    likelihoods = [total(sequences, initial)]
    for n_iterations in range(1, 16):
        monkeypatch.setattr(baum_welch, "MAX_ITERATIONS", n_iterations)
        trained = train_chain(sequences, initial, np.full(N_FEATURES, floor))
        likelihoods.append(total(sequences, trained))
    assert (np.diff(likelihoods) >= -1e-7).all()
    assert likelihoods[-1] > likelihoods[0]


@LAW
@given(seeds, sizes)
def test_every_sequence_goes_through_every_state_once_and_ends_in_the_last(seed: int, n_states: int) -> None:
    rng = np.random.default_rng(seed)
    sequences = [rng.normal(0.0, 0.02, (n_frames, N_FEATURES)) for n_frames in (n_states, 9, 30, 17)]
    found = train_chain(sequences, chain_of(rng, n_states, apart=1.0), np.full(N_FEATURES, 1e-6))
    np.testing.assert_allclose(found.weights * (1.0 - found.stay), 4.0, rtol=1e-9)
    assert found.weights.sum() == pytest.approx(n_states + 9 + 30 + 17)
    assert ((found.stay >= 0.0) & (found.stay < 1.0)).all()


@LAW
@given(seeds, st.floats(1e-8, 1e-2))
def test_variances_do_not_fall_below_the_floor(seed: int, height: float) -> None:
    rng = np.random.default_rng(seed)
    chain, floor = chain_of(rng, 3, apart=2.0), np.array([height, 1e-3 * height])
    assert (train_chain(samples(rng, chain, 6), guess(chain), floor).variances >= floor).all()
    [alike] = samples(rng, chain, 1)
    assert (train_chain([alike[:3]] * 6, guess(chain), floor).variances == floor).all()


def test_as_many_frames_as_states() -> None:
    rng = np.random.default_rng(5)
    chain = chain_of(rng, 4, apart=5.0)
    sequences = [rng.normal(chain.means, np.sqrt(chain.variances)) for _ in range(7)]
    found = train_chain(sequences, guess(chain), NO_FLOOR)
    expected = Chain(np.mean(sequences, axis=0), np.var(sequences, axis=0), np.zeros(4), np.full(4, 7.0))
    assert_close(found, expected)


@LAW
@given(seeds)
def test_order_and_unit_do_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chain = chain_of(rng, 3, apart=2.0)
    sequences, initial = samples(rng, chain, 6), guess(chain)
    found = train_chain(sequences, initial, NO_FLOOR)
    assert_close(train_chain(sequences[::-1], initial, NO_FLOOR), found)
    scaled = train_chain(
        [1e3 * sequence for sequence in sequences],
        initial._replace(means=1e3 * initial.means, variances=1e6 * initial.variances),
        1e6 * NO_FLOOR,
    )
    assert_close(scaled, found._replace(means=1e3 * found.means, variances=1e6 * found.variances))


@LAW
@given(seeds, sizes)
def test_training_further_counts_what_came_before(seed: int, n_states: int) -> None:
    """Where states are plain to see, training in parts is training on all of it."""
    rng = np.random.default_rng(seed)
    chain = chain_of(rng, n_states, apart=100.0)
    sequences, initial = samples(rng, chain, 12), guess(chain)
    whole = train_chain(sequences, initial, NO_FLOOR)
    known = train_chain(sequences[:5], initial, NO_FLOOR)
    for part in (slice(5, 6), slice(6, 12)):
        known = train_chain(sequences[part], known, NO_FLOOR, known=known)
    assert_close(known, whole)


@pytest.mark.parametrize("seed", range(5))
def test_training_further_comes_close_to_training_on_all(seed: int) -> None:
    """Where states overlap, it explains everything nearly as well, and better than the first part alone."""
    rng = np.random.default_rng(seed)
    chain = chain_of(rng, 4, apart=1.5)
    sequences, initial = samples(rng, chain, 40), guess(chain)
    n_frames = sum(map(len, sequences))
    first = train_chain(sequences[:10], initial, NO_FLOOR)
    further = train_chain(sequences[10:], first, NO_FLOOR, known=first)
    whole = train_chain(sequences, initial, NO_FLOOR)
    first_, further_, whole_ = (total(sequences, found) / n_frames for found in (first, further, whole))
    assert whole_ - further_ < 0.05 * (whole_ - first_)
