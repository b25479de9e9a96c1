"""``gesta train``: labelled recordings become demonstrations, and all demonstrations a version."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.client import ApiError, GestaClient
from app.client.answers import Version
from app.commands.archive import recordings
from app.commands.asking import URL, Model, Url, asking, create_if_absent
from app.commands.recordings import ActionNames, LabelsFile, MappingFile, Reading, Recorded, Unit, Up
from app.commands.terminal import AsJson, job_watched, show, show_json, show_table, tell


def train(
    model: Model,
    files: Annotated[
        list[Path] | None, typer.Argument(help="Labelled recordings, or folders of them; none: as they are.")
    ] = None,
    mapping: MappingFile = None,
    labels: LabelsFile = None,
    action: ActionNames = None,
    unit: Unit = None,
    up: Up = None,
    table_height: Annotated[float, typer.Option(help="Of a model that is new [m].")] = 0.0,
    promote: Annotated[bool, typer.Option("--promote", help="Let `production` name the version.")] = False,
    as_json: AsJson = False,
    url: Url = URL,
) -> None:
    """Upload labelled recordings and train a version on all demonstrations of a model.

    A model that is not there is created, with the objects of the first recording as its roles. What was
    uploaded before is not uploaded twice.
    """
    if labels is not None and len(files or []) != 1:
        raise typer.BadParameter("--labels is for one recording")
    with asking(url) as client:
        reading = Reading(unit, up, mapping, labels, action)
        for path in recordings(files, mapping, labels) if files else []:
            recorded = reading.read_one(path, labelled=True)
            objects = list(recorded.trajectory.get("objects", {}))
            create_if_absent(client, model, objects, table_height_m=table_height)
            _upload(client, model, path, recorded)
        with job_watched("Training") as watch:
            number = client.result(client.train(model)["id"], watch)["version"]
        version = client.version(model, number)
        if promote:
            client.promote(model, "production", number)
            version = client.version(model, number)
    show_json(version) if as_json else _show(version)


def _upload(client: GestaClient, model: str, path: Path, recorded: Recorded) -> None:
    """Upload a recording; one that is refused is told with its name."""
    try:
        added = client.add_recording(
            model, recorded.trajectory, recorded.labels, recorded.geometry, recorded.scene
        )
    except ApiError as error:
        tell(f"{path}:", "red")
        raise error
    known = f", {len(added['duplicates'])} were there already" if added["duplicates"] else ""
    tell(f"{path}: {len(added['created'])} demonstrations{known}")


def _show(version: Version) -> None:
    aliases = "".join(f", {alias}" for alias in version["aliases"])
    show(f"version {version['version']} of {version['model']}{aliases}")
    found = version["evaluation"]
    if found is None:
        show("not cross-validated: some class has too few demonstrations")
        return
    show(f"cross-validated: {found['accuracy']:.1%} of {found['n']} demonstrations classified right")
    show_table(("class", "right"), *found["per_class"].items())
