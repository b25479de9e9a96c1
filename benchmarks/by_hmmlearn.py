"""The criterion of the core, written with hmmlearn: what anybody would write first."""

from __future__ import annotations

import numpy as np
from hmmlearn.hmm import GaussianHMM
from scipy.special import gammaln

from app.motion.conditioning import Tracks
from app.motion.features import N_DEVIATIONS, encode
from app.motion.model import ActionModel, Model
from app.motion.scoring import predictive
from app.motion.trajectory import Floats, Indices
from benchmarks.plainly import Plainly


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


class PlainCriterion(Plainly):
    """The criterion with one ``decode`` per segment, filling and class; for motion without dropouts."""

    def __init__(self, model: Model, table_height: float, fillings: Indices) -> None:
        super().__init__(model, table_height, fillings)
        self._chains = [Chain(action) for action in model.actions]
        self._width = model.background.width

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
