"""Baum-Welch for left-right Gaussian HMMs (Sec. III-B of the paper), compiled.

From frame to frame a path stays or goes on to the next state, so that a pass costs states, not states
squared. It begins in the first state and ends in the last: it leaves every other state exactly once, and
how long the states last is all that there is to learn of transitions.

Probabilities of paths are kept as logarithms: a frame far from all states takes nothing out of the range of
numbers. The way forward notes for each state and frame how likely a path has just entered the state; with
these shares alone, the way back tells how likely it is there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from app.motion.trajectory import Floats, Indices

MAX_ITERATIONS = 30
TOLERANCE = 1e-3
"""Baum-Welch ends where an iteration gains less than this [nat per frame]."""

NEGLIGIBLE = 40.0
"""A path so much less likely than another adds nothing to it [nat]."""


class Chain(NamedTuple):
    """A left-right chain of Gaussian states.

    means, variances: (n_states, n_features); stay: (n_states,) probability of staying, the last state's
    against ending; weights: (n_states,) frames that each state explained.
    """

    means: Floats
    variances: Floats
    stay: Floats
    weights: Floats


class Statistics(NamedTuple):
    """What the states of a chain explain.

    weights: (n_states,) frames; sums, squares: (n_states, n_features) of how far these are from the mean.
    """

    weights: Floats
    sums: Floats
    squares: Floats


def train_chain(
    sequences: Sequence[Floats], initial: Chain, floor: Floats, known: Chain | None = None
) -> Chain:
    """Return the chain that Baum-Welch reaches from ``initial``.

    sequences: (n_frames, n_features) each, without NaN and none shorter than the number of states; floor:
    (n_features,) least variance. The statistics of ``known`` join every M-step: new demonstrations are
    weighed against all that came before (the paper's incremental estimation). The result may hold
    non-finite numbers where a state explains nothing; whoever stores it must look.
    """
    features, first = _joined(sequences)
    begin = initial._replace(variances=np.maximum(initial.variances, floor))
    before = initial._replace(weights=np.zeros(len(initial.stay))) if known is None else known
    tolerance = TOLERANCE * len(features)
    return Chain(*_train(features, first, _own(begin), floor, _own(before), tolerance, MAX_ITERATIONS))


def log_likelihoods(sequences: Sequence[Floats], chain: Chain) -> Floats:
    """Return (n_sequences,) log-likelihoods, each summed over all paths that end in the last state [nat]."""
    logs: Floats = _forward(*_joined(sequences), _own(chain))[0]
    return logs


def repetition(sequences: Sequence[Floats], chain: Chain) -> float:
    """Return how many neighbouring frames say what one independent frame would, at least 1.

    Deviations from the states of the best path, in standard deviations, are summed over each sequence. The
    mean square of such a sum is the number of frames where they are independent, and as many times more as
    they repeat each other: the integrated autocorrelation time.
    """
    features, first = _joined(sequences)
    states = _best_paths(features, first, _own(chain))
    deviations = (features - chain.means[states]) / np.sqrt(chain.variances[states])
    squares = np.add.reduceat(deviations, first[:-1]) ** 2
    return max(float(np.mean(squares.mean(axis=1) / np.diff(first))), 1.0)


class Estimator(NamedTuple):
    """What chains are trained and judged with: the functions of this module, or others that do the same."""

    train_chain: Callable[[Sequence[Floats], Chain, Floats, Chain | None], Chain]
    log_likelihoods: Callable[[Sequence[Floats], Chain], Floats]
    repetition: Callable[[Sequence[Floats], Chain], float]


COMPILED = Estimator(train_chain, log_likelihoods, repetition)


def _joined(sequences: Sequence[Floats]) -> tuple[Floats, Indices]:
    """Return the frames of all sequences, and (n_sequences + 1,) where each begins."""
    lengths = [len(sequence) for sequence in sequences]
    return np.concatenate(sequences, dtype=np.float64), np.cumsum([0, *lengths])


def _own(chain: Chain) -> Chain:
    """Return a copy whose arrays lie as the kernels were compiled for."""
    return Chain(*(np.array(part, dtype=np.float64, order="C") for part in chain))


@njit(cache=True, nogil=True, error_model="numpy")
def _train(
    features: Floats,
    first: Indices,
    chain: Chain,
    floor: Floats,
    known: Chain,
    tolerance: float,
    max_iterations: int,
) -> Chain:
    """Return the chain after the iteration that gains less than the tolerance [nat], or after the last."""
    explained = -np.inf
    for _ in range(max_iterations):
        logs, entered = _forward(features, first, chain)
        before, explained = explained, logs.sum()
        statistics = _collect(features, _shares(entered, first), chain.means)
        chain = _estimate(chain, statistics, len(first) - 1.0, floor, known)
        if explained - before < tolerance:
            break
    return chain


@njit(cache=True, nogil=True, error_model="numpy")
def _forward(features: Floats, first: Indices, chain: Chain) -> tuple[Floats, Floats]:
    """Follow all paths.

    Return (n_sequences,) log-likelihoods [nat], and the (n_frames, n_states) probabilities that a path in a
    state was in the one before it a frame earlier.
    """
    log_densities, n_states = _log_densities(features, chain), len(chain.stay)
    staying, leaving = np.log(_within(chain.stay)), np.log(1.0 - chain.stay)
    logs, entered = np.empty(len(first) - 1), np.zeros(log_densities.shape)
    for sequence in range(len(first) - 1):
        begin, stop = first[sequence], first[sequence + 1]
        paths = np.full(n_states, -np.inf)
        paths[0] = log_densities[begin, 0]
        for frame in range(begin + 1, stop):
            low, high = _between(begin, frame, stop, n_states)
            for s in range(high - 1, low - 1, -1):
                came = paths[s - 1] + leaving[s - 1] if s > 0 else -np.inf
                total, entered[frame, s] = _sum(paths[s] + staying[s], came)
                paths[s] = total + log_densities[frame, s]
        logs[sequence] = paths[-1]
    return logs, entered


@njit(cache=True, nogil=True, inline="always")
def _sum(log: float, other: float) -> tuple[float, float]:
    """Return the logarithm of the sum of two numbers, and the other's share in it, NaN where both are 0."""
    more = max(log, other)
    if abs(log - other) > NEGLIGIBLE:
        return more, 1.0 if other > log else 0.0
    ratio = np.exp(other - log)
    return log + np.log1p(ratio) if more > -np.inf else more, ratio / (1.0 + ratio)


@njit(cache=True, nogil=True)
def _shares(entered: Floats, first: Indices) -> Floats:
    """Return the (n_states, n_frames) probabilities that a path is in each state."""
    n_frames, n_states = entered.shape
    shares = np.zeros((n_states, n_frames))
    for sequence in range(len(first) - 1):
        begin, stop = first[sequence], first[sequence + 1]
        shares[-1, stop - 1] = 1.0
        for frame in range(stop - 1, begin, -1):
            low, high = _between(begin, frame, stop, n_states)
            for s in range(low, high):
                if shares[s, frame] != 0.0:
                    came = shares[s, frame] * entered[frame, s]
                    shares[s, frame - 1] += shares[s, frame] - came
                    if s > 0:
                        shares[s - 1, frame - 1] += came
    return shares


@njit(cache=True, nogil=True, inline="always")
def _between(begin: int, frame: int, stop: int, n_states: int) -> tuple[int, int]:
    """Return the first state with a way to the end, and one after the last that can be reached."""
    return max(n_states - (stop - frame), 0), min(frame - begin + 1, n_states)


@njit(cache=True, nogil=True, error_model="numpy")
def _best_paths(features: Floats, first: Indices, chain: Chain) -> Indices:
    """Return the (n_frames,) states of the best path through each sequence (Viterbi)."""
    log_densities, n_states = _log_densities(features, chain), len(chain.stay)
    staying, leaving = np.log(_within(chain.stay)), np.log(1.0 - chain.stay)
    entered = np.zeros(log_densities.shape, dtype=np.bool_)
    states = np.empty(len(features), dtype=np.int64)
    for sequence in range(len(first) - 1):
        begin, stop = first[sequence], first[sequence + 1]
        best = np.full(n_states, -np.inf)
        best[0] = log_densities[begin, 0]
        for frame in range(begin + 1, stop):
            for s in range(n_states - 1, -1, -1):
                stayed = best[s] + staying[s]
                came = best[s - 1] + leaving[s - 1] if s > 0 else -np.inf
                entered[frame, s] = s > 0 and came >= stayed
                best[s] = max(stayed, came) + log_densities[frame, s]
        state = n_states - 1
        for frame in range(stop - 1, begin - 1, -1):
            states[frame] = state
            state -= entered[frame, state]
    return states


@njit(cache=True, nogil=True)
def _within(stay: Floats) -> Floats:
    """Return the probabilities of staying before a sequence ends: nothing comes after the last state."""
    within = stay.copy()
    within[-1] = 1.0
    return within


@njit(cache=True, nogil=True, error_model="numpy")
def _log_densities(features: Floats, chain: Chain) -> Floats:
    """Return the (n_frames, n_states) log-densities."""
    n_frames, n_features = features.shape
    columns, of_state = features.T.copy(), np.empty(n_frames)
    log_densities = np.empty((n_frames, len(chain.stay)))
    for s in range(len(chain.stay)):
        of_state[:] = -0.5 * (n_features * np.log(2.0 * np.pi) + np.log(chain.variances[s]).sum())
        for d in range(n_features):
            column, mean, factor = columns[d], chain.means[s, d], -0.5 / chain.variances[s, d]
            for frame in range(n_frames):
                off = column[frame] - mean
                of_state[frame] += factor * off * off
        log_densities[:, s] = of_state
    return log_densities


@njit(cache=True, nogil=True, fastmath={"reassoc"})
def _collect(features: Floats, shares: Floats, means: Floats) -> Statistics:
    """Return what the states explain, each frame shared out among them."""
    columns, weights = features.T.copy(), np.zeros(len(means))
    sums, squares = np.zeros_like(means), np.zeros_like(means)
    for s in range(len(means)):
        weights[s] = shares[s].sum()
        for d in range(len(columns)):
            column, share, mean, total, square = columns[d], shares[s], means[s, d], 0.0, 0.0
            for frame in range(len(column)):
                off = column[frame] - mean
                total += share[frame] * off
                square += share[frame] * off * off
            sums[s, d], squares[s, d] = total, square
    return Statistics(weights, sums, squares)


@njit(cache=True, nogil=True, error_model="numpy")
def _estimate(chain: Chain, statistics: Statistics, n_sequences: float, floor: Floats, known: Chain) -> Chain:
    """Return the chain that explains best what its states explain, and what those of ``known`` did."""
    weights = statistics.weights + known.weights
    means, variances = np.empty_like(chain.means), np.empty_like(chain.means)
    for s in range(len(weights)):
        before = known.means[s] - chain.means[s]
        sums = statistics.sums[s] + known.weights[s] * before
        squares = statistics.squares[s] + known.weights[s] * (known.variances[s] + before**2)
        shift = sums / weights[s]
        means[s] = chain.means[s] + shift
        variances[s] = np.maximum(squares / weights[s] - shift**2, floor)
    left = n_sequences + known.weights * (1.0 - known.stay)
    return Chain(means, variances, np.maximum(1.0 - left / weights, 0.0), weights)
