"""Generate: a movement is asked for, seen and taken away."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.browser.waiting import until

if TYPE_CHECKING:
    from playwright.sync_api import Page

    from tests.browser.conftest import OpenPage

pytestmark = pytest.mark.browser

MCAP = b"\x89MCAP0\r\n"


def test_a_movement_is_generated_and_downloaded(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page("generate")
    page.get_by_label("Action", exact=True).select_option("displace")
    generated(page)
    before = place(page, "Goal")
    goal = page.locator(".tag", has_text="goal").bounding_box()
    assert goal
    handle = goal["x"] - 10, goal["y"] + 28
    page.mouse.move(*handle)
    page.mouse.down()
    page.mouse.move(handle[0] - 60, handle[1] - 30, steps=5)
    page.mouse.up()
    generated(page)
    dragged = place(page, "Goal")
    assert dragged[:2] != before[:2]
    assert dragged[2] == before[2]
    page.get_by_role("group", name="Goal").get_by_label("x").fill("0.2")
    page.get_by_role("spinbutton", name="speed [m/s]").fill("0.25")
    generated(page)
    page.get_by_text("It takes longer, to keep the limits.").wait_for()
    files = {name: download(page, name, tmp_path) for name in ("CSV", "JSON", "MCAP")}
    told: dict[str, Any] = json.loads(files["JSON"])
    assert told["position"][-1] == pytest.approx(place(page, "Goal"))
    assert max(sum(each**2 for each in row) ** 0.5 for row in told["velocity"]) <= 0.25 + 1e-9
    rows = list(csv.reader(files["CSV"].decode().splitlines()))
    assert len(rows) == len(told["t"]) + 1
    assert files["MCAP"].startswith(MCAP)


def test_a_click_places_the_start_and_what_is_far_is_said(open_page: OpenPage) -> None:
    page = open_page("generate")
    generated(page)
    before = place(page, "Start")
    page.keyboard.press("s")
    scene = page.locator("canvas.stage-canvas")
    scene.click(position={"x": 240, "y": 420})
    generated(page)
    assert place(page, "Start") != before
    page.get_by_role("group", name="Goal").get_by_label("z").fill("1.4")
    page.locator(".caution[data-code]").first.wait_for()
    page.get_by_role("group", name="Goal").get_by_label("z").fill("-0.3")
    page.get_by_text("It goes below the table").wait_for()


def generated(page: Page) -> None:
    """Wait until what is asked for has been answered."""
    page.wait_for_timeout(250)
    until(page, "document.querySelector('main').dataset.generated >= 1")
    page.wait_for_load_state("networkidle")


def place(page: Page, end: str) -> list[float]:
    """Return the coordinates in the fields."""
    return [float(page.get_by_role("group", name=end).get_by_label(axis).input_value()) for axis in "xyz"]


def download(page: Page, form: str, folder: Path) -> bytes:
    """Return a file that the page lets one keep."""
    with page.expect_download() as started:
        page.get_by_role("button", name=f"Download as {form}").click()
    file = folder / started.value.suggested_filename
    started.value.save_as(file)
    return file.read_bytes()
