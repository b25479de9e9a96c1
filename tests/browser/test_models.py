"""Models: versions compared, promoted, trained."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from app.client import GestaClient

if TYPE_CHECKING:
    from tests.browser.conftest import OpenPage

pytestmark = pytest.mark.browser


def test_versions_are_compared_and_one_is_promoted(open_page: OpenPage, gesta: GestaClient) -> None:
    page = open_page("models")
    page.get_by_text("From version 1 to 2:").wait_for()
    for number in (1, 2):
        card = page.get_by_label(f"Version {number}", exact=True)
        told = gesta.version("table-top", number)["evaluation"]
        assert told is not None
        assert card.locator(".big").inner_text() == f"{100 * told['accuracy']:.1f} %"
        assert card.locator(".confusion tbody tr").count() == len(told["confusion"])
    page.get_by_label("version 1 as B").check()
    page.get_by_text("From version 1 to 2:").wait_for(state="detached")
    page.get_by_role("button", name="Promote version 2 to production").click()
    page.get_by_text("Version 2 is now “production”").wait_for()
    assert gesta.version("table-top", "production")["version"] == 2
    page.get_by_text("before: v1").wait_for()
    gesta.promote("table-top", "production", 1)


def test_a_version_is_trained_and_watched(open_page: OpenPage, gesta: GestaClient) -> None:
    newest = gesta.version("table-top")["version"]
    page = open_page("models")
    page.get_by_label("Go on from").select_option(str(newest))
    page.get_by_role("button", name="Train a version").click()
    page.locator(".job progress").wait_for()
    page.get_by_text(f"Version {newest + 1} is trained.").wait_for(timeout=60_000)
    page.get_by_role("cell", name=f"v{newest + 1}", exact=True).wait_for()
    assert gesta.version("table-top")["base"] == newest


def test_a_model_is_made_and_a_name_that_is_taken_is_refused(open_page: OpenPage, gesta: GestaClient) -> None:
    page = open_page("models", expected="Failed to load resource")
    for _ in range(2):
        page.get_by_role("button", name="New model…").click()
        page.get_by_label("Name").fill("shelf")
        page.get_by_label("Objects that matter").fill("cup, lid")
        page.get_by_role("button", name="Create").click()
        page.locator(".problem, .choice[data-model=shelf][aria-pressed=true]").first.wait_for()
    assert "shelf" in page.get_by_role("alert").inner_text()
    gesta.delete_model("shelf")
