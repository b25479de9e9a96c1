"""``gesta train`` and ``evaluate``: labelled recordings become a version, and measure one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from app.client import GestaClient
from app.motion.simulation import recording
from tests.api.conftest import working
from tests.commands.conftest import SEEN, Run, labels_of, write_body, write_table
from tests.serving import Server

TAUGHT = [recording(seed, 6) for seed in (21, 22, 23)]
METRIC = ("--unit", "m", "--up", "z")


@pytest.fixture
def shown(tmp_path: Path) -> Path:
    """A folder of labelled recordings: a body, tables with labels beside them."""
    folder = tmp_path / "shown"
    folder.mkdir()
    write_body(folder / "one.json", TAUGHT[0], labelled=True)
    for name, taught in zip(("two", "three"), TAUGHT[1:], strict=True):
        write_table(folder / f"{name}.csv", taught.trajectory, "t,palm.x,palm.y,palm.z", "cup")
        (folder / f"{name}.labels.json").write_text(json.dumps(labels_of(taught)))
    (folder / "mapping.json").write_text('{"hand": "palm", "objects": {"object": "cup"}}')
    return folder


def test_recordings_become_a_version_that_is_measured(
    server: Server, run: Run, client: GestaClient, shown: Path, tmp_path: Path
) -> None:
    asked = (shown, "--mapping", shown / "mapping.json", *METRIC)
    with working(server):
        first = run("train", "taught", *asked, "--promote")
        again = run("train", "taught", "--json")
    count = sum(len(taught.segments) for taught in TAUGHT)
    assert "created the model taught with the objects object" in first.stderr
    assert f"two.csv: {len(TAUGHT[1].segments)} demonstrations" in first.stderr
    assert first.stdout.startswith("version 1 of taught, production\n")
    assert f"of {count} demonstrations classified right" in first.stdout
    assert json.loads(again.stdout)["version"] == 2
    assert sum(client.model("taught")["actions"].values()) == count
    labelled = write_body(tmp_path / "seen.json", SEEN, labelled=True)
    told = run("evaluate", "taught", labelled).stdout.splitlines()
    assert told[0].strip() == "version 1 of taught", "it is production"
    assert told[3].split()[:2] == ["all", str(len(SEEN.segments))]
    measures = json.loads(run("evaluate", "taught", labelled, "--version", "latest", "--json").stdout)
    assert (measures["version"], measures["n_true"]) == (2, len(SEEN.segments))


@pytest.mark.usefixtures("table_top")
def test_labels_come_from_where_they_are(run: Run, tmp_path: Path) -> None:
    table = write_table(tmp_path / "seen.csv", SEEN.trajectory)
    asked = ("evaluate", "table-top", table, *METRIC, "--json")
    assert "has no labels" in run(*asked, code=1).stderr
    labels = labels_of(SEEN)
    (tmp_path / "seen.labels.csv").write_text(
        "label,start_s,end_s\n"
        + "".join(f"{each['action']},{each['start_s']},{each['end_s']}\n" for each in labels)
    )
    beside = json.loads(run(*asked).stdout)
    assert beside["n_true"] == len(labels)
    (tmp_path / "others.json").write_text(json.dumps([{**each, "action": "move"} for each in labels[1:]]))
    others = (*asked, "--labels", tmp_path / "others.json")
    renamed = run(*others, "--action", "move=grasp", "--action", "wave")
    assert json.loads(renamed.stdout)["per_class"]["grasp"]["n_true"] == len(labels) - 1
    assert "has no label wave; there are move" in renamed.stderr
    assert "has no label grasp; there are move" in run(*others, "--action", "grasp", code=1).stderr


def test_what_cannot_be_learned_says_why(run: Run, shown: Path, tmp_path: Path, server: Server) -> None:
    unlabelled = write_body(tmp_path / "unlabelled.json", SEEN)
    labels = labels_of(SEEN)
    once = tmp_path / "once.json"
    body = json.loads(write_body(once, SEEN, labelled=True).read_text())
    body["recording"]["segments"] = labels[:1]
    once.write_text(json.dumps(body))
    early = tmp_path / "early.json"
    body["recording"]["segments"] = [{**labels[0], "start_s": -5.0}]
    early.write_text(json.dumps(body))
    for words, why in (
        (("nobody",), "model_not_found"),
        (("new", unlabelled), "unlabelled.json: has no labels"),
        (("new", shown / "two.csv"), "--unit"),
        (("new", tmp_path / "shown" / "none"), "no such file"),
        (("new", early), "early.json:"),
    ):
        assert why in run("train", *words, code=1).stderr
    with working(server):
        assert "fit_failed" in run("train", "new", once, code=1).stderr
    usage = run("train", "new", unlabelled, once, "--labels", once, code=2)
    assert "--labels is for one recording" in usage.stderr
