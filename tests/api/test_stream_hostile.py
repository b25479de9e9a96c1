"""What is no stream is refused by name, with the frame; the server lives and the session can be resumed."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from typing import Any

import httpx
import numpy as np
import pytest

from app.motion.model import Model
from app.motion.simulation import recording
from tests.serving import Server
from tests.talking import METRES, Message, Talk, binary, columns, expected, talking

MOTION = recording(5, 5).trajectory
GOOD = 20
CUP = [0.4, 0.2, 0.0]
NAN = float("nan")
pytestmark = pytest.mark.usefixtures("table_top")


def frames(**changes: Any) -> str:
    """Return three frames that follow the good ones, changed, as JSON text; a change to None removes."""
    fields = {"type": "frames", **columns(MOTION, GOOD, GOOD + 3), **changes}
    return json.dumps({name: value for name, value in fields.items() if value is not None})


def with_hand(place: int, position: Any) -> str:
    """Return the frames with one position of the hand replaced."""
    hand: list[Any] = columns(MOTION, GOOD, GOOD + 3)["hand"]
    hand[place] = position
    return frames(hand=hand)


BAD_FRAMES: dict[str, tuple[str | bytes, str, int, int | None]] = {
    "no json": ("{", "malformed", 4400, None),
    "no object": ("[1]", "malformed", 4400, None),
    "no type": ("{}", "malformed", 4400, None),
    "a type that is no text": ('{"type": 3}', "malformed", 4400, None),
    "deep nesting": ("[" * 200_000, "malformed", 4400, None),
    "deep nesting in a field": (
        '{"type":"frames","hand":' + "[" * 900 + "]" * 900 + "}",
        "malformed",
        4400,
        None,
    ),
    "an endless whole number": (
        '{"type":"frames","first_seq":' + "9" * 10_000 + "}",
        "malformed",
        4400,
        None,
    ),
    "unknown type": ('{"type": "frame"}', "unknown_type", 4400, None),
    "unknown field": (frames(hands=[]), "malformed", 4400, None),
    "a second start": (
        json.dumps({"type": "start", "model": "table-top", "geometry": METRES}),
        "already_started",
        4400,
        None,
    ),
    "flush without id": ('{"type": "flush"}', "malformed", 4400, None),
    "ping with an unknown field": ('{"type": "ping", "id": 1, "idd": 1}', "malformed", 4400, None),
    "first_seq as text": (frames(first_seq="20"), "malformed", 4400, None),
    "first_seq as a boolean": (frames(first_seq=True), "malformed", 4400, None),
    "first_seq negative": (frames(first_seq=-1), "malformed", 4400, None),
    "first_seq beyond the next": (frames(first_seq=21), "frames_missing", 4400, 20),
    "last_seq not received": ('{"type": "end", "last_seq": 20}', "frames_missing", 4400, 20),
    "last_seq before what was received": ('{"type": "end", "last_seq": 18}', "malformed", 4400, None),
    "no t": (frames(t=None), "malformed", 4400, None),
    "no hand": (frames(hand=None), "malformed", 4400, None),
    "no objects": (frames(objects=None), "wrong_objects", 4400, None),
    "another object": (frames(objects={"cup": [CUP] * 3}), "wrong_objects", 4400, None),
    "objects as a list": (frames(objects=[[CUP] * 3]), "wrong_objects", 4400, None),
    "no frame": (frames(t=[], hand=[], objects={"object": []}), "malformed", 4400, None),
    "fewer times than positions": (frames(t=[0.2, 0.21]), "malformed", 4400, None),
    "text as a time": (frames(t=[0.2, "0.21", 0.22]), "malformed", 4400, 21),
    "null as a time": (frames(t=[0.2, 0.21, None]), "malformed", 4400, 22),
    "text as a coordinate": (with_hand(1, [0.1, "0.2", 0.3]), "malformed", 4400, 21),
    "a boolean as a coordinate": (with_hand(2, [0.1, True, 0.3]), "malformed", 4400, 22),
    "two coordinates": (with_hand(0, [0.1, 0.2]), "malformed", 4400, 20),
    "a position as text": (with_hand(1, "abc"), "malformed", 4400, 21),
    "half a dropout": (with_hand(1, [0.1, None, 0.3]), "malformed", 4400, 21),
    "a number beyond floats": (with_hand(1, [0.1, 10**400, 0.3]), "malformed", 4400, 21),
    "NaN": (with_hand(1, [0.1, NAN, 0.3]), "non_finite", 4422, 21),
    "infinity": (with_hand(2, [0.1, float("inf"), 0.3]), "non_finite", 4422, 22),
    "a number that overflows": (
        with_hand(1, [0.1, 7.5e300, 0.3]).replace("7.5e+300", "7.5e999"),
        "non_finite",
        4422,
        21,
    ),
    "NaN as a time": (frames(t=[0.2, NAN, 0.22]), "non_finite", 4422, 21),
    "equal times": (frames(t=[0.2, 0.21, 0.21]), "times_not_increasing", 4422, 22),
    "a time before the last message": (frames(t=[0.1, 0.21, 0.22]), "times_not_increasing", 4422, 20),
    "nanoseconds as time": (frames(t=[0.2, 1.7e18, 1.8e18]), "wrong_unit", 4422, 21),
    "millimetres as metres": (with_hand(1, [100.0, 200.0, 300.0]), "wrong_unit", 4422, 21),
    "an object in millimetres": (
        frames(objects={"object": [CUP, CUP, [400, 200, 0]]}),
        "wrong_unit",
        4422,
        22,
    ),
    "too many frames": (
        json.dumps({"type": "frames", **columns(recording(5, 100).trajectory, 0, 4097)}),
        "too_big",
        1009,
        None,
    ),
    "a message too big": ("[" + " " * (1 << 20) + "]", "too_big", 1009, None),
    "a big message of long characters": ('"' + "\u20ac" * (1 << 19) + '"', "too_big", 1009, None),
    "binary where none was declared": (bytes(100), "binary_not_declared", 4400, None),
}


class TestFrames:
    @pytest.mark.parametrize("case", BAD_FRAMES)
    def test_a_bad_message_is_refused_whole(self, server: Server, case: str) -> None:
        bad, code, close_code, at_seq = BAD_FRAMES[case]
        with talking(server) as talk:
            started = self.begun(talk)
            talk.socket.send(bad)
            closed_with, found, error = talk.refused()
        assert (closed_with, found, error.get("at_seq")) == (close_code, code, at_seq)
        assert error["fatal"]
        assert not error["retryable"]
        assert len(error["detail"]) < 300
        assert self.next_seq(server, started) == GOOD

    @pytest.mark.parametrize(
        ("spoil", "code", "at_seq"),
        [
            (lambda message: message[:-1], "binary_cut_short", None),
            (lambda message: message[:9], "binary_cut_short", None),
            (lambda message: b"", "binary_cut_short", None),
            (lambda message: message + b"\0", "binary_too_long", None),
            (lambda message: message[:12] + b"\6\0\0\0" + message[16:], "wrong_channels", None),
            (lambda message: message[:8] + b"\xff\xff\xff\xff" + message[12:], "binary_cut_short", None),
            (lambda message: message[:8] + bytes(4) + message[12:16], "malformed", None),
            (lambda message: b"\xff" * 8 + message[8:], "malformed", None),
            (lambda message: b"\x15" + message[1:], "frames_missing", 20),
        ],
    )
    def test_a_binary_message_that_is_not_whole(
        self, server: Server, spoil: Callable[[bytes], bytes], code: str, at_seq: int | None
    ) -> None:
        message = binary(GOOD, self.rows(GOOD, GOOD + 3))
        with talking(server) as talk:
            started = self.begun(talk, encoding="f64")
            talk.socket.send(spoil(message))
            assert talk.refused()[:2] == (4400, code)
            assert talk.heard[-1].get("at_seq") == at_seq
        assert self.next_seq(server, started, encoding="f64") == GOOD

    @pytest.mark.parametrize(
        ("row", "column", "value", "code"),
        [
            (1, 0, np.nan, "non_finite"),
            (2, 0, -1.0, "times_not_increasing"),
            (1, 2, np.nan, "non_finite"),
            (1, 4, np.inf, "non_finite"),
            (2, 6, 1e9, "wrong_unit"),
        ],
    )
    def test_binary_frames_that_are_no_motion(
        self, server: Server, row: int, column: int, value: float, code: str
    ) -> None:
        rows = self.rows(GOOD, GOOD + 3)
        rows[row, column] = value
        with talking(server) as talk:
            started = self.begun(talk, encoding="f64")
            talk.socket.send(binary(GOOD, rows))
            assert talk.refused()[:2] == (4422, code)
            assert talk.heard[-1]["at_seq"] == GOOD + row
        assert self.next_seq(server, started, encoding="f64") == GOOD

    def test_text_that_is_no_utf8(self, server: Server) -> None:
        with talking(server) as talk:
            started = self.begun(talk)
            with talk.socket.send_context():
                talk.socket.protocol.send_text(b'{"type": "ping", "id": "\xff"}')
            assert talk.refused()[:2] == (4400, "malformed")
            assert "UTF-8" in talk.heard[-1]["detail"]
        assert self.next_seq(server, started) == GOOD

    def test_a_message_beyond_all_bounds_closes_at_once(self, server: Server) -> None:
        with talking(server) as talk:
            started = self.begun(talk)
            talk.say("flush", id=0)
            talk.hear("flushed")
            talk.socket.socket.sendall(b"\x82\xff" + struct.pack("!Q", 5 << 20) + bytes(4))
            talk.rest()
            assert talk.closed_with == 1009
        assert self.next_seq(server, started) == GOOD

    def test_after_a_refusal_the_session_goes_on_as_if_nothing_had_been(
        self, server: Server, trained: Model
    ) -> None:
        with talking(server) as talk:
            started = self.begun(talk)
            talk.socket.send(with_hand(1, [0.1, NAN, 0.3]))
            talk.refused()
        with talking(server) as talk:
            talk.start(resume=resuming(started))
            talk.frames(MOTION, GOOD)
            talk.say("end")
            talk.rest()
            events = [message for message in talk.heard if "event" in message]
            assert events[:-1] == expected(trained, MOTION)

    def begun(self, talk: Talk, **start: Any) -> Message:
        started = talk.start(**start)
        talk.frames(MOTION, 0, GOOD)
        return started

    def rows(self, start: int, stop: int) -> np.ndarray[Any, Any]:
        part = MOTION.part(start, stop)
        return np.column_stack([part.times, part.hand, *part.objects.values()])

    def next_seq(self, server: Server, started: Message, **start: Any) -> int:
        """Resume the session and return the frame that it wants next."""
        assert httpx.get(f"{server.url}/livez").status_code == 200
        with talking(server) as talk:
            wanted: int = talk.start(resume=resuming(started), **start)["next_seq"]
            return wanted


def resuming(started: Message, last_event: int = -1) -> Message:
    """Return the fields that resume a session."""
    return {
        "session_id": started["session_id"],
        "token": started["resume_token"],
        "last_event": last_event,
    }


@pytest.fixture(scope="module")
def pairs(server: Server, paired: Model) -> str:
    """The name of a model with two roles that has a version."""
    return server.teach(paired, "pairs")


class TestStart:
    @pytest.mark.parametrize(
        ("first", "code"),
        [
            (frames(), "start_expected"),
            ('{"type": "end"}', "start_expected"),
            ('{"type": "ping", "id": 1}', "start_expected"),
            (bytes(100), "start_expected"),
            ("nonsense", "malformed"),
        ],
    )
    def test_comes_first(self, server: Server, first: str | bytes, code: str) -> None:
        with talking(server) as talk:
            talk.socket.send(first)
            assert talk.refused()[:2] == (4400, code)

    @pytest.mark.parametrize(
        ("fields", "close_code", "code"),
        [
            ({"model": "unknown"}, 4404, "model_not_found"),
            ({"version": 99}, 4404, "version_not_found"),
            ({"version": "no-alias"}, 4404, "version_not_found"),
            ({"version": 1.5}, 4400, "malformed"),
            ({"model": None}, 4400, "malformed"),
            ({"geometry": None}, 4400, "malformed"),
            ({"geometry": {"length_unit": "inch", "up_axis": "z"}}, 4400, "malformed"),
            ({"geometry": {"length_unit": "m", "up_axis": "x"}}, 4400, "malformed"),
            ({"geometry": {"length_unit": "m"}}, 4400, "malformed"),
            ({"goals": [[0, 0, 0]]}, 4400, "malformed"),
            ({"goals": {"left": [0, 0]}}, 4400, "malformed"),
            ({"goals": {"left": [0, 0, "0"]}}, 4400, "malformed"),
            ({"goals": {"left": [0, 0, NAN]}}, 4400, "malformed"),
            ({"goals": {"left": [0, 0, 101]}}, 4422, "wrong_unit"),
            ({"goals": {"object": [0, 0, 0]}}, 4422, "goals_invalid"),
            ({"goals": {"": [0, 0, 0]}}, 4400, "malformed"),
            ({"goals": {"x" * 65: [0, 0, 0]}}, 4400, "malformed"),
            ({"goals": {f"goal {index}": [0, 0, 0] for index in range(33)}}, 4400, "malformed"),
            ({"key": "secret"}, 4400, "malformed"),
            ({"rate_hz": 0}, 4400, "malformed"),
            ({"rate_hz": -100}, 4400, "malformed"),
            ({"rate_hz": NAN}, 4400, "malformed"),
            ({"rate_hz": "100"}, 4400, "malformed"),
            ({"rate_hz": True}, 4400, "malformed"),
            ({"encoding": "f16"}, 4400, "malformed"),
            ({"encoding": "f32"}, 4422, "f32_needs_rate"),
            ({"objects": []}, 4422, "role_missing"),
            ({"model": "pairs", "objects": ["cup"]}, 4422, "role_missing"),
            (
                {"model": "pairs", "objects": [f"cup {index}" for index in range(9)]},
                4422,
                "objects_ambiguous",
            ),
            ({"objects": ["object", "object"]}, 4422, "objects_invalid"),
            ({"objects": ["object", "hand"]}, 4422, "objects_invalid"),
            ({"objects": [f"object{index}" for index in range(33)]}, 4400, "malformed"),
            ({"scene": {"table_height_m": NAN}}, 4400, "malformed"),
            ({"scene": {"table_height_m": 700.0}}, 4400, "malformed"),
            ({"options": {"hypotheses_hz": 0}}, 4400, "malformed"),
            ({"options": {"hypothesis": True}}, 4400, "malformed"),
            ({"name": "x" * 300}, 4400, "malformed"),
            ({"\u20ac" * 100_000: 1}, 4400, "malformed"),
            ({"resume": {"session_id": "none", "token": "none", "last_event": -1}}, 4410, "session_gone"),
            ({"resume": {"session_id": "none", "token": "none"}}, 4400, "malformed"),
        ],
    )
    def test_a_start_that_cannot_be_served(
        self, server: Server, pairs: str, fields: Message, close_code: int, code: str
    ) -> None:
        assert pairs == "pairs"
        sessions = len(httpx.get(f"{server.url}/v1/sessions?page_size=500").json()["sessions"])
        with talking(server) as talk:
            given = {"model": "table-top", "geometry": METRES, **fields}
            talk.say("start", **{name: value for name, value in given.items() if value is not None})
            assert talk.refused()[:2] == (close_code, code)
            assert len(talk.heard[-1]["detail"]) < 300
        assert len(httpx.get(f"{server.url}/v1/sessions?page_size=500").json()["sessions"]) == sessions

    @pytest.mark.parametrize(
        ("changes", "code"),
        [
            ({"geometry": {"length_unit": "mm", "up_axis": "z"}}, "resume_mismatch"),
            ({"rate_hz": 100}, "resume_mismatch"),
            ({"objects": ["object", "cup"]}, "resume_mismatch"),
            ({"scene": {"table_height_m": 0.5}}, "resume_mismatch"),
            ({"goals": {"left": [0, 0, 0]}}, "resume_mismatch"),
            ({"last_event": 0}, "resume_mismatch"),
            ({"last_event": 10**30}, "resume_mismatch"),
        ],
    )
    def test_a_resume_that_is_not_of_the_session(self, server: Server, changes: Message, code: str) -> None:
        with talking(server) as talk:
            started = talk.start()
        resume = resuming(started, changes.pop("last_event", -1))
        with talking(server) as talk:
            talk.say("start", **{"model": "table-top", "geometry": METRES, "resume": resume, **changes})
            assert talk.refused()[1] == code

    def test_the_token_of_another_session_is_refused(self, server: Server) -> None:
        with talking(server) as talk:
            started = talk.start()
        with talking(server) as talk:
            other = talk.start()
            token = other["resume_token"]
            with talking(server) as thief:
                resume = {"session_id": started["session_id"], "token": token, "last_event": -1}
                thief.say("start", model="table-top", geometry=METRES, resume=resume)
                assert thief.refused()[:2] == (4403, "token_refused")
