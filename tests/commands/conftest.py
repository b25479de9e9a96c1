"""Commands as a user runs them, in this process or in one of their own, against the real server."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Self

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from app.cli import cli
from app.client import METRES, GestaClient, trajectory
from app.motion.model import Model
from app.motion.simulation import recording
from app.motion.trajectory import Recording, Trajectory
from tests.client.cutting import Wire, wire_to
from tests.serving import ROOT, Server, serving

GESTA = [sys.executable, "-W", "error", "-m", "app.cli"]
RUN_S = 60.0
SEEN = recording(5, 5)
MOTION = SEEN.trajectory

Run = Callable[..., Result]


class Started:
    """A command that is at work and tells JSON lines; it is killed where it takes too long."""

    def __init__(self, log: Path, words: Iterable[object], url: str) -> None:
        self._log = log
        with log.open("wb") as told:
            self._process = subprocess.Popen(
                [*GESTA, *map(str, words)],
                cwd=ROOT,
                env={**os.environ, "GESTA_URL": url},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=told,
                text=True,
            )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._input, self._output = self._process.stdin, self._process.stdout
        self._watchdog = threading.Timer(RUN_S, self._process.kill)

    def __enter__(self) -> Self:
        self._watchdog.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._watchdog.cancel()
        self._process.kill()
        self._process.wait()
        self._output.close()
        with suppress(BrokenPipeError):
            self._input.close()

    def write(self, text: str) -> None:
        """Give it input."""
        self._input.write(text)
        self._input.flush()

    def first(self) -> dict[str, Any]:
        """Return the next line that it tells."""
        told: dict[str, Any] = json.loads(self._output.readline())
        return told

    def told(self, pattern: str) -> str:
        """Return what it tells beside its result, once that has such a part."""
        while not (found := re.search(pattern, self._log.read_text())):
            assert self._process.poll() is None, self._log.read_text()
            time.sleep(0.02)
        return found[1]

    def interrupt(self) -> None:
        """Do what Ctrl-C does."""
        self._process.send_signal(signal.SIGINT)

    def finished(self, code: int = 0, *, open_input: bool = False) -> tuple[list[dict[str, Any]], str]:
        """Wait for its end; return the further lines, and what it told beside them."""
        if not open_input:
            self._input.close()
        lines = self._output.readlines()
        assert self._process.wait() == code, self._log.read_text()
        beside = self._log.read_text()
        assert "Traceback" not in beside
        return [json.loads(line) for line in lines], beside


Start = Callable[..., Started]


def until_taken(url: str, process: Started, n_frames: int) -> None:
    """Wait until the server has so many frames of the session that a command streams."""
    session_id = process.told(r"session (\w+)")
    with GestaClient(url) as client:
        deadline = time.monotonic() + RUN_S
        while client.session(session_id)["frames"] < n_frames:
            assert time.monotonic() < deadline, client.session(session_id)
            time.sleep(0.02)


def gesta(*words: object, url: str = "http://127.0.0.1:9") -> Result:
    """Run a command here, with the server's address in the environment."""
    outcome = CliRunner(env={"GESTA_URL": url, "COLUMNS": "200"}).invoke(cli, [str(word) for word in words])
    assert "Traceback" not in outcome.output
    assert outcome.exception is None or isinstance(outcome.exception, SystemExit), outcome.exception
    return outcome


@pytest.fixture(scope="package")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """The real server on an empty SQLite database; the tests of this folder share it."""
    with serving(tmp_path_factory.mktemp("server")) as running:
        yield running


@pytest.fixture(scope="package")
def table_top(server: Server, trained: Model) -> str:
    """The name of a model on the server that has a version."""
    return server.teach(trained)


@pytest.fixture
def run(server: Server) -> Run:
    """Run a command here, which must end well unless ``code`` says how; return its outcome."""

    def run(*words: object, code: int = 0, url: str = server.url) -> Result:
        outcome = gesta(*words, url=url)
        assert outcome.exit_code == code, outcome.output
        return outcome

    return run


@pytest.fixture
def start(server: Server, tmp_path: Path) -> Iterator[Start]:
    """Start a command in a process of its own."""
    with ExitStack() as started:

        def start(*words: object, url: str = server.url) -> Started:
            return started.enter_context(Started(tmp_path / "told", words, url))

        yield start


@pytest.fixture
def client(server: Server) -> Iterator[GestaClient]:
    """A client of the server."""
    with GestaClient(server.url) as opened:
        yield opened


@pytest.fixture
def wire(server: Server) -> Iterator[Wire]:
    """A way to the server that can be cut."""
    with wire_to(server) as opened:
        yield opened


def as_lines(motion: Trajectory, start: int = 0, stop: int | None = None) -> str:
    """Return frames as lines of JSON, a dropout null."""
    sent = trajectory(motion.times, motion.hand, motion.objects)
    rows = zip(sent["t"], sent["hand"], *sent["objects"].values(), strict=True)
    lines = [
        json.dumps({"t": t, "hand": hand, "objects": dict(zip(sent["objects"], places, strict=True))})
        for t, hand, *places in rows
    ]
    return "".join(f"{line}\n" for line in lines[start:stop])


def labels_of(seen: Recording) -> list[dict[str, Any]]:
    """Return the labels of a recording as they are sent."""
    times = seen.trajectory.times
    return [
        {
            "action": segment.action,
            "start_s": float(times[segment.start]),
            "end_s": float(times[min(segment.end, len(times) - 1)]),
        }
        for segment in seen.segments
    ]


def write_body(path: Path, seen: Recording, *, labelled: bool = False) -> Path:
    """Write a recording as the body of a request."""
    motion = trajectory(seen.trajectory.times, seen.trajectory.hand, seen.trajectory.objects)
    recorded = {"recording": {"trajectory": motion, "segments": labels_of(seen)}}
    path.write_text(json.dumps({"geometry": METRES, **(recorded if labelled else {"trajectory": motion})}))
    return path


def write_table(
    path: Path, motion: Trajectory, header: str = "t,hand.x,hand.y,hand.z", name: str = "object"
) -> Path:
    """Write a recording with one object as CSV; a dropout is empty."""
    columns = [motion.times[:, None], motion.hand, motion.objects["object"]]
    rows = [
        ",".join("" if math.isnan(cell) else repr(cell) for cell in row)
        for row in np.hstack(columns).tolist()
    ]
    path.write_text("\n".join([f"{header},{name}.x,{name}.y,{name}.z", *rows]) + "\n")
    return path
