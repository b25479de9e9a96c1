"""Rounds: clients at work, something is killed and started again, and all go on by themselves."""

from __future__ import annotations

import random
import signal
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Self

from app.motion.model import FeatureSpecification, Model
from app.motion.simulation import Conditions, demonstrations, recording
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Trajectory
from app.registry import models, versions
from app.registry.artifacts import dump_model
from tests.chaos.caller import Caller
from tests.chaos.house import House, Process
from tests.chaos.judge import Judge
from tests.chaos.reader import listen
from tests.chaos.streamer import Habits, Pulse, Streamer
from tests.chaos.teacher import Mover, Teacher
from tests.chaos.told import Fault, Told

MODEL = "table-top"
N_ACTIONS = 40
LISTENED = 0
"""The player whose sessions are listened to."""
MOTIONS = 6
"""Different motions that are streamed."""
HABITS = (
    Habits(),
    Habits(encoding="json", again=0.1),
    Habits(chunk=25, ahead=0.005),
)
"""Of the players."""
BACK_S = 30.0
"""How long the clients may take to be back, and jobs and sessions to end [s]."""
QUIET_S = (0.0, 0.8)
"""Shortest and longest time from when all clients are back to the next kill [s]."""

STARTING_S = (0.3, 1.5)
"""How long after its start a server is killed once more, ready or not."""

ASLEEP = 4
"""For so many rounds a worker is paused: longer than it takes to be given up for dead."""

VICTIMS = {
    "sqlite": {"server": 0.5, "server, twice": 0.1, "worker": 0.15, "worker, paused": 0.1, "all": 0.15},
    "postgresql": {
        "server": 0.35,
        "server, twice": 0.1,
        "worker": 0.1,
        "worker, paused": 0.1,
        "postgres": 0.2,
        "all": 0.15,
    },
}
"""What is killed, and with what chance."""


@dataclass
class Act:
    """What came of some rounds on one database."""

    rounds: Counter[str] = field(default_factory=Counter)
    counts: Counter[str] = field(default_factory=Counter)
    resumed: list[float] = field(default_factory=list)
    elsewhere: list[float] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)


@cache
def taught() -> dict[int, Model]:
    """Return the models that are streamed to, by version."""
    shown, features = demonstrations(1), FeatureSpecification(("object",))
    return {number: fit_model(shown, features, TrainingOptions(n_states=1 + 2 * number)) for number in (1, 2)}


@cache
def motion(number: int) -> Trajectory:
    """Return one of the motions, about half a minute with dropouts."""
    return recording(100 + number, N_ACTIONS, Conditions(gap_share=0.1)).trajectory


def register(house: House) -> None:
    """Make the model that is streamed to."""
    with house.database.transaction() as tx:
        models.create(tx, name=MODEL, objects=["object"])
        for model in taught().values():
            versions.register(
                tx,
                MODEL,
                artifact_digest=house.store.put(dump_model(model)),
                actions=model.names,
                options={},
                demonstrations=[],
                library_versions={},
            )


class Player:
    """Streams one session after the other; somebody may listen to each."""

    def __init__(self, house: House, habits: Habits, seed: int, listened: bool = False) -> None:
        self._house, self._habits, self._listened = house, habits, listened
        self._rng = random.Random(seed)  # noqa: S311 (chance, no secret)
        self.sessions: list[Told] = []
        self.listeners: list[Told] = []
        self.pulse = Pulse()
        self._ears: list[threading.Thread] = []

    def run(self, leaving: threading.Event, closing: threading.Event) -> None:
        """Stream until told to leave; closing: begin no other session."""
        while not (leaving.is_set() or closing.is_set()):
            told = Told(motion(self._rng.randrange(MOTIONS)))
            self.sessions.append(told)
            seed = self._rng.randrange(2**32)
            if self._listened:
                self._let_listen(told)
            Streamer(self._house.url, told, self._habits, seed, leaving, self.pulse).run()
            if not told.ended:
                told.over.set()

    def join(self) -> None:
        """Wait until everybody who listens has heard the end."""
        for thread in self._ears:
            thread.join()

    def _let_listen(self, told: Told) -> None:
        self.listeners.append(listener := Told(told.motion))

        def attend() -> None:
            try:
                while not told.session_id:
                    if told.over.wait(0.02):
                        return
                listener.session_id, listener.version = told.session_id, told.version
                with Caller(self._house.url, told.over) as caller:
                    listen(caller, listener, told.over)
            except Exception:
                listener.fault("broken", "listener", traceback.format_exc())

        self._ears.append(threading.Thread(target=attend))
        self._ears[-1].start()


