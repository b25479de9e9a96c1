"""How soon the page is there, and how often it draws while many stream, in Chromium.

python benchmarks/in_browser.py [--output PAGE]
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.client import GestaClient, trajectory
from app.demo import serving
from app.motion.simulation import demonstrations
from benchmarks import page
from tests.browser.conftest import FLAGS
from tests.browser.streaming import streaming
from tests.browser.waiting import until

VIEWS = ("live", "recordings", "models", "generate")
N_LOADS, N_STREAMS, STREAM_S, N_SECONDS = 5, 10, 16.0, 10
SOONEST_MS, OFTEN = 1500.0, 20.0
"""What is asked for: interactive within so many milliseconds, so many drawings a second."""

INTERACTIVE = "performance.getEntriesByName('gesta:interactive')[0].startTime"
DRAWN = "Number(document.querySelector('canvas.stage-canvas').dataset.drawn)"
STREAMED = "document.querySelector('main').dataset.frames > 10"

INTRODUCTION = f"""\
The page of `gesta serve` on loopback, in Debian's Chromium without a screen. WebGL is drawn by software, on
the same cores that serve and that stream. *Interactive*: from the request until what is there answers,
{N_LOADS} loads of each view. *Drawings*: of the scene of Live in each of {N_SECONDS} seconds, while
{N_STREAMS} sessions stream 100 frames a second each."""


@contextmanager
def browsing() -> Iterator[tuple[str, Page]]:
    """Run a server that knows ten grasps, and a browser; yield the address and a page."""
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder)) as url,
        GestaClient(url) as gesta,
        sync_playwright() as playwright,
    ):
        gesta.create_model("table-top", ["object"])
        sent = [
            (each.action, trajectory(each.trajectory.times, each.trajectory.hand, each.trajectory.objects))
            for each in demonstrations(1)[::4]
        ]
        gesta.add_demonstrations("table-top", sent)
        gesta.result(gesta.train("table-top")["id"])
        chromium = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=[*FLAGS])
        yield url, chromium.new_page()
        chromium.close()


def loads(url: str, opened: Page) -> dict[str, list[float]]:
    """Return how long each view takes to be interactive [ms]."""
    found: dict[str, list[float]] = {view: [] for view in VIEWS}
    for view, times in found.items():
        for _ in range(N_LOADS):
            opened.goto("about:blank")
            opened.goto(f"{url}/#/{view}")
            opened.wait_for_selector(f"html[data-ready={view}]")
            times.append(opened.evaluate(INTERACTIVE))
    return found


def drawings(url: str, opened: Page) -> list[float]:
    """Return how often the scene is drawn in each second, while many stream."""
    rates = []
    with streaming(url, "cell", N_STREAMS, STREAM_S):
        opened.goto(f"{url}/#/live")
        until(opened, STREAMED)
        for _ in range(N_SECONDS):
            before, begin = opened.evaluate(DRAWN), time.monotonic()
            time.sleep(1.0)
            rates.append((opened.evaluate(DRAWN) - before) / (time.monotonic() - begin))
    return rates


def main() -> None:
    """Measure, print and write the page."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--output", type=Path, help="page to write")
    output = options.parse_args().output
    with browsing() as (url, opened):
        times, rates = loads(url, opened), drawings(url, opened)
    slowest = max(max(of) for of in times.values())
    often = statistics.median(rates)
    goals = page.goals(
        [
            page.Goal(
                f"interactive in {SOONEST_MS:g} ms at most", f"{slowest:.0f} ms", slowest <= SOONEST_MS
            ),
            page.Goal(
                f"{OFTEN:g} drawings a second while {N_STREAMS} stream",
                f"{often:.0f} in the median second",
                often >= OFTEN,
            ),
        ]
    )
    rows = [[view, f"{statistics.median(of):.0f}", f"{max(of):.0f}"] for view, of in times.items()]
    table = page.table(["interactive [ms]", "median", "most"], rows)
    seconds = f"Drawings in each second: {', '.join(f'{rate:.0f}' for rate in sorted(rates))}.\n"
    page.publish("\n".join([page.heading("The page", INTRODUCTION), goals, table, seconds]), output)


if __name__ == "__main__":
    main()
