"""Laws that parts of the page keep, asked of its modules where they run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from tests.browser.conftest import OpenPage

pytestmark = pytest.mark.browser

EDITED = """async () => {
  const {Labels} = await import('/static/js/labels.js');
  let state = 7;
  const random = (most) => (state = (state * 48271) % 2147483647) % most;
  const t = Float64Array.from({length: 500}, (_, at) => at / 50);
  const labels = new Labels(), wrong = [];
  labels.open(t, []);
  for (let turn = 0; turn < 3000; turn += 1) {
    const number = random(Math.max(labels.all.length, 1));
    const edits = [
      () => labels.add('a', random(1100) / 100 - 0.5),
      () => labels.all.length && labels.move(number, 'start', random(1100) / 100 - 0.5),
      () => labels.all.length && labels.move(number, 'end', random(1100) / 100 - 0.5),
      () => labels.all.length && labels.nudge(number, random(2) ? 'start' : 'end', random(41) - 20),
      () => random(8) || (labels.choose(number), labels.remove()),
      () => random(20) || labels.undo(),
    ];
    edits[random(edits.length)]();
    labels.all.forEach(({start, end}, at) => {
      const before = at ? labels.all[at - 1].end : t[0];
      const apart = before <= start && start < end && end <= t[499];
      if (!apart || !t.includes(start) || !t.includes(end)) wrong.push(turn);
    });
  }
  return {wrong, kept: labels.all.length};
}"""

READ = """async (text) => {
  const {fromCsv} = await import('/static/js/recording_file.js');
  try {
    const [t, tracks] = fromCsv(text);
    const told = [...tracks].map(([name, track]) => [name, [...track].map(String)]);
    return {t: [...t], tracks: Object.fromEntries(told)};
  } catch (error) {
    return {refused: error.message};
  }
}"""

PASSED_ON = """async ([geometry, points]) => {
  const {asTrajectory, flat, grounded} = await import('/static/js/recording.js');
  const tracks = grounded(new Map([['hand', flat(points)]]), geometry);
  return asTrajectory({t: [0, 1], tracks, hand: 'hand', objects: {}}).hand;
}"""

HEAD = "t;hand.x;hand.y;hand.z"


def test_labels_stay_in_order_apart_and_on_frames_whatever_is_done(open_page: OpenPage) -> None:
    found: dict[str, Any] = open_page("models").evaluate(EDITED)
    assert found["wrong"] == []
    assert found["kept"] > 2


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("hand.x,hand.y,hand.z\n1,2,3", "the first column must be"),
        ("t,hand.x,hand.y\n0,1,2", "hand needs the columns"),
        (f"{HEAD}\n0;0;0;0\n1;0;0;zero", "row 3: “zero” is no number"),
        (f"{HEAD}\n0;0;0;0\n0;0;0;1", "row 3: the time must increase"),
        (HEAD, "no frames"),
    ],
)
def test_what_is_wrong_with_a_table_is_named(open_page: OpenPage, text: str, reason: str) -> None:
    assert reason in open_page("models").evaluate(READ, text)["refused"]


def test_an_empty_cell_is_a_dropout_and_numbers_stay_as_they_were(open_page: OpenPage) -> None:
    page = open_page("models")
    read = page.evaluate(READ, f"{HEAD}\n0;0.1;0.2;0.3\n0.01;;;\n")
    assert read["tracks"] == {"hand": ["0.1", "0.2", "0.3", "NaN", "NaN", "NaN"]}
    sent = page.evaluate(PASSED_ON, [{"length_unit": "m", "up_axis": "z"}, [[0.1, 0.2, 0.3], None]])
    assert sent == [[0.1, 0.2, 0.3], None]
    turned = page.evaluate(PASSED_ON, [{"length_unit": "cm", "up_axis": "y"}, [[100, 200, 300], None]])
    assert turned == [[1.0, -3.0, 2.0], None]
