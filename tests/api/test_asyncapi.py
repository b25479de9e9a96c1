"""docs/asyncapi.yaml says what the code does. Every message heard in the tests is held against it, too."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import pytest
from jsonschema import Draft202012Validator
from pydantic import BaseModel

from app.api import stream_messages
from app.api.sessions import SegmentEventTold
from app.api.stream_closing import CODES, RETRYABLE, closing_of
from app.api.stream_messages import FRAME_FIELDS, Start, read, read_start
from app.api.stream_server import LARGEST
from app.registry.errors import NotFound
from app.service import session_errors
from app.service.frames import Frames, Layout
from app.service.geometry import Geometry
from app.service.live import Limits
from app.service.session_errors import Code, SessionError
from tests.talking import Message, document, validators

APP = Path(session_errors.__file__).parents[1]
MESSAGES: dict[str, Any] = document()["components"]["messages"]
FROM_CLIENTS = ("start", "frames", "flush", "end", "ping")


def payload(name: str) -> dict[str, Any]:
    """Return the schema of a message."""
    found: dict[str, Any] = MESSAGES[name]["payload"]
    return found


def examples(*names: str) -> list[tuple[str, Message]]:
    """Return the examples of these messages, each with its name."""
    return [(name, example["payload"]) for name in names for example in MESSAGES[name]["examples"]]


def subclasses(kind: type[SessionError]) -> set[type[SessionError]]:
    return {kind}.union(*(subclasses(child) for child in kind.__subclasses__()))


class TestDocument:
    @pytest.mark.parametrize("name", MESSAGES)
    def test_schemas_are_schemas(self, name: str) -> None:
        Draft202012Validator.check_schema(payload(name))
        assert payload(name)["properties"]["type"] == {"const": name}
        assert payload(name)["additionalProperties"] is False

    @pytest.mark.parametrize(("name", "example"), examples(*MESSAGES))
    def test_examples_fit_their_schemas(self, name: str, example: Message) -> None:
        validators()[name].validate(example)

    def test_every_message_is_on_the_channel_and_in_one_operation(self) -> None:
        channel = document()["channels"]["stream"]["messages"]
        assert channel == {name: {"$ref": f"#/components/messages/{name}"} for name in MESSAGES}
        operations = document()["operations"]
        sent, heard = (
            [message["$ref"].rpartition("/")[2] for message in operations[name]["messages"]]
            for name in ("send", "hear")
        )
        assert tuple(sent) == FROM_CLIENTS
        assert sorted(sent + heard) == sorted(MESSAGES)


class TestClientMessages:
    @pytest.mark.parametrize(("name", "example"), examples(*FROM_CLIENTS[1:]))
    def test_examples_are_understood(self, name: str, example: Message) -> None:
        found = read(json.dumps(example), Layout(("object",), Geometry()))
        assert isinstance(found, Frames) if name == "frames" else type(found).__name__.lower() == name

    @pytest.mark.parametrize(("_", "example"), examples("start"))
    def test_starts_are_understood(self, _: str, example: Message) -> None:
        assert read_start(json.dumps(example)).model == example["model"]

    @pytest.mark.parametrize(
        ("kind", "schema"),
        [
            (Start, payload("start")),
            (stream_messages.SceneOfStart, payload("start")["properties"]["scene"]),
            (stream_messages.Options, payload("start")["properties"]["options"]),
            (stream_messages.Resume, payload("start")["properties"]["resume"]),
            (stream_messages.GeometryOfStart, document()["components"]["schemas"]["geometry"]),
            (stream_messages.Flush, payload("flush")),
            (stream_messages.End, payload("end")),
            (stream_messages.Ping, payload("ping")),
        ],
    )
    def test_fields_are_those_that_are_read(self, kind: type[BaseModel], schema: dict[str, Any]) -> None:
        assert set(kind.model_fields) == set(schema["properties"])
        required = {name for name, field in kind.model_fields.items() if field.is_required()}
        assert required == set(schema.get("required", ()))

    def test_fields_of_frames_are_those_that_are_read(self) -> None:
        assert set(payload("frames")["properties"]) == FRAME_FIELDS


class TestServerMessages:
    def test_segments_over_rest_have_the_same_fields(self) -> None:
        properties = payload("segment")["properties"]
        assert set(SegmentEventTold.model_fields) == set(properties) - {"type"}

    def test_the_limits_are_those_of_the_example(self) -> None:
        [example] = MESSAGES["started"]["examples"]
        limits = Limits()
        assert example["payload"]["limits"] == {
            "max_frame_bytes": limits.message_bytes,
            "max_frames_per_message": limits.message_frames,
            "max_unacked_frames": limits.unacked_frames,
        }
        assert {field.name for field in fields(Limits)} >= {"message_bytes", "idle"}

    def test_the_description_names_the_limits(self) -> None:
        text = " ".join(document()["info"]["description"].split())
        assert f"4408 idle for {Limits().idle:g} s" in text
        assert f"resumed for {Limits().resume / 60:g} minutes" in text
        assert f"over {LARGEST >> 20} MiB" in text


class TestErrors:
    def test_codes_are_those_of_the_code(self) -> None:
        assert set(payload("error")["properties"]["code"]["enum"]) == set(get_args(Code))

    @pytest.mark.parametrize("code", get_args(Code))
    def test_every_code_is_in_use(self, code: str) -> None:
        used = [path for path in APP.rglob("*.py") if f'"{code}"' in path.read_text()]
        assert {path.name for path in used} - {"session_errors.py"} or (
            (APP / "service" / "session_errors.py").read_text().count(f'"{code}"') > 1
        )

    @pytest.mark.parametrize(
        "kind", sorted(subclasses(SessionError) - {SessionError}, key=repr), ids=lambda kind: kind.__name__
    )
    def test_every_error_closes_with_a_code_of_its_own(self, kind: type[SessionError]) -> None:
        error = kind.__new__(kind)
        SessionError.__init__(error, "malformed", "as a test")
        assert closing_of(error).code == next(code for base, code in CODES if issubclass(kind, base))

    @pytest.mark.parametrize(
        ("kind", "code"), [("model", "model_not_found"), ("version", "version_not_found")]
    )
    def test_what_is_not_found_closes_with_4404(self, kind: str, code: str) -> None:
        closing = closing_of(NotFound(kind, "x"))
        assert (closing.code, closing.reason) == (4404, code)

    def test_close_codes_are_described(self) -> None:
        text = " ".join(document()["info"]["description"].split())
        for close_code in {1000, 1011, 4404, *(code for _, code in CODES)}:
            assert str(close_code) in text
        worth = text.partition("Worth a retry: ")[2].partition(". An")[0]
        assert {int(code) for code in worth.split(", ")} == RETRYABLE

    def test_nothing_of_an_internal_error_is_told(self) -> None:
        closing = closing_of(ZeroDivisionError("secret"))
        assert (closing.code, closing.reason) == (1011, "internal")
        assert "secret" not in json.dumps(closing.error)
