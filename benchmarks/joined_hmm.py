"""One hidden Markov model of all actions on world coordinates: what one does without Sec. III-A and III-C.

Each class is a left-right Gaussian HMM on positions, or on velocities, of hand and objects in the world. All
are joined to one: the last state of each class leads to the first of every class, and there is nothing else.
A recording is decoded whole with Viterbi (Rabiner, Proc. IEEE 1989; Fink, Markov Models for Pattern
Recognition, 2008).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from hmmlearn.hmm import GaussianHMM
from scipy.linalg import block_diag

from app.motion.trajectory import Demonstration, Floats, Segment, Trajectory
from benchmarks.points import Points, points

N_STATES = 8
"""Of each class."""

N_ITERATIONS = {"positions": 3, "velocities": 30}
"""Of Baum-Welch; they, N_STATES and FLOORS are chosen in favour of this method, by what it then finds."""

MIN_POINTS = 1.1
"""Training starts with no fewer points spent in a state: one that is never stayed in never will be."""

FEW = 1.1
"""Dirichlet prior of transitions: no probability becomes nothing."""

FLOORS = {"positions": 0.0075, "velocities": 0.05}
"""Least standard deviations of a state [m], [m/s]."""

Observed = Literal["positions", "velocities"]


class JoinedHmm:
    """Recognises by the joined model."""

    def __init__(self, demonstrations: Sequence[Demonstration], observed: Observed) -> None:
        self._observed = observed
        self._roles = tuple(demonstrations[0].trajectory.objects)
        self._names = sorted({each.action for each in demonstrations})
        shown = {
            name: [self._of(each.trajectory)[1] for each in demonstrations if each.action == name]
            for name in self._names
        }
        chains = [_chain(sequences, observed) for sequences in shown.values()]
        self._joined = _joined(chains)

    def __call__(self, trajectory: Trajectory) -> list[Segment]:
        """Return the runs of one class's chain."""
        seen, observations = self._of(trajectory)
        states = self._joined.decode(observations)[1]
        # A chain is only ever left by its last state, and entered by its first.
        new = (np.diff(states) < 0) | (np.diff(states // N_STATES) != 0)
        borders = [0, *(np.flatnonzero(new) + 1).tolist(), len(states)]
        runs = itertools.pairwise(borders)
        return seen.segments([(a, b, self._names[states[a] // N_STATES]) for a, b in runs])

    def _of(self, trajectory: Trajectory) -> tuple[Points, Floats]:
        seen = points(trajectory, self._roles)
        values: Floats = getattr(seen, self._observed)
        return seen, values.reshape(len(values), -1)


def train_positions(demonstrations: Sequence[Demonstration]) -> JoinedHmm:
    """Return the joined model of positions in the world."""
    return JoinedHmm(demonstrations, "positions")


def train_velocities(demonstrations: Sequence[Demonstration]) -> JoinedHmm:
    """Return the joined model of velocities in the world."""
    return JoinedHmm(demonstrations, "velocities")


class Chain(NamedTuple):
    """A left-right HMM; transitions: (n_states, n_states), what is left of the last row leads out of it.

    means, variances: (n_states, n_features).
    """

    transitions: Floats
    means: Floats
    variances: Floats


def _chain(sequences: Sequence[Floats], observed: Observed) -> Chain:
    """Return the left-right HMM of one class, trained with Baum-Welch.

    hmmlearn does not ask a path to end anywhere. So each sequence is followed by one more frame, which a
    further column marks, and which one more state explains: only the last state leads to it.
    """
    floor = FLOORS[observed]
    marked = [np.pad(sequence, ((0, 1), (0, 1))) for sequence in sequences]
    for sequence in marked:
        sequence[-1, -1] = 1.0
    parts = [
        np.concatenate(part)
        for part in (
            *zip(*(np.array_split(each[:-1], N_STATES) for each in marked), strict=True),
            [each[-1:] for each in marked],
        )
    ]
    hmm = GaussianHMM(
        N_STATES + 1, "diag", init_params="", params="mct", n_iter=N_ITERATIONS[observed], transmat_prior=FEW
    )
    hmm.startprob_ = np.eye(N_STATES + 1)[0]
    hmm.transmat_ = left_right([len(part) / len(sequences) for part in parts[:-1]])
    hmm.means_ = np.array([part.mean(axis=0) for part in parts])
    hmm.covars_ = np.maximum([part.var(axis=0) for part in parts], floor**2)
    hmm.fit(np.concatenate(marked), [len(each) for each in marked])
    variances = np.maximum(np.diagonal(hmm.covars_, axis1=1, axis2=2), floor**2)
    return Chain(hmm.transmat_[:-1, :-1], hmm.means_[:-1, :-1], variances[:-1, :-1])


def _joined(chains: Sequence[Chain]) -> GaussianHMM:
    """Return the model in which every class may follow every class."""
    hmm = GaussianHMM(len(chains) * N_STATES, "diag", init_params="")
    hmm.startprob_ = np.tile(np.eye(N_STATES)[0], len(chains)) / len(chains)
    hmm.transmat_ = block_diag(*(chain.transitions for chain in chains))
    hmm.transmat_ += (1.0 - hmm.transmat_.sum(axis=1))[:, None] * hmm.startprob_
    hmm.means_ = np.concatenate([chain.means for chain in chains])
    hmm.covars_ = np.concatenate([chain.variances for chain in chains])
    return hmm


def left_right(points: Sequence[float]) -> Floats:
    """Return the transitions of a chain that spends so many points in each state, then ends in one more."""
    staying = np.array([1.0 - 1.0 / max(each, MIN_POINTS) for each in points])
    return np.diag(np.append(staying, 1.0)) + np.diag(1.0 - staying, 1)
