"""The kernel: every prefix of a segment, against hmmlearn's decode and against what multiply-adds cost."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from hmmlearn.hmm import GaussianHMM
from numba import njit

from app.motion.conditioning import Tracks
from app.motion.lanes import States
from app.motion.model import N_SHAPE, ActionModel, Background
from app.motion.scoring import score_segments, states_of
from app.motion.simd import LANES, load, store
from app.motion.trajectory import Floats, Indices
from benchmarks import page, plots

N_CLASSES, N_STATES, N_FRAMES = 4, 10, 300
N_FEATURES = 6
"""Without roles: those of the movement alone."""
OF_STATES, OF_FRAMES = (4, 8, 16, 32), (75, 150, 300, 600)
REPETITIONS = 31
TIMES, MOST_TIMES = 180.0, 3.5
N_CHAINS, N_STEPS = 8, 20_000

IMAGE = "images/speed-kernel.svg"

TEXT = """\
{classes} classes of {states} states, {features} features: the ratios of every segment from the first of
{frames} frames to each later one. The goal of a segment moves its features, so each of the {frames} is a
pass of its own. *hmmlearn*: `GaussianHMM.decode` for each segment and class, the features given. *Bound*:
two multiply-adds for each feature, state and frame, as the square of a deviation takes, at the rate at
which this core does independent ones, {rate:.0f} thousand millions a second. {n} runs in turn; hmmlearn
once in every tenth."""


@dataclass(frozen=True)
class Times:
    """Of each run [s]: the kernel and hmmlearn; bound: what the multiply-adds take; rate: of them [1/s]."""

    kernel: Floats
    hmmlearn: Floats
    bound: float
    rate: float


class Problem:
    """Classes with so many states, and a motion of so many frames."""

    def __init__(self, n_states: int, n_frames: int) -> None:
        rng = np.random.default_rng(0)
        self.actions = [_action(rng, name, n_states) for name in "abcd"[:N_CLASSES]]
        hand = np.linspace(0.0, 1.0, n_frames + 1)[:, None] * [0.3, 0.0, 0.0]
        hand += rng.normal(0.0, 0.01, hand.shape)
        none = np.empty((0, n_frames + 1, 3)), np.empty((0, n_frames + 1))
        self.tracks = Tracks(hand, rng.normal(0.5, 0.2, n_frames + 1), *none)
        self.segments: Indices = np.array([(0, end) for end in range(1, n_frames + 1)])
        self.states: States = states_of(self.actions, Background(np.full(N_FEATURES, 2.0)))
        self.observed = rng.normal(0.0, 0.1, (n_frames + 1, N_FEATURES))

    @property
    def n_passed(self) -> int:
        """Frames of all segments."""
        return int(np.sum(self.segments[:, 1] - self.segments[:, 0] + 1))

    def kernel(self) -> None:
        """Score all segments."""
        score_segments(self.tracks, 0.0, self.segments, self.states, np.empty((1, 0), dtype=np.int64))

    def hmmlearn(self) -> None:
        """Decode all segments of each class."""
        chains = [_chain(action) for action in self.actions]
        for _, end in self.segments.tolist():
            for chain in chains:
                chain.decode(self.observed[: end + 1])


def _action(rng: np.random.Generator, name: str, n_states: int) -> ActionModel:
    return ActionModel(
        name,
        means=rng.normal(0.0, 0.1, (n_states, N_FEATURES)),
        variances=rng.uniform(0.05, 0.1, (n_states, N_FEATURES)) ** 2,
        stay=rng.uniform(0.5, 0.95, n_states),
        weights=np.ones(n_states),
        durations=np.ones(12),
        starts=np.zeros((12, 3)),
        ways=np.tile([1.0, 0.0, 0.0], (12, 1)),
        shapes=np.zeros((12, N_SHAPE)),
        repetition=1.0,
    )


def _chain(action: ActionModel) -> GaussianHMM:
    stay = np.append(action.stay[:-1], 1.0)
    chain = GaussianHMM(action.n_states, "diag", init_params="")
    chain.startprob_ = np.eye(action.n_states)[0]
    chain.transmat_ = np.diag(stay) + np.diag(1.0 - stay[:-1], 1)
    chain.means_, chain.covars_ = action.means, action.variances
    return chain


@njit(nogil=True)
def _multiply_and_add(room: Floats, n_steps: int) -> None:
    """Do N_CHAINS independent chains of fused multiply-adds of LANES numbers."""
    x, y = load(room, 8), load(room, 9)
    a, b, c, d = load(room, 0), load(room, 1), load(room, 2), load(room, 3)
    e, f, g, h = load(room, 4), load(room, 5), load(room, 6), load(room, 7)
    for _ in range(n_steps):
        a, b, c, d = a * x + y, b * x + y, c * x + y, d * x + y
        e, f, g, h = e * x + y, f * x + y, g * x + y, h * x + y
    for row, value in ((0, a), (1, b), (2, c), (3, d), (4, e), (5, f), (6, g), (7, h)):
        store(room, row, value)


def multiply_adds() -> float:
    """Return how many independent multiply-adds this core does [1/s]."""
    room = np.full((N_CHAINS + 2, LANES), 0.5)
    _multiply_and_add(room, 1)
    seconds = np.median(_timed(lambda: _multiply_and_add(room, N_STEPS), REPETITIONS))
    return float(N_CHAINS * LANES * N_STEPS / seconds)


def _timed(work: Callable[[], None], n_runs: int) -> Floats:
    seconds = np.empty(n_runs)
    for run in range(n_runs):
        begin = time.perf_counter()
        work()
        seconds[run] = time.perf_counter() - begin
    return seconds


def measure(n_states: int = N_STATES, n_frames: int = N_FRAMES, with_hmmlearn: bool = True) -> Times:
    """Score every prefix, compiled and by hmmlearn, in turn."""
    problem, rate = Problem(n_states, n_frames), multiply_adds()
    problem.kernel()
    kernel, hmmlearn = [], []
    for run in range(REPETITIONS):
        kernel.append(_timed(problem.kernel, 1)[0])
        if with_hmmlearn and run % 10 == 0:
            hmmlearn.append(_timed(problem.hmmlearn, 1)[0])
    bound = 2.0 * N_FEATURES * N_CLASSES * n_states * problem.n_passed / rate
    return Times(np.array(kernel), np.array(hmmlearn), bound, rate)


def section(images: Path | None) -> tuple[str, list[page.Goal]]:
    """Return the section on the kernel, and whether it is fast enough; draw its growth."""
    found = measure()
    rows = [
        [name, *(f"{value * 1e3:.2f}" for value in (np.median(of), of.min(), of.max()))]
        for name, of in (("kernel [ms]", found.kernel), ("hmmlearn [ms]", found.hmmlearn))
    ]
    kernel = float(np.median(found.kernel))
    times, over = float(np.median(found.hmmlearn)) / kernel, kernel / found.bound
    rows += [["bound [ms]", f"{found.bound * 1e3:.2f}", "", ""]]
    goals = [
        page.Goal(
            f"every prefix: ≥ {TIMES:g} times as fast as hmmlearn's `decode`", f"{times:.0f}", times >= TIMES
        ),
        page.Goal(f"≤ {MOST_TIMES:g} times the multiply-add bound", f"{over:.2f}", over <= MOST_TIMES),
    ]
    text = TEXT.format(
        classes=N_CLASSES,
        states=N_STATES,
        features=N_FEATURES,
        frames=N_FRAMES,
        rate=found.rate / 1e9,
        n=REPETITIONS,
    )
    parts = [f"## Kernel\n\n{text}\n", page.table(["", "median", "least", "most"], rows), _growth(images)]
    return "\n".join(parts), goals


def _growth(images: Path | None) -> str:
    by_states = [_both(measure(n, N_FRAMES, with_hmmlearn=False)) for n in OF_STATES]
    by_frames = [_both(measure(N_STATES, n, with_hmmlearn=False)) for n in OF_FRAMES]
    rows = [_row(f"{n} states", each) for n, each in zip(OF_STATES, by_states, strict=True)]
    rows += [_row(f"{n} frames", each) for n, each in zip(OF_FRAMES, by_frames, strict=True)]
    if images is not None:
        _draw(by_states, by_frames, images / IMAGE)
    table = page.table(["", "kernel [ms]", "bound [ms]", "kernel / bound"], rows)
    return f"{table}\n![How the kernel grows]({IMAGE})\n"


def _both(found: Times) -> tuple[float, float]:
    return float(np.median(found.kernel)), found.bound


def _row(name: str, found: tuple[float, float]) -> list[str]:
    kernel, bound = found
    return [name, f"{kernel * 1e3:.2f}", f"{bound * 1e3:.2f}", f"{kernel / bound:.2f}"]


def _draw(
    by_states: Sequence[tuple[float, float]], by_frames: Sequence[tuple[float, float]], file: Path
) -> None:
    states = [n / N_STATES for n in OF_STATES]
    frames = [n / N_FRAMES for n in OF_FRAMES]
    plots.curves(
        {
            "states, kernel": (states, [kernel * 1e3 for kernel, _ in by_states]),
            "states, bound": (states, [bound * 1e3 for _, bound in by_states]),
            "frames, kernel": (frames, [kernel * 1e3 for kernel, _ in by_frames]),
            "frames, bound": (frames, [bound * 1e3 for _, bound in by_frames]),
        },
        f"times {N_STATES} states, times {N_FRAMES} frames",
        "every prefix [ms]",
        file,
        logarithmic=True,
    )
