"""The page as a whole: how it is served, how soon it is there, where it fits, what it does without WebGL."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import httpx
import pytest

from app import dashboard

if TYPE_CHECKING:
    from playwright.sync_api import Browser

    from tests.browser.conftest import OpenPage

pytestmark = pytest.mark.browser

VIEWS = ("live", "recordings", "models", "generate")
PHONE = {"width": 360, "height": 740}
INTERACTIVE = "performance.getEntriesByName('gesta:interactive')[0].startTime"
WIDER = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
GROUND = "getComputedStyle(document.body).backgroundColor"
LONGEST_FILE = 400


def test_it_is_served_beside_the_api(url: str) -> None:
    page = httpx.get(f"{url}/")
    assert page.headers["content-type"] == "text/html; charset=utf-8"
    assert "script-src" not in page.headers["content-security-policy"]
    assert page.headers["content-security-policy"].startswith("default-src 'self'; ")
    own, library = (httpx.get(f"{url}/static/{name}") for name in ("js/page.js", "vendor/three-0.187.0.js"))
    for file in (own, library):
        assert file.headers["content-type"].startswith("text/javascript")
        again = httpx.get(str(file.url), headers={"If-None-Match": file.headers["etag"]})
        assert again.status_code == 304
    assert own.headers["cache-control"] == "no-cache"
    assert "immutable" in library.headers["cache-control"]
    assert set(httpx.get(f"{url}/v1/openapi.json").json()["paths"]).isdisjoint({"/", "/static"})
    assert httpx.get(f"{url}/nothing").json()["code"] == "not_found"
    assert httpx.get(f"{url}/static/../__init__.py").status_code == 404


@pytest.mark.parametrize("view", VIEWS)
def test_it_says_when_it_is_interactive(open_page: OpenPage, view: str) -> None:
    assert open_page(view).evaluate(INTERACTIVE) > 0.0


@pytest.mark.parametrize("view", VIEWS)
def test_it_fits_a_phone(open_page: OpenPage, view: str, tmp_path: Path) -> None:
    page = open_page(view, viewport=PHONE, has_touch=True)
    page.wait_for_load_state("load")
    page.screenshot(path=tmp_path / f"{view}.png", full_page=True)
    assert page.evaluate(WIDER) <= 0


@pytest.mark.parametrize("view", VIEWS)
def test_it_is_light_or_dark(open_page: OpenPage, view: str, tmp_path: Path) -> None:
    grounds = []
    for scheme in ("light", "dark"):
        page = open_page(view, color_scheme=scheme)
        page.screenshot(path=tmp_path / f"{view}-{scheme}.png")
        grounds.append(page.evaluate(GROUND))
    assert grounds[0] != grounds[1]
    page.keyboard.press("t")
    assert page.evaluate(GROUND) == grounds[0]
    page.reload()
    assert page.evaluate(GROUND) == grounds[0], "the choice is kept"


def test_keys_lead_everywhere(open_page: OpenPage) -> None:
    page = open_page("live")
    page.keyboard.press("?")
    assert page.get_by_role("dialog").get_by_role("heading", name="What this page does").is_visible()
    page.keyboard.press("Escape")
    page.keyboard.press("3")
    page.wait_for_selector("html[data-ready=models]")
    page.keyboard.press("Tab")
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"


def test_without_webgl_it_says_so_and_goes_on(launch: Callable[..., Browser], url: str, table: Path) -> None:
    browser = launch("--disable-3d-apis")
    page = browser.new_page()
    page.goto(f"{url}/#/recordings")
    page.get_by_text("No 3-D here.").wait_for()
    page.set_input_files("input[type=file]", table)
    page.get_by_role("button", name="Find the segments").click()
    page.get_by_text("what version 1 says").wait_for()
    browser.close()


def test_its_files_are_short() -> None:
    own = [
        file
        for file in dashboard.STATIC.rglob("*")
        if file.suffix in (".js", ".css") and "vendor" not in file.parts
    ]
    assert own
    assert [file.name for file in own if len(file.read_text().splitlines()) > LONGEST_FILE] == []
