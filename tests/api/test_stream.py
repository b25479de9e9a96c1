"""The stream of the real server: what a client sends becomes what offline recognition finds, bit for bit."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from time import monotonic, sleep
from typing import Any

import httpx
import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from app.motion.model import Model
from app.motion.simulation import recording
from app.motion.trajectory import Trajectory
from app.registry import aliases, sessions, versions
from app.registry.artifacts import dump_model
from tests.serving import Server
from tests.talking import METRES, Message, Talk, binary, columns, expected, positions, talking

MOTION = recording(5, 5).trajectory
LAST = len(MOTION) - 1
PLACES = {"rest point": [0.0, 0.0, 0.02], "far away": [3.0, 3.0, 1.0]}
pytestmark = pytest.mark.usefixtures("table_top")


def durable(talk: Talk) -> list[Message]:
    """Return the durable events but the last, after checking that these are all, numbered without a hole."""
    found = [message for message in talk.heard if "event" in message]
    assert [message["event"] for message in found] == list(range(len(found)))
    segments = [message for message in found if message["type"] == "segment"]
    assert found[-1]["type"] == "ended"
    assert found[-1]["segments"] == len(segments)
    assert talk.closed_with == 1000
    return found[:-1]


def rows(motion: Trajectory) -> np.ndarray[Any, Any]:
    """Return a motion as the rows of a binary message with times."""
    return np.column_stack([motion.times, motion.hand, *motion.objects.values()])


def jittered(motion: Trajectory, seed: int = 3) -> Trajectory:
    """Return the motion with times that waver by up to 30 % of the period."""
    offset = np.random.default_rng(seed).uniform(-0.003, 0.003, len(motion))
    return replace(motion, times=motion.times + offset)


class TestEncodings:
    @pytest.mark.parametrize("chunk", [1, 16, 447])
    def test_json(self, server: Server, trained: Model, chunk: int) -> None:
        with talking(server) as talk:
            talk.start()
            talk.frames(MOTION, chunk=chunk)
            talk.say("end", last_seq=LAST)
            talk.rest()
            assert durable(talk) == expected(trained, MOTION)
            assert talk.heard[-1]["frames"] == len(MOTION)

    def test_f64_gives_the_same_numbers(self, server: Server, trained: Model) -> None:
        motion = jittered(MOTION)
        with talking(server) as talk:
            started = talk.start(encoding="f64")
            assert started["channels"] == [
                "t",
                *(f"{name}.{axis}" for name in ("hand", "object") for axis in "xyz"),
            ]
            for first in range(0, len(motion), 100):
                talk.socket.send(binary(first, rows(motion)[first : first + 100]))
            talk.say("end")
            talk.rest()
            assert durable(talk) == expected(trained, motion)

    def test_f32_at_a_rate(self, server: Server, trained: Model) -> None:
        with talking(server) as talk:
            started = talk.start(encoding="f32", rate_hz=100)
            assert "t" not in started["channels"]
            talk.socket.send(binary(0, rows(MOTION)[:, 1:], "<f4"))
            talk.say("end")
            talk.rest()
            tracks = (MOTION.hand, MOTION.objects["object"])
            hand, thing = (track.astype(np.float32).astype(float) for track in tracks)
            rounded = Trajectory(np.arange(len(MOTION)) / 100, hand, {"object": thing})
            assert durable(talk) == expected(trained, rounded, rate=100.0)

    def test_json_at_a_rate(self, server: Server, trained: Model) -> None:
        with talking(server) as talk:
            talk.start(rate_hz=60)
            fields = columns(MOTION, 0, len(MOTION))
            del fields["t"]
            talk.say("frames", **fields)
            talk.say("end")
            talk.rest()
            motion = replace(MOTION, times=np.arange(len(MOTION)) / 60)
            assert durable(talk) == expected(trained, motion, rate=60.0)

    def test_binary_messages_are_mixed_with_json(self, server: Server, trained: Model) -> None:
        with talking(server) as talk:
            talk.start(encoding="f64")
            talk.frames(MOTION, 0, 200)
            talk.socket.send(binary(200, rows(MOTION)[200:]))
            talk.say("end")
            talk.rest()
            assert durable(talk) == expected(trained, MOTION)


class TestGeometry:
    @pytest.mark.parametrize(("unit", "per_metre"), [("mm", 1000.0), ("cm", 100.0)])
    def test_units_and_y_up(self, server: Server, trained: Model, unit: str, per_metre: float) -> None:
        def sent(track: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
            return np.column_stack([track[:, 0], track[:, 2], -track[:, 1]]) * per_metre

        def understood(track: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
            x, y, z = (sent(track) / per_metre).T
            return np.column_stack([x, -z, y])

        geometry = {"length_unit": unit, "up_axis": "y"}
        with talking(server) as talk:
            assert talk.start(geometry=geometry)["geometry"] == geometry
            thing = MOTION.objects["object"]
            tracks = {"hand": positions(sent(MOTION.hand)), "objects": {"object": positions(sent(thing))}}
            talk.say("frames", first_seq=0, t=MOTION.times.tolist(), **tracks)
            talk.say("end")
            talk.rest()
            motion = Trajectory(MOTION.times, understood(MOTION.hand), {"object": understood(thing)})
            assert durable(talk) == expected(trained, motion)

    def test_the_scene_counts(self, server: Server, trained: Model) -> None:
        raised = np.array([0.0, 0.0, 0.7])
        motion = replace(
            MOTION, hand=MOTION.hand + raised, objects={"object": MOTION.objects["object"] + raised}
        )
        with talking(server) as talk:
            talk.start(scene={"table_height_m": 0.7})
            talk.frames(motion)
            talk.say("end")
            talk.rest()
            found = [(message["action"], message["start_seq"]) for message in durable(talk)]
            wanted = [(message["action"], message["start_seq"]) for message in expected(trained, MOTION)]
            assert found == wanted


class TestFrames:
    def test_times_may_be_irregular(self, server: Server, trained: Model) -> None:
        motion = jittered(MOTION)
        with talking(server) as talk:
            talk.start()
            talk.frames(motion)
            talk.say("end")
            talk.rest()
            assert durable(talk) == expected(trained, motion)

    def test_frames_that_are_there_already_are_ignored(self, server: Server, trained: Model) -> None:
        moved = replace(MOTION, hand=MOTION.hand + 1.0)
        with talking(server) as talk:
            talk.start()
            talk.frames(MOTION, 0, 200)
            talk.frames(moved, 0, 100)
            talk.frames(moved, 150, 200)
            talk.frames(MOTION, 180, chunk=300)
            talk.say("end", last_seq=LAST)
            talk.rest()
            assert durable(talk) == expected(trained, MOTION)

    def test_dropouts_and_jumps_are_gaps(self, server: Server, trained: Model) -> None:
        hand = MOTION.hand.copy()
        hand[40:50] = np.nan
        times = MOTION.times + np.where(np.arange(len(MOTION)) >= 300, 0.5, 0.0)
        motion = replace(MOTION, hand=hand, times=times)
        with talking(server) as talk:
            talk.start()
            talk.frames(motion)
            talk.say("end")
            talk.rest()
            assert durable(talk) == expected(trained, motion)
            gaps = {(gap["from_seq"], gap["to_seq"]): gap["seconds"] for gap in talk.said("gap")}
            assert gaps == pytest.approx({(40, 50): 0.1, (300, 300): 0.51})

    def test_a_binary_dropout_is_a_gap(self, server: Server, trained: Model) -> None:
        hand = MOTION.hand.copy()
        hand[40:50] = np.nan
        motion = replace(MOTION, hand=hand)
        with talking(server) as talk:
            talk.start(encoding="f64")
            talk.socket.send(binary(0, rows(motion)))
            talk.say("end")
            talk.rest()
            assert durable(talk) == expected(trained, motion)
            assert len(talk.said("gap")) == 1

    def test_further_objects_may_be_streamed(self, server: Server, trained: Model) -> None:
        cup = MOTION.objects["object"] + 0.3
        motion = replace(MOTION, objects={"cup": cup, **MOTION.objects})
        with talking(server) as talk:
            started = talk.start(objects=["cup", "object"], encoding="f64")
            assert started["channels"][4:] == ["cup.x", "cup.y", "cup.z", "object.x", "object.y", "object.z"]
            talk.socket.send(binary(0, rows(motion)))
            talk.say("end")
            talk.rest()
            assert durable(talk) == expected(trained, motion)
            assert {message["objects"]["object"] for message in talk.said("segment")} == {"object"}

    def test_objects_may_have_any_names(self, server: Server, trained: Model) -> None:
        thing = MOTION.objects["object"]
        motion = replace(MOTION, objects={"saucer": thing + np.array([0.5, 0.3, 0.0]), "cup": thing})
        with talking(server) as talk:
            talk.start(objects=["saucer", "cup"])
            talk.frames(motion)
            talk.say("end")
            talk.rest()
            assert durable(talk) == expected(trained, motion)
            assert {message["objects"]["object"] for message in talk.said("segment")} == {"cup"}


class TestGoals:
    @pytest.mark.parametrize("places", [{}, PLACES])
    def test_are_weighed_by_hypotheses_and_change_no_segment(
        self, server: Server, trained: Model, places: Message
    ) -> None:
        with talking(server) as talk:
            talk.start(goals=places, options={"hypotheses_hz": 100})
            for first in range(0, len(MOTION), 25):
                talk.frames(MOTION, first, min(first + 25, len(MOTION)))
                talk.say("flush", id=first)
                talk.hear("flushed")
            talk.say("end")
            talk.rest()
            assert durable(talk) == expected(trained, MOTION)
        weighed = [guess["goals"] for guess in talk.said("hypothesis") if "goals" in guess]
        assert weighed
        for goals in weighed:
            posteriors = [goal["posterior"] for goal in goals]
            assert {goal["name"] for goal in goals} == {"object", *places}
            assert posteriors == sorted(posteriors, reverse=True)
            assert sum(posteriors) == pytest.approx(1.0)

    def test_are_meant_in_the_geometry_of_the_stream(self, server: Server) -> None:
        with talking(server) as talk:
            geometry = {"length_unit": "cm", "up_axis": "y"}
            session_id = talk.start(geometry=geometry, goals={"shelf": [40, 90, -20]})["session_id"]
        told = httpx.get(f"{server.url}/v1/sessions/{session_id}").json()
        assert told["goals"] == {"shelf": [0.4, 0.2, 0.9]}


class TestMessages:
    def test_a_stream_without_frames_ends(self, server: Server) -> None:
        with talking(server) as talk:
            talk.start()
            talk.say("end", last_seq=-1)
            assert talk.rest()[-1] == {"type": "ended", "event": 0, "segments": 0, "frames": 0}
            assert talk.closed_with == 1000

    def test_flush_answers_when_all_is_told_and_decides_nothing(self, server: Server, trained: Model) -> None:
        with talking(server) as talk:
            talk.start()
            talk.frames(MOTION, 0, 400)
            talk.say("flush", id="here")
            assert talk.hear("flushed") == {"type": "flushed", "id": "here"}
            told = talk.said("segment")
            talk.frames(MOTION, 400)
            talk.say("end")
            talk.rest()
            assert durable(talk) == expected(trained, MOTION)
            assert told == talk.said("segment")[: len(told)]
            assert 0 < len(told) < len(talk.said("segment"))

    @pytest.mark.parametrize("ping_id", [7, "seven", ""])
    def test_ping(self, server: Server, ping_id: int | str) -> None:
        with talking(server) as talk:
            talk.start()
            talk.say("ping", id=ping_id)
            assert talk.hear("pong")["id"] == ping_id

    def test_a_low_rate_is_warned_of(self, server: Server) -> None:
        with talking(server) as talk:
            talk.start(rate_hz=20)
            assert talk.hear("warning")["code"] == "low_rate"

    def test_hypotheses_can_be_left_out(self, server: Server) -> None:
        with talking(server) as talk:
            talk.start(options={"hypotheses": False})
            talk.frames(MOTION)
            talk.say("end")
            talk.rest()
            assert talk.said("hypothesis") == []

    def test_a_stream_needs_no_subprotocol_but_no_other_one(self, server: Server) -> None:
        with connect(server.stream_url) as socket:
            Talk(socket).start()
        foreign = [Subprotocol("mqtt")]
        with pytest.raises(InvalidStatus) as refused, connect(server.stream_url, subprotocols=foreign):
            pass
        response = refused.value.response
        assert response.status_code == 400
        assert response.headers["Content-Type"] == "application/problem+json"
        assert b"unknown_subprotocol" in (response.body or b"")


class TestVersions:
    def test_the_alias_production_else_the_latest(self, server: Server, trained: Model) -> None:
        name = server.teach(trained, "versions")
        server.teach(trained, name)
        assert self.version_of(server) == 2
        with server.database.transaction() as tx:
            aliases.put(tx, name, "production", 1)
            aliases.put(tx, name, "trial", 2)
        assert self.version_of(server) == 1
        assert self.version_of(server, version="latest") == 2
        assert self.version_of(server, version="trial") == 2
        assert self.version_of(server, version=1) == 1

    def test_a_session_keeps_its_version(self, server: Server, trained: Model) -> None:
        name = server.teach(trained, "moving")
        with server.database.transaction() as tx:
            aliases.put(tx, name, "production", 1)
        with talking(server) as talk:
            talk.start(name)
            talk.frames(MOTION, 0, 100)
            server.teach(trained, name)
            with server.database.transaction() as tx:
                aliases.put(tx, name, "production", 2)
            talk.frames(MOTION, 100)
            talk.say("end")
            talk.rest()
            assert {message["version"] for message in talk.said("segment")} == {1}

    def test_one_of_an_older_format_is_refused_by_name(self, server: Server, trained: Model) -> None:
        name = server.teach(trained, "old")
        artifact = json.loads(dump_model(trained)) | {"format_version": 1}
        digest = server.store.put(json.dumps(artifact).encode())
        with server.database.transaction() as tx:
            fields: dict[str, Any] = {"options": {}, "demonstrations": [], "library_versions": {}}
            versions.register(tx, name, artifact_digest=digest, actions=trained.names, **fields)
        with talking(server) as talk:
            talk.say("start", model=name, geometry=METRES)
            closed_with, code, error = talk.refused()
            assert (closed_with, code) == (4422, "version_unusable")
            assert "format_version" in error["detail"]

    def version_of(self, server: Server, **start: Any) -> int:
        with talking(server) as talk:
            version: int = talk.start("versions", **start)["version"]
            return version


class TestPromises:
    def test_a_segment_that_was_told_is_in_the_database(self, server: Server) -> None:
        with talking(server) as talk:
            session_id = talk.start()["session_id"]
            talk.frames(MOTION)
            talk.say("end")
            kind = ""
            while kind != "ended":
                message = talk.hear("segment", "gap", "ended")
                kind = message["type"]
                with server.database.reading() as tx:
                    kept = sessions.events(tx, session_id, after=message["event"] - 1, limit=1)
                assert [stored.type for stored in kept] == [kind]

    def test_in_real_time_answers_come_in_time(self, server: Server, trained: Model) -> None:
        """accepted at least every 0.5 s, durable within 1.5 s; hypotheses no faster than asked for."""
        told: list[tuple[float, Message]] = []
        with talking(server) as talk:
            talk.start(options={"hypotheses_hz": 5})
            began = monotonic()
            for first in range(0, 300, 5):
                sleep(max(began + first / 100 - monotonic(), 0.0))
                talk.frames(MOTION, first, first + 5)
                told += [(monotonic() - began, message) for message in talk.waiting()]
        accepted = [(at, message) for at, message in told if message["type"] == "accepted"]
        assert max(b - a for (a, _), (b, _) in pairwise(accepted)) < 0.6
        for at, message in accepted:
            assert message["through_seq"] <= at * 100 + 10
            assert message["durable_seq"] >= (at - 1.6) * 100
        guesses = [message for _, message in told if message["type"] == "hypothesis"]
        assert 5 <= len(guesses) <= 5 * told[-1][0] + 2
        for guess in guesses:
            assert sum(action["posterior"] for action in guess["actions"]) == pytest.approx(1.0)
            assert guess["start_seq"] <= guess["through_seq"] < 300
            assert {action["action"] for action in guess["actions"]} == {*trained.names, None, "rest"}

    def test_readyz_says_that_sessions_are_at_work(self, server: Server) -> None:
        assert httpx.get(f"{server.url}/readyz").json()["sessions"] == "ok"
