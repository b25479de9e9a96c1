"""The criterion of the core, written with hmmlearn: what anybody would write first."""

from __future__ import annotations

import numpy as np
from hmmlearn.hmm import GaussianHMM
from numpy.typing import NDArray
from scipy.special import gammaln

from app.motion.conditioning import Tracks
from app.motion.criterion import Criterion, Scores
from app.motion.features import N_DEVIATIONS, encode
from app.motion.model import ActionModel, Model
from app.motion.scoring import predictive
from app.motion.trajectory import Floats

Indices = NDArray[np.int64]


class Chain(GaussianHMM):  # type: ignore[misc]
    """An action model as hmmlearn knows it; a path ends by leaving its last state.

    What is left of the last state's transitions leads to one more state, which explains nothing. The
    densities are Student's t, which hmmlearn does not have.
    """

    def __init__(self, action: ActionModel) -> None:
        n_states = action.n_states
        super().__init__(n_states + 1, "diag", init_params="")
        self.startprob_ = np.eye(n_states + 1)[0]
        self.transmat_ = np.diag([*action.stay, 1.0]) + np.diag(1.0 - action.stay, 1)
        self.means_, self.covars_ = np.zeros((n_states + 1, 1)), np.ones((n_states + 1, 1))
        self.leaving = float(np.log1p(-action.stay[-1]))
        self._centre = action.means
        self._freedom, self._scale = predictive(action)
        peak = gammaln((self._freedom + 1.0) / 2.0) - gammaln(self._freedom / 2.0)
        self._peak = np.sum(peak - 0.5 * np.log(np.pi * self._freedom) - np.log(self._scale), axis=1)

    def _compute_log_likelihood(self, features: Floats) -> Floats:
        z = (features[:, None] - self._centre) / self._scale
        tails = np.log1p(z**2 / self._freedom).sum(axis=2)
        densities = np.full((len(features), len(self._peak) + 1), -np.inf)
        densities[:, :-1] = self._peak - (self._freedom + 1.0) / 2.0 * tails
        densities[-1, :-2] = -np.inf
        return densities


class PlainCriterion(Criterion):
    """The criterion with one ``decode`` per segment, filling and class; for motion without dropouts."""

    def __init__(self, model: Model, table_height: float, fillings: Indices) -> None:
        super().__init__(model, table_height, fillings)
        self._chains = [Chain(action) for action in model.actions]
        self._width = model.background.width

    def __call__(self, tracks: Tracks, segments: Indices) -> Scores:
        """Return the scores of segments; (n_segments, 2)."""
        way = np.linalg.norm(tracks.hand[segments[:, 1]] - tracks.hand[segments[:, 0]], axis=1)
        terms, shape = self._terms, (len(segments), len(self._chains))
        scores = Scores(np.full(shape, -np.inf), np.full(shape, -np.inf), np.zeros(shape, dtype=np.int64))
        for row in np.flatnonzero(way >= terms.nearest.min()).tolist():
            start, goal = segments[row].tolist()
            part = tracks.part(start, goal + 1)
            of_fillings = np.array([self._ratios(part, filling) for filling in self._fillings.tolist()])
            ratios, slow = (
                of_fillings.max(axis=0),
                (np.log(goal - start) - terms.tempo[:, 0]) / terms.tempo[:, 1],
            )
            counted = terms.evidence * ratios - 0.5 * slow**2
            scores.criterion[row] = np.where(way[row] < terms.nearest, -np.inf, counted)
            scores.ratio[row], scores.filling[row] = ratios / len(part.pace), of_fillings.argmax(axis=0)
        return scores

    def best(
        self, tracks: Tracks, segments: Indices, _bounds: Floats, _before: Floats, least: Floats
    ) -> Floats:
        """Return (n_segments,) values of the best class, whatever lies before."""
        values: Floats = np.maximum(self(tracks, segments).criterion.max(axis=1), least)
        return values

    def _ratios(self, part: Tracks, filling: list[int]) -> list[float]:
        """Return the (n_classes,) log-likelihood ratios to the background of a whole movement [nat]."""
        positions = encode(part.hand, part.objects[filling], self._table_height)
        phase = np.linspace(0.0, 1.0, len(positions))
        of_roles = zip(positions.T[N_DEVIATIONS + 1 :], part.paces[filling], strict=True)
        columns = [
            positions[:, : N_DEVIATIONS + 1],
            part.pace,
            phase,
            *(each for of in of_roles for each in of),
        ]
        features = np.column_stack(columns)
        background = -len(features) * float(np.log(self._width).sum())
        return [chain.decode(features)[0] + chain.leaving - background for chain in self._chains]
