"""Live: what is recognised while it is streamed."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from tests.browser.streaming import streaming
from tests.browser.waiting import until

if TYPE_CHECKING:
    from tests.browser.conftest import OpenPage

pytestmark = pytest.mark.browser

DRAWN = "Number(document.querySelector('canvas.stage-canvas').dataset.drawn)"
ROWS = "trs => trs.map(tr => [...tr.cells].slice(0, 3).map(cell => cell.textContent))"

CUT = """async () => {
  const asked = [], heard = [], states = [];
  const event = (id) => `event: segment\\nid: ${id}\\ndata: {"n": ${id}}\\n\\n`;
  const answers = [event(0) + 'event: seg', event(1) + 'event: ended\\nid: 2\\ndata: {}\\n\\n'];
  const real = window.fetch;
  window.fetch = async (path, {headers} = {}) => {
    if (!path.includes('sessions/x/')) return real(path, {headers});
    asked.push(headers['Last-Event-ID']);
    return new Response(new Blob([answers.shift()]).stream());
  };
  const {listen} = await import('/static/js/listening.js');
  const note = (each) => heard.push(each.id), state = (each) => states.push(each);
  await listen('x', note, state, new AbortController().signal);
  window.fetch = real;
  return {asked, heard, states};
}"""


def test_a_stream_is_seen_as_it_is_recognised(open_page: OpenPage, url: str) -> None:
    with streaming(url, "robot cell", 1, 7.0) as told:
        page = open_page("live")
        page.get_by_role("button", name="robot cell 1").wait_for()
        until(page, "document.querySelectorAll('.past tbody tr').length >= 2")
        best = page.locator(".bar-row.best .bar-value").first
        assert best.inner_text().endswith("%")
        assert page.locator(".tag", has_text="hand").is_visible()
        page.get_by_text("The session has ended.").wait_for()
    [messages] = told
    found = [message for message in messages if message["type"] == "segment"]
    rows = page.locator(".past tbody tr").evaluate_all(ROWS)
    expected = [[m["action"] or "unknown", f"{m['t_start']:.2f} s", f"{m['t_end']:.2f} s"] for m in found]
    assert rows[::-1] == expected
    page.get_by_role("link", name="Open its recording").click()
    page.wait_for_selector("html[data-ready=recordings]")
    until(page, f"document.querySelectorAll('.block').length === {len(found)}")


def test_it_goes_on_drawing_while_ten_stream(open_page: OpenPage, url: str) -> None:
    with streaming(url, "cell", 10, 5.0):
        page = open_page("live")
        until(page, "document.querySelector('main').dataset.frames > 10")
        before = page.evaluate(DRAWN)
        until(page, f"{DRAWN} > {before} + 10")


def test_a_listener_that_is_cut_off_comes_back_where_it_was(open_page: OpenPage) -> None:
    page = open_page("models")
    found = page.evaluate(CUT)
    assert found["asked"] == ["-1", "0"]
    assert found["heard"] == ["0", "1", "2"]
    assert found["states"][-1] == "ended"


def test_nobody_streams_and_the_page_says_what_to_do(open_page: OpenPage) -> None:
    page = open_page("live")
    page.get_by_text("Nobody is streaming").wait_for()
    assert "gesta demo" in json.dumps(page.locator("pre").all_inner_texts())
