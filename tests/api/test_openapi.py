"""The served document: its examples work when pasted, and it tells of every refusal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import httpx
import jsonschema
import pytest

from app.client import GestaClient
from app.motion.simulation import recording
from tests.serving import Server

METHODS = ("get", "post", "put", "patch", "delete")


@pytest.fixture
def document(server: Server) -> dict[str, Any]:
    """The OpenAPI document as it is served."""
    found: dict[str, Any] = httpx.get(f"{server.url}/v1/openapi.json").json()
    return found


def operations(document: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    for path, item in document["paths"].items():
        for method in METHODS:
            if method in item:
                yield method, path, item[method]


def resolve(document: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    if "$ref" not in schema:
        return schema
    name = schema["$ref"].rpartition("/")[2]
    found: dict[str, Any] = document["components"]["schemas"][name]
    return found


def request_schema(document: dict[str, Any], operation: dict[str, Any]) -> dict[str, Any]:
    content = operation["requestBody"]["content"]
    return resolve(document, content["application/json"]["schema"])


def test_every_operation_is_described_and_tells_of_its_refusals(document: dict[str, Any]) -> None:
    for method, path, operation in operations(document):
        assert operation["summary"], (method, path)
        if not path.startswith("/v1"):
            continue
        assert operation["description"], (method, path)
        for status, answer in operation["responses"].items():
            if status >= "400":
                assert list(answer["content"]) == ["application/problem+json"], (method, path, status)


def takes_json(operation: dict[str, Any]) -> bool:
    return "application/json" in operation.get("requestBody", {}).get("content", {})


def test_every_request_refuses_unknown_fields_and_gives_an_example(document: dict[str, Any]) -> None:
    for method, path, operation in operations(document):
        if not takes_json(operation) or "versions:import" in path:
            continue
        schema = request_schema(document, operation)
        assert schema["additionalProperties"] is False, (method, path)
        for example in schema["examples"]:
            whole = {**schema, "components": document["components"]}
            jsonschema.Draft202012Validator(whole).validate(example)


def test_examples_work_when_pasted(document: dict[str, Any], client: GestaClient, table_top: str) -> None:
    motion = recording(5, 5).trajectory
    with client.stream(table_top) as stream:
        stream.send(motion.times, motion.hand, motion.objects)
        stream.end()
        assert [message["type"] for message in stream][-1] == "ended"
    known = {"model": table_top, "ref": "latest", "action": "grasp", "alias": "production"}
    known |= {"session": stream.state.started["session_id"], "segment": "0"}
    pasted = 0
    for method, path, operation in operations(document):
        if not takes_json(operation) or "versions:import" in path:
            continue
        for example in request_schema(document, operation)["examples"]:
            body = {**example, "name": "pasted"} if path == "/v1/models" and method == "post" else example
            answer = httpx.request(method, client.url + path.format(**known), json=body)
            assert answer.status_code in (200, 201, 202), (method, path, answer.text)
            pasted += 1
    assert pasted >= 8


def test_answers_are_as_the_document_says(
    document: dict[str, Any], client: GestaClient, table_top: str
) -> None:
    known = {"model": table_top, "ref": "latest"}
    for path in (
        "/v1/models",
        "/v1/models/{model}",
        "/v1/models/{model}/versions/{ref}",
        "/v1/jobs",
        "/livez",
    ):
        schema = document["paths"][path]["get"]["responses"]["200"]["content"]["application/json"]["schema"]
        answer = httpx.get(client.url + path.format(**known)).json()
        whole = {**schema, "components": document["components"]}
        assert not list(jsonschema.Draft202012Validator(whole).iter_errors(answer))
