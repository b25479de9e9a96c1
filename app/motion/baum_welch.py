"""Baum-Welch for left-right Gaussian HMMs (Sec. III-B of the paper); the only user of hmmlearn."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from hmmlearn.hmm import GaussianHMM

from app.motion.trajectory import Floats

MAX_ITERATIONS = 30
TOLERANCE = 1e-3
"""Baum-Welch ends where an iteration gains less than this [nat per frame]."""

logging.getLogger("hmmlearn").setLevel(logging.ERROR)


class Chain(NamedTuple):
    """A left-right chain of Gaussian states.

    means, variances: (n_states, n_features); stay: (n_states,) probability of staying, the last state's
    against ending; weights: (n_states,) frames that each state explained.
    """

    means: Floats
    variances: Floats
    stay: Floats
    weights: Floats


def train_chain(
    sequences: Sequence[Floats], initial: Chain, floor: Floats, known: Chain | None = None
) -> Chain:
    """Return the chain that Baum-Welch reaches from ``initial``.

    sequences: (n_frames, n_features) each, without NaN and none shorter than the number of states; floor:
    (n_features,) least variance. The statistics of ``known`` join every M-step: new demonstrations are
    weighed against all that came before (the paper's incremental estimation). The result may hold
    non-finite numbers where a state explains nothing; whoever stores it must look.
    """
    lengths = [len(sequence) for sequence in sequences]
    hmm = _LeftRight(initial, floor, known, TOLERANCE * sum(lengths))
    hmm.fit(np.concatenate(sequences), lengths)
    stay = np.diag(hmm.transmat_).copy()
    visits = len(sequences) + (0.0 if known is None else known.weights[-1] * (1.0 - known.stay[-1]))
    stay[-1] = 1.0 - visits / hmm.weights[-1]
    return Chain(hmm.means_, hmm._covars_, stay, hmm.weights)


def log_likelihoods(sequences: Sequence[Floats], chain: Chain) -> Floats:
    """Return (n_sequences,) log-likelihoods, each summed over all paths that end in the last state [nat]."""
    hmm = _LeftRight(chain, chain.variances.min(axis=0), None, 0.0)
    return np.array([hmm.score(sequence) for sequence in sequences])


def repetition(sequences: Sequence[Floats], chain: Chain) -> float:
    """Return how many neighbouring frames say what one independent frame would, at least 1.

    Deviations from the states of the best path, in standard deviations, are summed over each sequence. The
    mean square of such a sum is the number of frames where they are independent, and as many times more as
    they repeat each other: the integrated autocorrelation time.
    """
    hmm = _LeftRight(chain, chain.variances.min(axis=0), None, 0.0)
    repeated = []
    for sequence in sequences:
        states = hmm.predict(sequence)
        deviations = (sequence - chain.means[states]) / np.sqrt(chain.variances[states])
        repeated.append(np.mean(deviations.sum(axis=0) ** 2) / len(sequence))
    return max(float(np.mean(repeated)), 1.0)


class _LeftRight(GaussianHMM):  # type: ignore[misc]
    """hmmlearn's Gaussian HMM, made to end in its last state, with floored variances."""

    _covars_: Floats

    def __init__(self, initial: Chain, floor: Floats, known: Chain | None, tolerance: float) -> None:
        super().__init__(
            len(initial.means),
            "diag",
            covars_prior=0.0,
            init_params="",
            params="tmc",
            n_iter=MAX_ITERATIONS,
            tol=tolerance,
        )
        self.startprob_ = np.eye(len(initial.means))[0]
        self.transmat_ = _transitions(initial.stay)
        self.means_ = initial.means
        self.covars_ = np.maximum(initial.variances, floor)
        self.floor, self.known, self.weights = floor, known, initial.weights

    def _compute_log_likelihood(self, features: Floats) -> Floats:
        log_densities: Floats = super()._compute_log_likelihood(features)
        log_densities[-1, :-1] = -np.inf
        return log_densities

    def _do_mstep(self, stats: dict[str, Any]) -> None:
        if self.known is not None:
            weights = self.known.weights[:, None]
            stats["post"] += self.known.weights
            stats["obs"] += weights * self.known.means
            stats["obs**2"] += weights * (self.known.variances + self.known.means**2)
            stats["trans"] += weights * _transitions(self.known.stay)
        self.weights = stats["post"]
        super()._do_mstep(stats)
        self._covars_ = np.maximum(self._covars_, self.floor)


def _transitions(stay: Floats) -> Floats:
    transitions: Floats = np.diag(stay) + np.diag(1.0 - stay[:-1], 1)
    transitions[-1, -1] = 1.0
    return transitions
