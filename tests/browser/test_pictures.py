"""The pictures of the guides: ``make pictures`` keeps them, every other run throws them away."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.browser.streaming import streaming
from tests.browser.waiting import until

if TYPE_CHECKING:
    from tests.browser.conftest import OpenPage

pytestmark = pytest.mark.browser

SIZE = {"width": 1200, "height": 740}


@pytest.fixture
def folder(pytestconfig: pytest.Config, tmp_path: Path) -> Path:
    """Where the pictures go."""
    return Path(pytestconfig.getoption("--pictures", default=None) or tmp_path)


def test_a_stream_is_pictured(open_page: OpenPage, url: str, folder: Path) -> None:
    with streaming(url, "robot cell", 1, 9.0):
        page = open_page("live", viewport=SIZE)
        page.get_by_role("button", name="robot cell 1").wait_for()
        until(page, "document.querySelectorAll('.past tbody tr').length >= 4")
        page.screenshot(path=folder / "page-live.png")


def test_a_recording_is_pictured(open_page: OpenPage, table: Path, folder: Path) -> None:
    page = open_page("recordings", viewport=SIZE)
    page.set_input_files("input[type=file]", table)
    page.get_by_label("Its axes").select_option("y")
    page.get_by_role("button", name="Find the segments").click()
    page.get_by_text("what version 1 says").wait_for()
    page.get_by_role("button", name="Take over as truth").click()
    until(page, "document.querySelectorAll('.lane .block').length === 10")
    page.screenshot(path=folder / "page-recordings.png")


def test_a_movement_is_pictured(open_page: OpenPage, folder: Path) -> None:
    page = open_page("generate", viewport=SIZE)
    page.get_by_label("Action", exact=True).select_option("displace")
    page.get_by_text("Feasible.").wait_for()
    page.screenshot(path=folder / "page-generate.png")


def test_versions_are_pictured(open_page: OpenPage, folder: Path) -> None:
    page = open_page("models", viewport=SIZE)
    page.get_by_text("From version 1 to").wait_for()
    page.screenshot(path=folder / "page-models.png")
