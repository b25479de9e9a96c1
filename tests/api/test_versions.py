"""Versions over the real server and a real worker: trained, named, exported, imported."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from subprocess import Popen
from typing import Any

import httpx
import numpy as np
import pytest

from app.client import ApiError, GestaClient, JobFailed
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Demonstration
from app.registry import models
from app.registry.artifacts import dump_model
from app.service.uploads import specification_of
from tests.api.conftest import Sent
from tests.serving import Server

QUICK = {"n_states": 4}

pytestmark = pytest.mark.usefixtures("worker")


def train(client: GestaClient, model: str, **fields: Any) -> int:
    """Train a version and return its number."""
    job = client.train(model, options=QUICK, **fields)
    return int(client.result(job["id"])["version"])


@pytest.fixture
def filled(client: GestaClient, new_model: Callable[..., str], sent: list[Sent]) -> str:
    """A model with demonstrations."""
    model = new_model()
    client.add_demonstrations(model, sent)
    return model


def test_a_version_says_all_it_was_made_of(
    client: GestaClient, filled: str, shown: list[Demonstration], server: Server
) -> None:
    states: list[tuple[str, int]] = []
    job = client.train(filled, options={**QUICK, "deviation_floor_m": 0.015, "seed": 5})
    result = client.result(job["id"], lambda job: states.append((job["state"], job["progress"]["done"])))
    assert result == {"model": filled, "version": 1}
    assert states[-1][0] == "succeeded"
    assert [done for _, done in states] == sorted(done for _, done in states)
    version = client.version(filled, 1)
    assert version["actions"] == ["displace", "grasp", "push", "retract"]
    assert version["options"]["n_states"] == 4
    assert version["options"]["deviation_floor"] == 0.015
    assert version["seed"] == 5
    assert version["job_id"] == job["id"]
    assert version["evaluation"] is not None
    assert version["evaluation"]["n"] == len(shown)
    assert version["evaluation"]["accuracy"] >= 0.8
    assert {"numpy", "numba", "gesta"} <= version["library_versions"].keys()
    listed = client.pages(f"/models/{filled}/demonstrations", "demonstrations")
    assert version["demonstrations"] == [item["digest"] for item in listed]


def test_training_over_the_wire_is_that_of_the_core(
    client: GestaClient, filled: str, shown: list[Demonstration], server: Server
) -> None:
    number = train(client, filled)
    with server.database.reading() as tx:
        specification = specification_of(models.get(tx, filled))
    expected = dump_model(fit_model(shown, specification, TrainingOptions(n_states=4)))
    assert artifact(client, filled, number).content == expected


def artifact(client: GestaClient, model: str, ref: str | int) -> httpx.Response:
    answer = httpx.get(f"{client.url}/v1/models/{model}/versions/{ref}/artifact")
    assert answer.status_code == 200, answer.text
    return answer


def test_versions_are_numbered_and_listed_newest_first(client: GestaClient, filled: str) -> None:
    assert [train(client, filled) for _ in range(2)] == [1, 2]
    assert [v["version"] for v in client.pages(f"/models/{filled}/versions", "versions")] == [2, 1]
    assert client.version(filled, "latest")["version"] == 2


def test_an_idempotency_key_makes_one_job(client: GestaClient, filled: str) -> None:
    first = client.train(filled, "key-1", options=QUICK)
    assert client.train(filled, "key-1", options=QUICK)["id"] == first["id"]
    with pytest.raises(ApiError, match="409 idempotency_key_reused"):
        client.train(filled, "key-1", options={"n_states": 5})
    client.result(first["id"])
    assert client.train(filled, "key-1", options=QUICK)["id"] == first["id"]
    assert len(list(client.pages(f"/models/{filled}/versions", "versions"))) == 1


def test_classes_without_news_keep_their_action_model(
    client: GestaClient, new_model: Callable[..., str], sent: list[Sent]
) -> None:
    model, held_back = new_model(), ("push", dict(sent)["push"])
    client.add_demonstrations(model, [shown for shown in sent if shown != held_back])
    base = train(client, model)
    client.add_demonstrations(model, [held_back])
    number = train(client, model, base=base)
    version = client.version(model, number)
    assert (version["base"], version["lineage"]) == (base, [base])
    old, new = (
        {action["action"]: action for action in artifact(client, model, ref).json()["actions"]}
        for ref in (base, number)
    )
    assert [name for name in new if new[name] != old[name]] == ["push"]
    assert len(new["push"]["durations"]) == len(old["push"]["durations"]) + 1


def test_a_version_can_be_made_of_chosen_demonstrations(client: GestaClient, filled: str) -> None:
    grasps = client.pages(f"/models/{filled}/demonstrations?action=grasp", "demonstrations")
    number = train(client, filled, demonstrations=[item["id"] for item in grasps])
    assert client.version(filled, number)["actions"] == ["grasp"]
    with pytest.raises(ApiError, match="404 demonstration_not_found"):
        client.train(filled, demonstrations=["none"])


def test_what_cannot_be_trained_is_refused_at_once(
    client: GestaClient, new_model: Callable[..., str], sent: list[Sent], filled: str
) -> None:
    model = new_model()
    with pytest.raises(ApiError, match="409 nothing_to_train"):
        client.train(model)
    client.add_demonstrations(model, sent[:1])
    with pytest.raises(ApiError, match=r"422 fit_failed.*has 1 demonstration"):
        client.train(model)
    with pytest.raises(ApiError, match="404 version_not_found"):
        client.train(filled, base=7)
    with pytest.raises(ApiError, match="422 invalid"):
        client.train(filled, options={"n_states": 1})


def test_a_training_that_fails_says_why_and_registers_nothing(client: GestaClient, filled: str) -> None:
    job = client.train(filled, options={"n_states": 64})
    with pytest.raises(JobFailed, match="usable frames") as raised:
        client.result(job["id"])
    assert raised.value.job["error"]["code"] == "unusable_demonstration"
    assert client.request("GET", f"/models/{filled}/versions")["versions"] == []


def test_an_artifact_taken_elsewhere_does_the_same(
    client: GestaClient, filled: str, new_model: Callable[..., str]
) -> None:
    number, other = train(client, filled), new_model()
    exported = artifact(client, filled, number)
    imported = httpx.post(f"{client.url}/v1/models/{other}/versions:import", content=exported.content)
    assert imported.status_code == 201, imported.text
    assert imported.headers["ETag"] == exported.headers["ETag"]
    assert imported.json()["version"] == 1
    assert artifact(client, other, 1).content == exported.content
    start, goal = [0.0, 0.0, 0.1], [0.3, 0.1, 0.1]
    here, there = (client.generate(model, "latest", "grasp", start, goal) for model in (filled, other))
    assert here["position"] == there["position"]


@pytest.mark.parametrize(
    ("spoil", "detail"),
    [
        (lambda model: model.pop("background"), "background: is missing"),
        (lambda model: model["features"].update(objects=["cup"]), "features.objects"),
        (lambda model: model["actions"][0]["stay"].__setitem__(0, 2.0), "stay"),
        (lambda model: model.update(format="pickle"), "format"),
        (lambda model: model["actions"][1].update(action="rest"), "actions[1].action"),
    ],
)
def test_an_artifact_that_is_none_is_refused_by_field(
    client: GestaClient, filled: str, spoil: Callable[[dict[str, Any]], Any], detail: str
) -> None:
    number = train(client, filled)
    model = artifact(client, filled, number).json()
    spoil(model)
    answer = httpx.post(f"{client.url}/v1/models/{filled}/versions:import", content=json.dumps(model))
    assert (answer.status_code, answer.json()["code"]) == (422, "artifact_invalid")
    assert detail in answer.json()["detail"]


def test_an_alias_moves_and_its_history_stays(client: GestaClient, filled: str) -> None:
    for _ in range(2):
        train(client, filled)
    for version in (1, 2, 2, 1):
        assert client.promote(filled, "production", version)["version"] == version
    assert client.version(filled, "production")["aliases"] == ["production"]
    client.request("DELETE", f"/models/{filled}/aliases/production")
    with pytest.raises(ApiError, match="404 version_not_found"):
        client.version(filled, "production")
    history = client.request("GET", f"/models/{filled}/aliases/production/history")["history"]
    assert [(move["previous"], move["version"]) for move in history] == [(1, None), (2, 1), (1, 2), (None, 1)]


@pytest.mark.parametrize("alias", ["latest", "7", "a b"])
def test_a_name_that_means_a_version_is_no_alias(client: GestaClient, filled: str, alias: str) -> None:
    train(client, filled)
    with pytest.raises(ApiError, match="422 invalid"):
        client.promote(filled, alias, 1)
    with pytest.raises(ApiError, match="404 version_not_found"):
        client.promote(filled, "production", 9)


def test_an_altered_artifact_is_named_and_never_served(
    client: GestaClient, filled: str, server: Server
) -> None:
    job = client.train(filled, options={"n_states": 3})
    digest = client.version(filled, client.result(job["id"])["version"])["digest"]
    [path] = Path(server.store.url).rglob(digest.removeprefix("sha256:")[2:])
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"grasp", b"grisp"))
    with pytest.raises(ApiError, match=f"503 artifact_altered.*version 1 of model {filled!r}.*{digest}"):
        client.generate(filled, 1, "grasp", np.zeros(3), np.ones(3))
    path.unlink()
    with pytest.raises(ApiError, match=f"503 artifact_missing.*version 1 of model {filled!r}.*{digest}"):
        client.generate(filled, 1, "grasp", np.zeros(3), np.ones(3))
    path.write_bytes(whole)
    assert client.generate(filled, 1, "grasp", np.zeros(3), np.ones(3))["version"] == 1


def test_the_worker_is_still_alive(worker: Popen[bytes]) -> None:
    assert worker.poll() is None
