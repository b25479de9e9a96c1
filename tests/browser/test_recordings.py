"""Recordings: opened, segmented, corrected, learned from."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from app.client import GestaClient
from app.motion.trajectory import Recording
from tests.browser.waiting import until

if TYPE_CHECKING:
    from playwright.sync_api import Page

    from tests.browser.conftest import OpenPage

pytestmark = pytest.mark.browser

TRC = (
    "PathFileType\t4\t(X/Y/Z)\treach.trc",
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
    "100\t100\t101\t2\tmm\t100\t1\t101",
    "Frame#\tTime\thand\t\t\tbox\t\t",
    "\t\tX1\tY1\tZ1\tX2\tY2\tZ2",
)
BOUNDS = "blocks => blocks.map(each => each.getAttribute('aria-label'))"


def test_a_table_becomes_demonstrations(
    open_page: OpenPage, table: Path, seen: Recording, gesta: GestaClient
) -> None:
    page = open_page("recordings")
    page.set_input_files("input[type=file]", table)
    page.get_by_label("Its axes").select_option("y")
    page.get_by_text("0.07 m (the last is the height)").wait_for()
    assert page.get_by_label("Its unit").input_value() == "mm"
    assert page.get_by_label("Use cup as").input_value() == "object"
    page.get_by_role("button", name="Find the segments").click()
    page.get_by_text("what version 1 says").wait_for()
    page.get_by_role("button", name="Take over as truth").click()
    found = truth(page)
    assert [label.split(",")[0] for label in found] == [segment.action for segment in seen.segments]
    drag(page, "end of grasp", -40)
    assert truth(page)[0] != found[0]
    assert truth(page)[1:] == found[1:]
    page.get_by_role("button", name="Compare with the truth").click()
    page.get_by_text("Version 1 against the truth").wait_for()
    assert page.locator(".measures dd").first.inner_text() == "5 / 5"
    page.keyboard.press("4")
    page.wait_for_selector("html[data-ready=generate]")
    page.go_back()
    until(page, "document.querySelectorAll('.lane .block').length === 10")
    assert truth(page)[0] != found[0], "what was open is open again"
    before = sum(gesta.model("table-top")["actions"].values())
    page.get_by_role("button", name="Save as demonstrations").click()
    page.get_by_text("5 demonstrations saved.").wait_for()
    assert sum(gesta.model("table-top")["actions"].values()) == before + 5
    with page.expect_download() as started:
        page.get_by_role("button", name="Download").click()
    kept = json.loads(started.value.path().read_text())
    again = gesta.request("POST", "/models/table-top/demonstrations", kept)
    assert len(again["duplicates"]) == 5


def test_labels_are_made_with_the_keyboard_alone(open_page: OpenPage, table: Path) -> None:
    page = open_page("recordings")
    page.set_input_files("input[type=file]", table)
    page.get_by_label("Its axes").focus()
    page.keyboard.press("ArrowDown")
    page.locator("main").focus()
    press(page, "Home", *["Shift+ArrowRight"] * 3, "n")
    assert (
        page.evaluate("document.activeElement.getAttribute('aria-label')") == "Action of the chosen segment"
    )
    page.keyboard.type("wave")
    press(page, "Enter", "Tab")
    assert truth(page) == ["wave, 0.30 to 0.80 s"]
    page.locator("main").focus()
    press(page, *["Shift+ArrowRight"] * 2, "[", *["Shift+ArrowRight"] * 8, "]")
    assert truth(page) == ["wave, 0.50 to 1.30 s"]
    page.get_by_role("slider", name="start of wave").focus()
    press(page, "ArrowLeft", "ArrowLeft", "Shift+ArrowLeft")
    assert truth(page) == ["wave, 0.38 to 1.30 s"]
    page.locator("main").focus()
    press(page, " ")
    page.get_by_role("button", name="Pause").wait_for()
    press(page, " ", "Delete")
    assert truth(page) == []
    press(page, "z")
    assert truth(page) == ["wave, 0.38 to 1.30 s"]


def test_a_file_that_nobody_can_read_is_refused_in_words(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page("recordings", expected="Failed to load resource")
    bad = tmp_path / "bad.csv"
    bad.write_text("t,hand.x,hand.y,hand.z\n0,0,0,0\n0,1,1,x\n")
    page.set_input_files("input[type=file]", bad)
    page.get_by_text("row 3: the time must increase").wait_for()
    other = tmp_path / "walk.c3d"
    other.write_bytes(b"no such thing")
    page.set_input_files("input[type=file]", other)
    until(page, "!document.querySelector('.open').textContent.includes('row 3')")
    assert page.locator(".open .problem").inner_text().strip()


def test_a_file_of_the_field_is_read_by_the_server(open_page: OpenPage, tmp_path: Path) -> None:
    """It does not say which axis is up: the page asks."""
    page = open_page("recordings", expected="Failed to load resource")
    file = tmp_path / "reach.trc"
    rows = [f"{n + 1}\t{n / 100:.2f}\t{n}\t{200 - n}\t{2 * n}\t{300}\t0\t{100 + n}" for n in range(101)]
    file.write_text("\n".join([*TRC, *rows]) + "\n")
    page.set_input_files("input[type=file]", file)
    page.locator(".open .problem").wait_for()
    page.locator(".open .panel-part select").nth(1).select_option("y")
    page.get_by_role("button", name="Read it so").click()
    page.get_by_text("So the hand moves within 0.10").wait_for()
    page.get_by_text("0.10 m (the last is the height)").wait_for()
    assert page.get_by_label("Use hand as").input_value() == "/hand"
    assert page.get_by_label("Its unit").is_disabled()


def truth(page: Page) -> list[str]:
    """Return what the lane that can be edited shows."""
    found: list[str] = page.locator(".lane").nth(1).locator(".block").evaluate_all(BOUNDS)
    return found


def press(page: Page, *keys: str) -> None:
    """Press one key after the other."""
    for key in keys:
        page.keyboard.press(key)


def drag(page: Page, boundary: str, pixels: float) -> None:
    """Take hold of a boundary and pull it sideways."""
    held = page.get_by_role("slider", name=boundary).first
    held.scroll_into_view_if_needed()
    box = held.bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + pixels, y, steps=4)
    page.mouse.up()
