"""The same training through hmmlearn, for comparison: ``fit_model(..., estimator=HMMLEARN)``."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

import numpy as np
from hmmlearn.hmm import GaussianHMM

from app.motion import baum_welch
from app.motion.baum_welch import Chain, Estimator
from app.motion.trajectory import Floats

logging.getLogger("hmmlearn").setLevel(logging.ERROR)


def train_chain(
    sequences: Sequence[Floats], initial: Chain, floor: Floats, known: Chain | None = None
) -> Chain:
    """Return the chain that Baum-Welch reaches, as ``baum_welch.train_chain`` does."""
    lengths = [len(sequence) for sequence in sequences]
    hmm = _LeftRight(initial, floor, known, baum_welch.TOLERANCE * sum(lengths))
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
    """Return how many neighbouring frames say what one would, as ``baum_welch.repetition`` does."""
    hmm = _LeftRight(chain, chain.variances.min(axis=0), None, 0.0)
    repeated = []
    for sequence in sequences:
        states = hmm.predict(sequence)
        deviations = (sequence - chain.means[states]) / np.sqrt(chain.variances[states])
        repeated.append(np.mean(deviations.sum(axis=0) ** 2) / len(sequence))
    return max(float(np.mean(repeated)), 1.0)


HMMLEARN = Estimator(train_chain, log_likelihoods, repetition)


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
            n_iter=baum_welch.MAX_ITERATIONS,
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
