"""The types of the client's answers are those that the server documents."""

from __future__ import annotations

import re
from inspect import Parameter, signature
from typing import Any, get_args, get_origin, get_type_hints, is_typeddict

import httpx
import pytest

from app.client import AsyncGestaClient, GestaClient
from app.client.rest import Endpoint, Rest
from tests.serving import Server

TYPED = [
    name
    for name, endpoint in vars(Rest).items()
    if isinstance(endpoint, Endpoint) and is_typeddict(endpoint.answer)
]
MADE_UP = {"start": [0.0, 0.0, 0.0], "goal": [0.0, 0.0, 0.0], "motion": {}, "version": 1, "segment": 1}
SEQUENCES = ("demonstrations", "segments", "steps")


@pytest.fixture(scope="module")
def document(server: Server) -> dict[str, Any]:
    found: dict[str, Any] = httpx.get(f"{server.url}/v1/openapi.json").json()
    return found


def operation(document: dict[str, Any], method: str, path: str) -> dict[str, Any]:
    """Return what the document says of a request."""
    path = path.partition("?")[0]
    for template, operations in document["paths"].items():
        pattern = re.sub(r"\{[^}]*\}", "[^/]+?", template)
        if re.fullmatch(pattern, f"/v1{path}") and method.lower() in operations:
            found: dict[str, Any] = operations[method.lower()]
            return found
    raise AssertionError((method, path))


def same(document: dict[str, Any], schema: dict[str, Any], type_: Any, place: str) -> None:
    """Check that a type has the fields of a schema, and so on for what is in them."""
    if "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    if get_origin(type_) is list:
        same(document, schema["items"], get_args(type_)[0], f"{place}[]")
    elif is_typeddict(type_):
        assert set(schema["properties"]) == set(get_type_hints(type_)), place
        for name, field in get_type_hints(type_).items():
            same(document, schema["properties"][name], field, f"{place}.{name}")


@pytest.mark.parametrize("name", TYPED)
def test_an_answer_has_the_fields_that_are_documented(document: dict[str, Any], name: str) -> None:
    endpoint = vars(Rest)[name]
    given = {
        parameter.name: [] if parameter.name in SEQUENCES else MADE_UP.get(parameter.name, "x")
        for parameter in signature(endpoint.request).parameters.values()
        if parameter.default is Parameter.empty and parameter.kind is not Parameter.VAR_KEYWORD
    }
    method, path, *_ = endpoint.request(**given)
    answers = operation(document, method, path)["responses"]
    success = next(answers[status] for status in ("200", "201", "202", "204") if status in answers)
    schema = success.get("content", {}).get("application/json", {}).get("schema", {"properties": {}})
    same(document, schema, endpoint.answer, name)


def test_every_method_tells_what_it_does() -> None:
    for client in (GestaClient, AsyncGestaClient):
        for name, endpoint in vars(Rest).items():
            if isinstance(endpoint, Endpoint):
                assert endpoint.__doc__ == endpoint.request.__doc__
                assert getattr(client("http://127.0.0.1:1"), name).__doc__ == endpoint.request.__doc__
