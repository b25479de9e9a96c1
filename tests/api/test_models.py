"""Models over the real server."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import httpx
import pytest

from app.client import ApiError, GestaClient
from tests.serving import Server


def test_a_created_model_is_there_whole(client: GestaClient) -> None:
    made = client.create_model(
        "whole", ["cup", "box"], table_height_m=0.72, description="a kitchen", features={"rate_hz": 80}
    )
    assert made["objects"] == ["cup", "box"]
    assert made["table_height_m"] == 0.72
    assert made["features"] == {"rate_hz": 80.0}
    assert client.request("GET", "/models/whole") == {**made, "actions": {}}


@pytest.mark.parametrize(
    ("body", "pointer"),
    [
        ({"objects": []}, "/name"),
        ({"name": "a/b", "objects": []}, "/name"),
        ({"name": "", "objects": []}, "/name"),
        ({"name": "m"}, "/objects"),
        ({"name": "m", "objects": ["a", "a"]}, ""),
        ({"name": "m", "objects": ["hand"]}, ""),
        ({"name": "m", "objects": [], "table_height_m": "0"}, "/table_height_m"),
        ({"name": "m", "objects": [], "table_height_m": 720}, "/table_height_m"),
        ({"name": "m", "objects": [], "colour": "red"}, "/colour"),
        ({"name": "m", "objects": [], "features": {"rate_hz": 0}}, "/features/rate_hz"),
    ],
)
def test_what_is_wrong_with_a_model_is_pointed_at(
    client: GestaClient, body: dict[str, object], pointer: str
) -> None:
    with pytest.raises(ApiError) as raised:
        client.request("POST", "/models", body)
    assert raised.value.status == 422
    assert pointer in [place["pointer"] for place in raised.value.problem["errors"]]


def test_a_name_is_given_once(client: GestaClient, new_model: Callable[..., str]) -> None:
    with pytest.raises(ApiError, match="409 already_exists"):
        client.create_model(new_model())


def test_changes_need_the_etag_that_is_sent(client: GestaClient, new_model: Callable[..., str]) -> None:
    name = new_model(description="first")
    http, path = httpx.Client(base_url=client.url), f"/v1/models/{name}"
    etag = http.get(path).headers["ETag"]
    changed = http.patch(path, json={"table_height_m": 0.5}, headers={"If-Match": etag})
    assert changed.json()["table_height_m"] == 0.5
    assert changed.json()["description"] == "first"
    assert changed.headers["ETag"] != etag
    for answer in (
        http.patch(path, json={"description": None}, headers={"If-Match": etag}),
        http.delete(path, headers={"If-Match": etag}),
    ):
        assert answer.status_code == 412
        assert answer.json()["code"] == "precondition_failed"
    assert http.get(path).headers["ETag"] == changed.headers["ETag"]
    assert http.delete(path, headers={"If-Match": changed.headers["ETag"]}).status_code == 204
    assert http.get(path).status_code == 404
    http.close()


def test_pages_hold_every_model_once(client: GestaClient, new_model: Callable[..., str]) -> None:
    made = {new_model() for _ in range(5)}
    seen, token = [], ""
    while token is not None:
        page = client.request("GET", f"/models?page_size=2{token and f'&page_token={token}'}")
        assert len(page["models"]) <= 2
        seen += [model["name"] for model in page["models"]]
        token = page["next_page_token"]
    assert seen == sorted(set(seen))
    assert made <= set(seen)
    assert made <= {model["name"] for model in client.pages("/models", "models")}


@pytest.mark.parametrize("query", ["page_size=0", "page_size=501", "page_size=x", "page_token=bogus"])
def test_a_page_that_cannot_be_is_refused(client: GestaClient, query: str) -> None:
    with pytest.raises(ApiError, match="422 invalid"):
        client.request("GET", f"/models?{query}")


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/models/none"),
        ("PATCH", "/models/none"),
        ("DELETE", "/models/none"),
        ("GET", "/models/none/demonstrations"),
        ("GET", "/models/none/versions"),
        ("GET", "/models/none/versions/latest"),
        ("POST", "/models/none/versions"),
        ("GET", "/models/none/aliases/production/history"),
    ],
)
def test_a_model_that_is_not_there_is_not_found(client: GestaClient, method: str, path: str) -> None:
    with pytest.raises(ApiError, match="404 model_not_found"):
        client.request(method, path, {} if method in ("PATCH", "POST") else None)


def test_every_error_is_a_problem_with_the_id_of_its_request(server: Server) -> None:
    with httpx.Client(base_url=server.url, headers={"X-Request-ID": "abc-1"}) as http:
        answers = {
            404: http.get("/v1/nothing"),
            405: http.put("/v1/models"),
            400: http.post("/v1/models", content=b"{", headers={"Content-Type": "application/json"}),
            415: http.post("/v1/models", content=b"name=m"),
            422: http.post("/v1/models", json={}),
        }
        for status, answer in answers.items():
            assert answer.status_code == status, answer.text
            assert answer.headers["Content-Type"] == "application/problem+json"
            assert answer.headers["X-Request-ID"] == "abc-1"
            body = answer.json()
            assert {"type", "title", "status", "detail", "code", "errors", "request_id"} == body.keys()
            assert (body["status"], body["request_id"]) == (status, "abc-1")
        assert http.get("/livez", headers={"X-Request-ID": "no id!"}).headers["X-Request-ID"] != "no id!"


def test_a_body_too_large_is_refused_declared_or_not(server: Server) -> None:
    piece = b" " * (1 << 20)
    headers = {"Content-Type": "application/json"}
    with httpx.Client(base_url=server.url) as http:
        declared = http.post("/v1/models", content=piece * 65, headers=headers)
        streamed = http.post("/v1/models", content=iter([piece] * 65), headers=headers)
    for answer in (declared, streamed):
        assert (answer.status_code, answer.json()["code"]) == (413, "too_large")


def test_health_tells_what_is_wrong(server: Server) -> None:
    assert httpx.get(f"{server.url}/livez").json() == {"status": "ok"}
    root = Path(server.store.url)
    away = root.with_name("away")
    assert httpx.get(f"{server.url}/readyz").status_code == 200
    root.rename(away)
    root.touch()
    try:
        answer = httpx.get(f"{server.url}/readyz")
        assert answer.status_code == 503
        assert answer.json() == {"database": "ok", "store": "StoreUnavailable", "sessions": "ok"}
    finally:
        root.unlink()
        away.rename(root)
