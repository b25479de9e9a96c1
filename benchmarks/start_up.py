"""How soon `gesta serve` is ready, and what it and its worker hold in memory.

python benchmarks/start_up.py [--output PAGE]
"""

from __future__ import annotations

import argparse
import http.client
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.motion.trajectory import Floats
from benchmarks import page

N_STARTS = 7
SETTLED_S = 3.0
"""How long after a server is ready its memory and its worker's are looked at [s]."""
DEADLINE_S = 120.0

MOST_S, MOST_MB = 2.5, 250.0
"""What is asked for: time to ready [s], memory of the server [MB]."""

GESTA = [sys.executable, "-m", "app.cli"]

INTRODUCTION = """\
`gesta serve` with its embedded worker, on an SQLite database that is there already and with kernels compiled
by `gesta warm`. *Ready*: from starting the process until `/readyz` answers 200. *Resident*: {settled:g} s
later, as Linux counts it, pages that are shared with other processes included."""


@dataclass(frozen=True)
class StartUp:
    """Of each start the time to ready [s], the memory of server and worker [MB]; kernels compiled in all."""

    ready: Floats
    server: Floats
    worker: Floats
    n_compiled: int


def measure(n_starts: int = N_STARTS) -> StartUp:
    """Start a server so many times, on a cache of its own that `gesta warm` has filled."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        environment = {
            "GESTA_DATABASE_URL": f"sqlite:///{folder}/gesta.db",
            "GESTA_STORE_URL": f"{folder}/store",
            "NUMBA_CACHE_DIR": f"{folder}/kernels",
        }
        for command in ("warm", "migrate"):
            subprocess.run([*GESTA, command], cwd=page.ROOT, env={**os.environ, **environment}, check=True)
        before = _kernels(Path(folder))
        ready, server, worker = np.array([_start(environment) for _ in range(n_starts)]).T
        n_compiled = len(_kernels(Path(folder)) ^ before)
    return StartUp(ready, server, worker, n_compiled)


def _kernels(folder: Path) -> set[tuple[str, int]]:
    """Return the files of the cache, each with the time of its last change."""
    files = (path for path in (folder / "kernels").rglob("*") if path.is_file())
    return {(str(path), path.stat().st_mtime_ns) for path in files}


def _start(environment: dict[str, str]) -> tuple[float, float, float]:
    """Return the time until a server is ready [s], and its memory and its worker's [MB]."""
    begin = time.perf_counter()
    with _serving(environment) as (process, port):
        while not _ready(port):
            if process.poll() is not None or time.perf_counter() - begin > DEADLINE_S:
                raise RuntimeError("the server did not start")
            time.sleep(0.005)
        took = time.perf_counter() - begin
        time.sleep(SETTLED_S)
        return took, resident(process.pid), sum(resident(child) for child in _children(process.pid))


@contextmanager
def _serving(environment: dict[str, str]) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """Run a server; give the process and its port as soon as it listens."""
    process = subprocess.Popen(
        [*GESTA, "serve", "--port", "0"],
        cwd=page.ROOT,
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert process.stdout is not None  # noqa: S101 (it is piped)
        told = re.search(r"http://[\d.]+:(\d+)", process.stdout.readline())
        if told is None:
            raise RuntimeError("the server did not start")
        yield process, int(told[1])
    finally:
        process.terminate()
        process.communicate()


def _ready(port: int) -> bool:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=DEADLINE_S)
    try:
        connection.request("GET", "/readyz")
        return connection.getresponse().status == 200
    except ConnectionError:
        return False
    finally:
        connection.close()


def resident(process: int) -> float:
    """Return the memory that a process holds [MB]."""
    status = Path(f"/proc/{process}/status").read_text()
    [kibibytes] = re.findall(r"VmRSS:\s+(\d+)", status)
    return int(kibibytes) * 1024 / 1e6


def _children(process: int) -> list[int]:
    lists = Path(f"/proc/{process}/task").glob("*/children")
    return [int(child) for path in lists for child in path.read_text().split()]


def section(found: StartUp) -> tuple[str, list[page.Goal]]:
    """Return the section on starts, and whether they are quick and lean enough."""
    rows = [
        [name, *(f"{value:.{digits}f}" for value in (np.median(values), values.min(), values.max()))]
        for name, values, digits in (
            ("ready [s]", found.ready, 2),
            ("server, resident [MB]", found.server, 0),
            ("worker, resident [MB]", found.worker, 0),
        )
    ]
    ready, server = float(np.median(found.ready)), float(found.server.max())
    goals = [
        page.Goal(f"ready in ≤ {MOST_S:g} s", f"{ready:.2f} s", ready <= MOST_S),
        page.Goal(f"≤ {MOST_MB:g} MB resident", f"{server:.0f} MB", server <= MOST_MB),
        page.Goal("nothing compiled at start", f"{found.n_compiled} kernels", found.n_compiled == 0),
    ]
    head = f"## Start, {len(found.ready)} times"
    return f"{head}\n\n{page.table(['', 'median', 'least', 'most'], rows)}", goals


def main() -> None:
    """Measure, print and write the page."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--output", type=Path, help="page to write")
    given = options.parse_args()
    text, goals = section(measure())
    head = page.heading("Start-up", INTRODUCTION.format(settled=SETTLED_S))
    page.publish("\n".join([head, page.goals(goals), text]), given.output)


if __name__ == "__main__":
    main()