class Cast:
    """All clients of a house, each in a thread of its own."""

    def __init__(self, house: House, seed: int) -> None:
        self._house = house
        self._leaving, self._closing = threading.Event(), threading.Event()
        self.players = [
            Player(house, habits, seed * 100 + number, number == LISTENED)
            for number, habits in enumerate(HABITS)
        ]
        self._callers = [Caller(house.url, self._leaving) for _ in range(2)]
        self.teacher = Teacher(self._callers[0], seed)
        self.mover = Mover(self._callers[1], MODEL, "production")
        self.broken: list[Fault] = []
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        self.teacher.create()
        for player in self.players:
            self._go(partial(player.run, self._leaving, self._closing))
        self._go(partial(self.teacher.run, self._closing, self._leaving))
        self._go(partial(self.mover.run, self._closing))
        return self

    def __exit__(self, *_: object) -> None:
        """Let all of them finish; who does not in time has to leave."""
        self._closing.set()
        until = time.monotonic() + BACK_S
        for thread in self._threads:
            thread.join(max(until - time.monotonic(), 0.0))
        self._leaving.set()
        for thread in self._threads:
            thread.join()
        for player in self.players:
            player.join()
        for caller in self._callers:
            caller.close()

    def _go(self, work: Callable[[], None]) -> None:
        def guarded() -> None:
            try:
                work()
            except Exception:
                self.broken.append(Fault("broken", "client", traceback.format_exc()))

        self._threads.append(threading.Thread(target=guarded))
        self._threads[-1].start()

    def await_back(self, since: float) -> list[Fault]:
        """Wait until every player has got on after a time (``time.monotonic``); return who has not."""
        until = time.monotonic() + BACK_S
        while late := [player for player in self.players if player.pulse.progress <= since]:
            if time.monotonic() > until or self.broken:
                told = [player.sessions[-1] for player in late]
                return [Fault("lost", "session", f"{each.session_id} does not get on") for each in told]
            time.sleep(0.005)
        return []

    def resumed(self, since: float, ready: float) -> Iterator[float]:
        """Yield how long after ``ready`` the players that have been cut off since then were back [s]."""
        for player in self.players:
            after = [at for at in player.pulse.resumptions if at > since]
            if after:
                yield max(after[0] - ready, 0.0)


def play(house: House, kind: str, n_rounds: int, seed: int) -> Act:
    """Play some rounds in a house that has just been built, and judge them.

    Before that all is killed once more: what counts is what is kept, not what a process remembers.
    """
    act, rng = Act(), random.Random(seed)  # noqa: S311 (chance, no secret)
    asleep: dict[int, Process] = {}
    register(house)
    with Cast(house, seed) as cast:
        act.faults += cast.await_back(0.0)
        for number in range(n_rounds):
            if number in asleep:
                asleep.pop(number).send(signal.SIGCONT)
            (victim,) = rng.choices(list(VICTIMS[kind]), list(VICTIMS[kind].values()))
            time.sleep(rng.uniform(*QUIET_S))
            struck = time.monotonic()
            if victim == "worker, paused":
                asleep[number + ASLEEP] = rng.choice(house.workers)
                asleep[number + ASLEEP].send(signal.SIGSTOP)
            ready = strike(house, victim, rng)
            act.faults += cast.await_back(max(struck, ready))
            act.rounds[victim if len(house.servers) == 1 else f"{victim} (two servers)"] += 1
            elsewhere = len(house.servers) > 1 and victim in ("server", "server, twice")
            if elsewhere:
                act.elsewhere += cast.resumed(struck, struck)
            else:
                act.resumed += cast.resumed(struck, ready)
        for process in asleep.values():
            process.send(signal.SIGCONT)
    strike(house, "all", rng)
    with Caller(house.url) as caller:
        judge(Judge(caller, taught()), cast, act)
    return act


def strike(house: House, victim: str, rng: random.Random) -> float:
    """Kill, start again; return when all servers were ready."""
    server = rng.choice(house.servers)
    processes = {
        "worker": [rng.choice(house.workers)],
        "worker, paused": [],
        "postgres": [],
        "all": [*house.servers, *house.workers],
    }.get(victim, [server])
    postgres = house.postgres if victim in ("postgres", "all") else None
    if postgres is not None:
        postgres.kill()
    for process in processes:
        process.kill()
    if postgres is not None:
        postgres.start()
    for process in processes:
        process.start()
    if victim == "server, twice":
        time.sleep(rng.uniform(*STARTING_S))
        server.kill()
        server.start()
    return max(house.await_ready(number) for number in range(len(house.servers)))


def judge(court: Judge, cast: Cast, act: Act) -> None:
    """Add up what has happened, and what is wrong with it."""
    act.faults += cast.broken
    for player in cast.players:
        for told in player.sessions:
            act.faults += court.of_session(told)
            act.counts["sessions"] += bool(told.session_id)
            act.counts["resumptions"] += told.resumed
            act.counts["frames"] += told.durable + 1
            act.counts["events"] += len(told.events)
            act.counts["segments"] += sum(event["type"] == "segment" for event in told.events)
        for listener in player.listeners:
            act.faults += court.of_listener(listener)
            act.counts["events listened to"] += len(listener.events)
    act.faults += court.of_teacher(cast.teacher)
    for mover in (cast.mover, cast.teacher.promoted):
        act.faults += court.of_moves(mover)
        act.counts["alias moves"] += len(mover.moves)
    act.counts["jobs"] = len(cast.teacher.jobs)
    act.counts["versions"] = sum(number is not None for number in cast.teacher.jobs.values())
    act.counts["demonstrations"] = len(cast.teacher.demonstrations)
