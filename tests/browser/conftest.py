"""The page in Chromium, on a real server with its worker and two trained versions.

Slow, and in need of a browser: these tests run only where they are asked for (``-m browser``).
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from app.client import GestaClient, trajectory
from app.demo import serving
from app.motion.simulation import demonstrations, recording
from app.motion.trajectory import Recording

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

DESELECTED = pytest.StashKey[int]()
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Chromium draws WebGL without a graphics card."""
WAIT_MS = 15_000
ABORTED = "net::ERR_ABORTED"
"""So end streams of events when their view is left."""
LOUD = ("error", "warning")

OpenPage = Callable[..., "Page"]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let the pictures be kept."""
    parser.addoption("--pictures", help="folder for the pictures of the guides")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect the tests that need a browser unless they are asked for."""
    if "browser" in config.option.markexpr:
        return
    deselected = [item for item in items if item.get_closest_marker("browser")]
    items[:] = [item for item in items if item not in deselected]
    config.hook.pytest_deselected(items=deselected)
    config.stash[DESELECTED] = len(deselected)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Say how many tests did not run."""
    if count := config.stash.get(DESELECTED, 0):
        terminalreporter.write_line(f"{count} tests that drive the page did not run: make test-browser")


@pytest.fixture(scope="session")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a server that knows `table-top`: versions 1, which is `production`, and 2."""
    with serving(tmp_path_factory.mktemp("lab")) as address, GestaClient(address) as gesta:
        gesta.create_model("table-top", ["object"], description="Simulated table-top actions.")
        taught = demonstrations(seed=1)
        for number, part in enumerate((taught[::6], taught[1::6]), start=1):
            sent = [
                (d.action, trajectory(d.trajectory.times, d.trajectory.hand, d.trajectory.objects))
                for d in part
            ]
            gesta.add_demonstrations("table-top", sent)
            assert gesta.result(gesta.train("table-top", options={"n_states": 4})["id"])["version"] == number
        gesta.promote("table-top", "production", 1)
        yield address


@pytest.fixture(scope="session")
def gesta(url: str) -> Iterator[GestaClient]:
    """A client of the server."""
    with GestaClient(url) as client:
        yield client


@pytest.fixture(scope="session")
def seen() -> Recording:
    """A labelled recording that nothing was trained on."""
    return recording(seed=7, n_actions=5)


@pytest.fixture(scope="session")
def table(seen: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording as a table in millimetres, Y up, its object called `cup`."""
    motion = seen.trajectory
    lines = ["t,hand.x,hand.y,hand.z,cup.x,cup.y,cup.z"]
    for time, *places in zip(motion.times, motion.hand, motion.objects["object"], strict=True):
        turned = [f"{1000 * value:.3f}" for x, y, z in places for value in (x, z, -y)]
        lines.append(",".join([f"{time:.2f}", *turned]))
    file = tmp_path_factory.mktemp("tables") / "morning.csv"
    file.write_text("\n".join(lines) + "\n")
    return file


@pytest.fixture(scope="session")
def launch() -> Iterator[Callable[..., Browser]]:
    """Start Chromium with further flags."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 (only where the page is driven)

    program = shutil.which("chromium")
    assert program, "Chromium is missing: make test-browser installs it"
    with sync_playwright() as playwright:
        yield lambda *flags: playwright.chromium.launch(executable_path=program, args=[*FLAGS, *flags])


@pytest.fixture(scope="session")
def browser(launch: Callable[..., Browser]) -> Iterator[Browser]:
    """Chromium."""
    started = launch()
    yield started
    started.close()


@pytest.fixture
def open_page(browser: Browser, url: str) -> Iterator[OpenPage]:
    """Open a view of the page; at the end nothing may have failed, nor been asked of anybody else."""
    contexts: list[Any] = []
    wrong: list[str] = []

    def note(is_wrong: bool, what: str) -> None:
        if is_wrong:
            wrong.append(what)

    def watch(page: Page, expected: str) -> None:
        own = (url, f"blob:{url}", "data:")
        page.on("pageerror", lambda error: note(True, f"error: {error}"))
        page.on("request", lambda asked: note(not asked.url.startswith(own), asked.url))
        page.on("requestfailed", lambda lost: note(lost.failure != ABORTED, f"{lost.url}: {lost.failure}"))
        page.on(
            "console", lambda said: note(said.type in LOUD and (expected or "\0") not in said.text, said.text)
        )

    def opened(view: str, expected: str = "", **context: Any) -> Page:
        contexts.append(browser.new_context(**{"viewport": {"width": 1360, "height": 820}, **context}))
        page: Page = contexts[-1].new_page()
        page.set_default_timeout(WAIT_MS)
        watch(page, expected)
        page.goto(f"{url}/#/{view}")
        page.wait_for_selector(f"html[data-ready={view.partition('?')[0]}]")
        return page

    yield opened
    for context in contexts:
        context.close()
    assert wrong == []
