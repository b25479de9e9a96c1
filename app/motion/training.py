"""From demonstrations to a model (Sec. III-B of the paper)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from app.motion.baum_welch import COMPILED, Chain, Estimator
from app.motion.conditioning import Tracks, condition
from app.motion.errors import FitFailed, RoleMissing, UnusableDemonstration
from app.motion.features import BLEND, N_DEVIATIONS, encode
from app.motion.model import (
    N_OF_MOVEMENT,
    N_OF_ROLE,
    PACE,
    PHASE,
    ActionModel,
    Background,
    FeatureSpecification,
    Model,
)
from app.motion.resampling import resample, stack
from app.motion.shape import fit_shape
from app.motion.standing import familiarity_of, rest_of
from app.motion.trajectory import Demonstration, Floats, Indices

MIN_DEMONSTRATIONS = 2
"""Demonstrations without which a class has no spread."""

MIN_FRAMES = 12
"""Frames, as recorded, without which a demonstration has no shape."""

MIN_DURATION = 0.2
"""Shorter than this is no action [s]."""

MAX_DURATION = 600.0
"""Longer than this is no action either: a wrong unit of time, perhaps [s]."""

STATES = (4, 6, 8, 10, 12)
"""Numbers of states tried on each class."""

PHASE_FLOOR = 0.05
"""Least standard deviation of a state in phase: nobody times a movement better than to a twentieth."""

CONTEXT_SHARE = 2.0 / 3.0
"""Height and distances hang on no end point: they have this share of the least standard deviation."""

PACE_FLOOR = 0.4
"""Least standard deviation of a state in the logarithm of a speed: people differ in pace by a third."""

MIN_STAY = 0.1
"""Training starts with no less a probability of staying: a state that can never be stayed in never will."""

N_FOLDS = 3

BACKGROUND = 10.0
"""Width of the background in standard deviations of all frames: 96 % of any distribution lie in it
(Chebyshev's inequality)."""

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class TrainingOptions:
    """How to train.

    n_states: number of states of every class, None to choose it for each from its demonstrations;
    deviation_floor: least standard deviation of a state in the deviation from the straight line, in height
    and distances CONTEXT_SHARE of it [m]; seed: of the folds that choose the number of states.
    """

    n_states: int | None = None
    deviation_floor: float = 0.0075
    seed: int = 0


def check_demonstration(index: int, demonstration: Demonstration, features: FeatureSpecification) -> None:
    """Raise UnusableDemonstration or RoleMissing where nothing can be learned from a demonstration."""
    trajectory = demonstration.trajectory

    def refuse(detail: str) -> UnusableDemonstration:
        return UnusableDemonstration(index, demonstration.action, detail)

    for role in features.objects:
        if role not in trajectory.objects:
            raise RoleMissing(role, tuple(trajectory.objects))
    if len(trajectory) < MIN_FRAMES:
        raise refuse(f"has {len(trajectory)} frames, needs at least {MIN_FRAMES}")
    duration = float(trajectory.times[-1] - trajectory.times[0])
    if duration < MIN_DURATION:
        raise refuse(f"lasts {duration:.3f} s, needs at least {MIN_DURATION} s")
    if duration > MAX_DURATION:
        raise refuse(f"lasts {duration:.3g} s, over {MAX_DURATION:g} s: a wrong unit of time?")
    tracks = stack(trajectory, features.objects)
    missing = np.isnan(tracks).any(axis=(1, 2))
    for name, frame in (("first", 0), ("last", -1)):
        if np.isnan(trajectory.hand[frame]).any():
            raise refuse(f"its {name} frame is a dropout of the hand; it must be there")
    if 2 * int(missing.sum()) > len(trajectory):
        raise refuse(f"{int(missing.sum())} of its {len(trajectory)} frames are dropouts, over half")
    if np.linalg.norm(trajectory.hand[-1] - trajectory.hand[0]) < BLEND:
        raise refuse(f"starts and ends at the same point, within {BLEND * 1000:g} mm: it has no direction")


def fit_model(
    demonstrations: Sequence[Demonstration],
    features: FeatureSpecification,
    options: TrainingOptions,
    base: Model | None = None,
    learned: Collection[int] = (),
    progress: Progress = lambda *_: None,
    estimator: Estimator = COMPILED,
) -> Model:
    """Return a model of all demonstrations, one action model per class.

    ``learned`` holds the indices of those that ``base`` was trained on: a class with nothing new keeps its
    action model, a class with more goes on from it with the new ones alone, a class that lost some is
    trained afresh. ``progress(done, total, message)`` is called before each class; what it raises ends the
    training. estimator: trains the chains; ``by_hmmlearn.HMMLEARN`` gives the same, more slowly. Raises
    RoleMissing, UnusableDemonstration, FitFailed.
    """
    examples: dict[str, list[Example]] = {}
    for example in examples_of(demonstrations, features):
        examples.setdefault(example.action, []).append(example)
    models = []
    for done, (action, of_class) in enumerate(sorted(examples.items())):
        progress(done, len(examples), f"training {action}")
        new = [example for example in of_class if example.place not in learned]
        known = _known(base, action, len(of_class) - len(new))
        if known is None:
            models.append(fit_action(of_class, features, options, estimator))
        else:
            models.append(_fit_further(known, new, features, options, estimator) if new else known)
    progress(len(examples), len(examples), "trained")
    frames = np.concatenate([example.sequence for of_class in examples.values() for example in of_class])
    background = Background(BACKGROUND * np.maximum(frames.std(axis=0), _floor(features, options)))
    shown = [(e.tracks, e.table_height, e.action) for of_class in examples.values() for e in of_class]
    familiarity, rest = familiarity_of(models, background, shown), rest_of([each for each, _, _ in shown])
    return Model(features, tuple(models), background, familiarity, rest)


def _floor(features: FeatureSpecification, options: TrainingOptions) -> Floats:
    """Return the (n_features,) least standard deviations."""
    floor = np.full(features.n_features, CONTEXT_SHARE * options.deviation_floor)
    floor[:N_DEVIATIONS] = options.deviation_floor
    floor[PACE], floor[PHASE] = PACE_FLOOR, PHASE_FLOOR
    floor[N_OF_MOVEMENT + 1 :: N_OF_ROLE] = PACE_FLOOR
    return floor


def conditioned(demonstration: Demonstration, features: FeatureSpecification) -> Tracks:
    """Return a demonstration as recognition sees it, up to the last point where its hand is there."""
    trajectory = resample(demonstration.trajectory, features.rate)
    present = np.flatnonzero(~np.isnan(trajectory.hand).any(axis=1))
    positions = stack(trajectory, features.objects)[: present[-1] + 1]
    return condition(positions, features)


def observe(tracks: Tracks, table_height: float) -> Floats:
    """Return the (n_frames, n_features) features of conditioned motion that is one movement.

    Frames in which anything is missing teach nothing and are left out.
    """
    positions = encode(tracks.hand, tracks.objects, table_height)
    of_roles = [
        column for pair in zip(positions.T[N_DEVIATIONS + 1 :], tracks.paces, strict=True) for column in pair
    ]
    phase = np.linspace(0.0, 1.0, len(tracks.pace))
    of_movement = positions[:, : N_DEVIATIONS + 1]
    sequence: Floats = np.column_stack([of_movement, tracks.pace, phase, *of_roles])
    return sequence[~np.isnan(sequence).any(axis=1)]


class Example(NamedTuple):
    """A demonstration as it is learned from.

    place: its index in the list; action: its class; tracks: conditioned; table_height [m]; sequence:
    (n_frames, n_features); duration [s]; start, way: (3,) where it starts and from there to its goal [m];
    shape: as in ``fit_shape``.
    """

    place: int
    action: str
    tracks: Tracks
    table_height: float
    sequence: Floats
    duration: float
    start: Floats
    way: Floats
    shape: Floats


def examples_of(demonstrations: Sequence[Demonstration], features: FeatureSpecification) -> list[Example]:
    """Return what is learned from demonstrations; raises UnusableDemonstration, RoleMissing."""
    examples = []
    for index, demonstration in enumerate(demonstrations):
        check_demonstration(index, demonstration, features)
        times, hand = demonstration.trajectory.times, demonstration.trajectory.hand
        tracks, height = conditioned(demonstration, features), demonstration.scene.table_height
        example = Example(
            place=index,
            action=demonstration.action,
            tracks=tracks,
            table_height=height,
            sequence=observe(tracks, height),
            duration=float(times[-1] - times[0]),
            start=hand[0],
            way=hand[-1] - hand[0],
            shape=fit_shape(times, hand),
        )
        examples.append(example)
    return examples


def _check_lengths(examples: Sequence[Example], needed: int) -> None:
    for example in examples:
        if (n_frames := len(example.sequence)) < needed:
            detail = f"has {n_frames} usable frames at the internal rate, needs at least {needed}"
            raise UnusableDemonstration(example.place, example.action, detail)


def _known(base: Model | None, action: str, n_old: int) -> ActionModel | None:
    """Return the base's action model if all that it was trained on is still there."""
    if base is None or action not in base.names:
        return None
    known = base.action(action)
    return known if known.n_demonstrations == n_old else None


def fit_action(
    examples: Sequence[Example],
    features: FeatureSpecification,
    options: TrainingOptions,
    estimator: Estimator = COMPILED,
) -> ActionModel:
    """Return the action model of a class by its examples; raises UnusableDemonstration, FitFailed."""
    action = examples[0].action
    if len(examples) < MIN_DEMONSTRATIONS:
        raise FitFailed(action, f"has {len(examples)} demonstration, needs at least {MIN_DEMONSTRATIONS}")
    _check_lengths(examples, options.n_states or 2 * STATES[0])
    sequences = [example.sequence for example in examples]
    floor = _floor(features, options) ** 2
    n_states = options.n_states or _choose_states(sequences, floor, options.seed, estimator)
    chain = estimator.train_chain(sequences, _even(sequences, n_states), floor, None)
    return _action_model(chain, examples, estimator)


def _fit_further(
    known: ActionModel,
    examples: Sequence[Example],
    features: FeatureSpecification,
    options: TrainingOptions,
    estimator: Estimator,
) -> ActionModel:
    _check_lengths(examples, known.n_states)
    floor = _floor(features, options) ** 2
    before = Chain(known.means, known.variances, known.stay, known.weights)
    begin = before._replace(stay=np.maximum(before.stay, MIN_STAY))
    chain = estimator.train_chain([example.sequence for example in examples], begin, floor, before)
    new = _action_model(chain, examples, estimator)
    return replace(
        new,
        durations=np.concatenate([known.durations, new.durations]),
        starts=np.concatenate([known.starts, new.starts]),
        ways=np.concatenate([known.ways, new.ways]),
        shapes=np.concatenate([known.shapes, new.shapes]),
        repetition=float(
            np.average(
                [known.repetition, new.repetition], weights=[known.n_demonstrations, new.n_demonstrations]
            )
        ),
    )


def _action_model(chain: Chain, examples: Sequence[Example], estimator: Estimator) -> ActionModel:
    action = examples[0].action
    if not all(np.isfinite(array).all() for array in chain):
        detail = "training gave numbers that are not finite: its demonstrations are too few or too alike"
        raise FitFailed(action, detail)
    return ActionModel(
        action,
        *chain,
        durations=np.array([example.duration for example in examples]),
        starts=np.array([example.start for example in examples]),
        ways=np.array([example.way for example in examples]),
        shapes=np.array([example.shape for example in examples]),
        repetition=estimator.repetition([example.sequence for example in examples], chain),
    )


def _even(sequences: Sequence[Floats], n_states: int) -> Chain:
    """Return the chain that divides every sequence evenly among the states: where training starts."""
    lengths, states = np.array([len(sequence) for sequence in sequences]), np.arange(n_states)
    least, more = np.divmod(lengths[:, None], n_states)
    n_frames = least + (states < more)
    of_frame = np.repeat(np.tile(states, len(sequences)), n_frames.ravel())
    features, of_state = np.concatenate(sequences), (of_frame == states[:, None]).astype(np.float64)
    weights = n_frames.sum(axis=0).astype(np.float64)
    means = of_state @ features / weights[:, None]
    variances = of_state @ (features - means[of_frame]) ** 2 / weights[:, None]
    return Chain(means, variances, np.maximum(1.0 - len(sequences) / weights, MIN_STAY), weights)


def _choose_states(sequences: Sequence[Floats], floor: Floats, seed: int, estimator: Estimator) -> int:
    """Return the fewest states that explain held-out demonstrations within one standard error of the best."""
    most = min(len(sequence) for sequence in sequences) // 2
    candidates = [n_states for n_states in STATES if n_states <= most]
    fold = np.random.default_rng(seed).permutation(len(sequences)) % min(N_FOLDS, len(sequences))
    held_out = np.array([_held_out(sequences, n, floor, fold, estimator) for n in candidates])
    best = held_out[held_out.sum(axis=1).argmax()]
    for n_states, of_candidate in zip(candidates, held_out, strict=True):
        loss = best - of_candidate
        if loss.mean() <= loss.std() / np.sqrt(len(loss)):
            return n_states
    return candidates[-1]


def _held_out(
    sequences: Sequence[Floats], n_states: int, floor: Floats, fold: Indices, estimator: Estimator
) -> Floats:
    """Return (n_sequences,) log-likelihoods, each under a chain trained on the other folds [nat]."""
    result = np.empty(len(sequences))
    for index in np.unique(fold):
        training = [s for s, of in zip(sequences, fold, strict=True) if of != index]
        held = [s for s, of in zip(sequences, fold, strict=True) if of == index]
        chain = estimator.train_chain(training, _even(training, n_states), floor, None)
        result[fold == index] = estimator.log_likelihoods(held, chain)
    return result
