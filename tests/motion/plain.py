"""Log-likelihoods in plain numpy, as their formulas say."""

from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from app.motion.model import ActionModel, Model
from app.motion.trajectory import Floats


def log_densities(action: ActionModel, features: Floats) -> Floats:
    """Return (n_frames, n_states) predictive log-densities of what is not missing.

    A mean and a variance known from n values predict the next one by Student's t with n - 1 degrees of
    freedom, around the mean and wider than the unbiased variance by the share 1 / n.
    """
    n = action.n_demonstrations
    scale = np.sqrt(action.variances * n / (n - 1) * (1 + 1 / n))
    result: Floats = np.nansum(student.logpdf(features[:, None], n - 1, action.means, scale), axis=2)
    return result


def background(model: Model, features: Floats) -> float:
    """Return the log-density of what is not missing under the background."""
    return float(-np.sum(~np.isnan(features) * np.log(model.background.width)))


def best_paths(action: ActionModel, features: Floats) -> Floats:
    """Return the (n_states,) log-likelihoods of the best paths from the first state to each."""
    stay, advance = np.log(action.stay), np.log(1.0 - action.stay)
    path = np.full(action.n_states, -np.inf)
    for index, density in enumerate(log_densities(action, features)):
        moved = np.concatenate([[0.0 if index == 0 else -np.inf], path[:-1] + advance[:-1]])
        path = np.maximum(path + stay, moved) + density
    return path


def viterbi(action: ActionModel, features: Floats) -> float:
    """Return the log-likelihood of the best path that starts in the first state and leaves the last."""
    return float(best_paths(action, features)[-1] + np.log(1.0 - action.stay[-1]))
