"""What a model's own demonstrations say of it: how well it explains them, and where rest begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.motion.conditioning import Tracks
from app.motion.lanes import States
from app.motion.model import ActionModel, Background, Familiarity, Rest
from app.motion.scoring import score_segments, states_of
from app.motion.trajectory import Floats

SHARPER = 0.5
"""Rest ends more sharply than the ends of demonstrations scatter, which are cut by hand: by this factor."""

REST_SPREAD = 0.1
"""Least spread of the pace at which rest ends."""


def rest_of(demonstrations: Sequence[Tracks]) -> Rest:
    """Return the pace that hands have where demonstrations begin and end, and how sharp that is."""
    ends = np.array([tracks.pace[at] for tracks in demonstrations for at in (0, -1)])
    return Rest(float(np.median(ends)), max(SHARPER * float(ends.std()), REST_SPREAD))


Shown = tuple[Tracks, float, str]
"""A conditioned demonstration, the height of its table [m], and its class."""


def familiarity_of(
    actions: Sequence[ActionModel],
    background: Background,
    demonstrations: Sequence[Shown],
) -> Familiarity:
    """Return how well the classes explain their own demonstrations and those of the others.

    A movement is of a class if the class explains it better than it does most movements of other classes; but
    what gets half of what is typical always is, and what the background explains better never.
    """
    ratios = _ratios(states_of(actions, background), demonstrations)
    shown = np.array([name for _, _, name in demonstrations])
    typical, least = np.empty(len(actions)), np.zeros(len(actions))
    for k, action in enumerate(actions):
        own = ratios[shown == action.action, k]
        typical[k] = own[np.isfinite(own)].mean() if np.isfinite(own).any() else 0.0
        others = ratios[shown != action.action, k]
        if len(others):
            least[k] = np.clip(np.median(others), 0.0, max(typical[k] / 2.0, 0.0))
    return Familiarity(typical, least)


def _ratios(states: States, demonstrations: Sequence[Shown]) -> Floats:
    """Return (n_demonstrations, n_classes) log-likelihood ratios to the background [nat per frame]."""
    ratios = np.empty((len(demonstrations), len(states.power)))
    for row, (tracks, table_height, _) in zip(ratios, demonstrations, strict=True):
        whole, roles = np.array([[0, len(tracks.pace) - 1]]), np.arange(len(tracks.objects))[None]
        row[:] = score_segments(tracks, table_height, whole, states, roles)[0][0] / len(tracks.pace)
    return ratios
