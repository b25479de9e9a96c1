"""Before it ends: what the movement under way is held for, and where it is said to go."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from app.motion.hypothesis import Hypothesis
from app.motion.recogniser import Recogniser
from app.motion.simulation import GRIP, UNTRAINED_ANGLE, UNTRAINED_DISTANCES
from app.motion.trajectory import Floats, Recording, Segment
from benchmarks import page
from benchmarks.comparison import told
from benchmarks.teaching import Source, model, tests

SHARES = (0.25, 0.5, 0.75)
"""Of a true action that are over."""

RIGHT, ERROR = (0.80, 0.95, 0.99), 0.05
"""What is asked for at these, and of the calibration, on the simulator."""

N_BINS = 10

N_ELSEWHERE = 3
"""Candidates where no movement goes."""

APART = 0.1
"""At least so far from one candidate to another [m]."""

MOST = 40
"""Sequences of each seed or fold."""

TEXT = """\
When 25, 50 and 75 % of a true action are over, the likeliest action of `hypothesis()` is held against the
truth; having none is wrong. *ECE* is the expected calibration error of its posterior (Naeini, Cooper and
Hauskrecht, AAAI 2015), all three together, {bins} bins. *Goals*: how often the likeliest goal lies within
{near} m of the true one, where the sequence's own and {elsewhere} other places are given; the object is one
more. At most {most} sequences of each
seed or fold, all together."""


@dataclass(frozen=True)
class Guess:
    """At a share of an action: whether the likeliest is right, and its posterior, None without hypothesis."""

    share: float
    right: bool
    posterior: float | None


def under_way(
    recogniser: Recogniser, recording: Recording
) -> Iterator[tuple[Segment, float, Hypothesis | None]]:
    """Yield each true segment, each of SHARES, and what the recogniser says then."""
    pushed = 0
    for segment in recording.segments:
        for share in SHARES:
            stop = _frame(segment, share) + 1
            recogniser.push(recording.trajectory.part(pushed, stop))
            pushed = stop
            yield segment, share, recogniser.hypothesis()


def _frame(segment: Segment, share: float) -> int:
    return segment.start + round(share * (segment.end - segment.start))


def actions(source: Source, n_sequences: int) -> list[Guess]:
    """Return what the actions of a source's tests are held for."""
    guesses = []
    for labelled in tests(source, n_sequences)[:MOST]:
        for segment, share, said in under_way(Recogniser(model(source)), labelled.recording):
            if said is None or not said.actions:
                guesses.append(Guess(share, right=False, posterior=None))
            else:
                best = max(said.actions, key=lambda each: each.posterior)
                guesses.append(Guess(share, best.action == segment.action, best.posterior))
    return guesses


def goals(source: Source, n_sequences: int) -> list[Guess]:
    """Return where the movements of the simulator's tests are said to go."""
    guesses = []
    for seed, labelled in enumerate(tests(source, n_sequences)[:MOST]):
        places, truth = candidates(labelled.recording, seed)
        recogniser = Recogniser(model(source), goals=places)
        for segment, share, said in under_way(recogniser, labelled.recording):
            if said is None or not said.goals:
                guesses.append(Guess(share, right=False, posterior=None))
            else:
                best = max(said.goals, key=lambda name: said.goals[name])
                there = {
                    name: track[_frame(segment, share)]
                    for name, track in labelled.recording.trajectory.objects.items()
                }
                off = float(np.linalg.norm((there | places)[best] - places[truth[segment]]))
                guesses.append(Guess(share, off < APART / 2, said.goals[best]))
    return guesses


def candidates(recording: Recording, seed: int) -> tuple[dict[str, Floats], dict[Segment, str]]:
    """Return named places (3,) [m], and the name of the one where each segment goes."""
    rng = np.random.default_rng(seed)
    hand = recording.trajectory.hand
    places: list[Floats] = []
    goes: dict[Segment, int] = {}
    for segment in recording.segments:
        end = hand[min(segment.end, len(hand) - 1)]
        near = [index for index, place in enumerate(places) if np.linalg.norm(place - end) < APART / 2]
        goes[segment] = near[0] if near else len(places)
        places += [] if near else [end]
    n_places = len(places) + N_ELSEWHERE
    while len(places) < n_places:
        angle = rng.uniform(-UNTRAINED_ANGLE, UNTRAINED_ANGLE)
        place = GRIP + rng.uniform(*UNTRAINED_DISTANCES) * np.array([np.sin(angle), np.cos(angle), 0.0])
        if min(float(np.linalg.norm(place - other)) for other in places) >= APART:
            places.append(place)
    order = rng.permutation(n_places).tolist()
    names = {index: f"place_{number}" for number, index in enumerate(order)}
    given = {names[index]: places[index] for index in order}
    return given, {segment: names[index] for segment, index in goes.items()}


def calibration_error(guesses: Iterable[Guess]) -> float:
    """Return the expected calibration error over N_BINS equal bins of the posterior."""
    told_of = [(each.posterior, each.right) for each in guesses if each.posterior is not None]
    if not told_of:
        return 1.0
    posterior, right = np.array(told_of, dtype=np.float64).T
    bins = np.minimum((posterior * N_BINS).astype(int), N_BINS - 1)
    gaps = np.abs(np.bincount(bins, right, N_BINS) - np.bincount(bins, posterior, N_BINS))
    return float(gaps.sum() / len(right))


def accuracies(guesses: Sequence[Guess]) -> list[float]:
    """Return how often the likeliest is right, at each of SHARES."""
    return [float(np.mean([each.right for each in guesses if each.share == share])) for share in SHARES]


def section(pool: Executor, sources: Sequence[Source], n_sequences: int) -> tuple[str, list[page.Goal]]:
    """Return the section on what is known before an action ends, and whether what is asked of it is met."""
    jobs = {source: pool.submit(actions, source, n_sequences) for source in sources}
    simulators = [source for source in sources if source.folder is None]
    going = [pool.submit(goals, source, n_sequences) for source in simulators]
    rows, asked = [], []
    for title in dict.fromkeys(source.title for source in sources):
        guesses = [each for source, job in jobs.items() if source.title == title for each in job.result()]
        right, error = accuracies(guesses), calibration_error(guesses)
        rows.append([title, "actions", *map(told, right), told(error)])
        if any(source.title == title for source in simulators):
            asked += _asked(title, right, error)
    if going:
        guesses = [each for job in going for each in job.result()]
        rows.append(["simulator", "goals", *map(told, accuracies(guesses)), told(calibration_error(guesses))])
    names = ["", "", *(f"{share:.0%}" for share in SHARES), "ECE"]
    text = TEXT.format(bins=N_BINS, elsewhere=N_ELSEWHERE, most=MOST, near=APART / 2)
    return f"## Before it ends\n\n{text}\n\n{page.table(names, rows, n_words=2)}", asked


def _asked(title: str, right: Sequence[float], error: float) -> list[page.Goal]:
    asked = [
        page.Goal(f"{title}: action right at {share:.0%} of it ≥ {least:g}", told(value), value >= least)
        for share, value, least in zip(SHARES, right, RIGHT, strict=True)
    ]
    return [*asked, page.Goal(f"{title}: calibration error ≤ {ERROR:g}", told(error), error <= ERROR)]
