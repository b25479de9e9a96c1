"""What clients see of the store: a bucket is like any other, and one that is away is told, not hidden."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest

from app.client import ApiError, GestaClient
from app.registry.store import Store
from tests.api.conftest import Sent
from tests.serving import Server, serving


def test_a_server_on_a_bucket_keeps_gives_and_misses_by_name(
    tmp_path: Path, s3_url: str, sent: list[Sent]
) -> None:
    with serving(tmp_path, store_url=s3_url) as server, GestaClient(server.url) as client:
        assert httpx.get(f"{server.url}/readyz").json()["store"] == "ok"
        client.create_model("table-top", ["object"])
        [id_] = client.add_demonstrations("table-top", sent[:1])["created"]
        assert client.demonstration("table-top", id_)["trajectory"]["hand"] == sent[0][1]["hand"]
        store = Store(s3_url)
        [held] = store.listing()
        store.set_aside(held.digest)
        store.discard(held.digest)
        lost = f"503 artifact_missing.*demonstration {id_} of model 'table-top'.*{held.digest}"
        with pytest.raises(ApiError, match=lost):
            client.demonstration("table-top", id_)
    assert not (tmp_path / "store").exists()


def test_a_store_that_takes_nothing_is_told_and_nothing_is_acknowledged(
    client: GestaClient, server: Server, sent: list[Sent]
) -> None:
    client.create_model("unkept", ["object"])
    root = Path(server.store.url)
    away = root.with_name("away")
    root.mkdir(exist_ok=True)
    root.rename(away)
    root.touch()
    try:
        with pytest.raises(ApiError, match="503 store_unavailable"):
            client.add_demonstrations("unkept", sent)
    finally:
        root.unlink()
        away.rename(root)
    assert client.request("GET", "/models/unkept/demonstrations")["demonstrations"] == []
    assert len(client.add_demonstrations("unkept", sent)["created"]) == len(sent)
