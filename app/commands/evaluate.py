"""``gesta evaluate``: how good a version is on a labelled recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.client import Message
from app.commands.asking import URL, Model, Url, Version, asking, awaited, number_of
from app.commands.recordings import ActionNames, LabelsFile, MappingFile, Reading, Unit, Up
from app.commands.terminal import AsJson, show, show_json, show_table

MEASURES = {
    "n_true": "true",
    "n_found": "found",
    "delineated": "delineated",
    "classified_of_delineated": "class right",
    "f1_50": "F1@50",
    "f1_75": "F1@75",
    "frame_accuracy": "frames right",
}
"""What they are called, by their field."""


def evaluate(
    model: Model,
    file: Annotated[Path, typer.Argument(help="A labelled recording.")],
    version: Version = None,
    labels: LabelsFile = None,
    action: ActionNames = None,
    mapping: MappingFile = None,
    unit: Unit = None,
    up: Up = None,
    as_json: AsJson = False,
    url: Url = URL,
) -> None:
    """Measure a version on a labelled recording."""
    with asking(url) as client:
        recorded = Reading(unit, up, mapping, labels, action).read_one(file, labelled=True)
        recording = {"trajectory": recorded.trajectory, "segments": list(recorded.labels)}
        number = number_of(client, model, version)
        answer = client.evaluate(model, number, recording=recording, **recorded.ground)
        measures = awaited(client, answer, "Evaluating")
    show_json(measures) if as_json else _show(measures)


def _show(measures: Message) -> None:
    rows = [
        (name, *(each[field] for field in MEASURES))
        for name, each in [("all", measures), *measures["per_class"].items()]
    ]
    title = f"version {measures['version']} of {measures['model']}"
    show_table(("class", *MEASURES.values()), *rows, title=title)
    error, in_rest = measures["median_boundary_error_ms"], measures["action_in_rest"]
    show(f"median boundary error: {'none' if error is None else f'{error:.0f} ms'}")
    show(f"segments where there is no action: {measures['n_extra']}")
    if in_rest is not None:
        show(f"action found in rest: {in_rest:.1%} of its frames")
