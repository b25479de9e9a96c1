"""Recordings that a command is given: request bodies (``.json``), all formats that ``app.formats`` reads.

A file of a stranger is read in a process of its own. Which of its tracks are the hand and the objects is said
by a mapping; without one, the track called ``hand`` is the hand, and all others are objects by their names.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from app.client import METRES, Message
from app.client import trajectory as as_sent
from app.commands.terminal import tell
from app.formats.errors import FormatError, InvalidMapping, UndeclaredGeometry

if TYPE_CHECKING:
    from app.formats.capture import Capture, Label
    from app.formats.mapping import TrackMapping

HAND = "hand"
BODY = ".json"
LABELS = (".labels.json", ".labels.csv")
"""Ends of the names of files with labels, in place of that of the recording beside them."""
UNLABELLED = "has no labels: give --labels, or put them beside it as NAME.labels.json or .csv"

MappingFile = Annotated[
    Path | None, typer.Option("--mapping", help="Which tracks are hand and objects: see `gesta inspect`.")
]
LabelsFile = Annotated[
    Path | None,
    typer.Option(
        "--labels", help="Of the recording; default: FILE.labels.json or .csv beside it, or its own."
    ),
]
ActionNames = Annotated[
    list[Any] | None,
    typer.Option(
        "--action",
        parser=lambda text: tuple(text.partition("=")[::2]),
        metavar="LABEL[=ACTION]",
        help="A label to use, and the action that it is; repeat; default: all, as they are.",
    ),
]
Unit = Annotated[
    Literal["m", "cm", "mm"] | None, typer.Option(help="Of positions, where the file does not say it.")
]
Up = Annotated[
    Literal["z", "y"] | None, typer.Option(help="Axis that is up, where the file does not say it.")
]


class Unusable(FormatError):
    """A file that holds no recording, or an archive without any."""


@dataclass(frozen=True)
class Recorded:
    """A recording as requests carry it; labels: ``{"action", "start_s", "end_s"}``."""

    trajectory: Message
    geometry: Mapping[str, str] = field(default_factory=lambda: METRES)
    scene: Mapping[str, float] | None = None
    labels: Sequence[Message] = ()

    @property
    def ground(self) -> Message:
        """The fields beside the trajectory."""
        return {"geometry": dict(self.geometry)} | ({"scene": dict(self.scene)} if self.scene else {})


@dataclass(frozen=True)
class Reading:
    """How files are read, as far as they do not say it; actions: (label, action) of the labels to use."""

    unit: Literal["m", "cm", "mm"] | None = None
    up: Literal["z", "y"] | None = None
    mapping: Path | None = None
    labels: Path | None = None
    actions: Sequence[tuple[str, str]] | None = None

    def capture(self, path: Path) -> Capture:
        """Return what is in a file. Raises FormatError."""
        from app.formats.capture import Declared  # noqa: PLC0415 (not for a request body)
        from app.formats.isolation import read_apart  # noqa: PLC0415

        try:
            return read_apart(path, Declared(self.unit, self.up))
        except UndeclaredGeometry as error:
            option = {"length_unit": "--unit", "up_axis": "--up"}[error.field]
            raise Unusable(f"{error} (by {option})") from error

    def read(self, path: Path) -> Recorded:
        """Return the recording in a file. Raises FormatError, OSError."""
        if path.suffix.lower() == BODY:
            return read_body(path)
        from app.formats import mapping  # noqa: PLC0415 (not for a request body)
        from app.motion.errors import InvalidTrajectory  # noqa: PLC0415

        capture = self.capture(path)
        try:
            motion = mapping.trajectory(capture, self._mapping(capture))
        except InvalidTrajectory as error:
            raise Unusable(str(error)) from error
        finish = float(motion.times[-1])
        labels = [
            {"action": label.action, "start_s": label.start_s, "end_s": min(label.end_s, finish)}
            for label in self._labels(path, capture)
        ]
        return Recorded(as_sent(motion.times, motion.hand, motion.objects), labels=labels)

    def read_one(self, path: Path, *, labelled: bool = False) -> Recorded:
        """Return the recording in a file; what is wrong is told with the file's name. Raises as ``read``."""
        try:
            recorded = self.read(path)
            if labelled:
                recorded = replace(recorded, labels=self._used(path, recorded.labels))
        except FormatError as error:
            raise Unusable(f"{path}: {str(error).removeprefix(f'{path.name}: ')}") from error
        return recorded

    def _used(self, path: Path, labels: Sequence[Message]) -> Sequence[Message]:
        """Return those of the labels that are asked for, called by their actions. Raises Unusable."""
        if not labels:
            raise Unusable(UNLABELLED)
        if not self.actions:
            return labels
        actions = {label: action or label for label, action in self.actions}
        names = dict.fromkeys(each["action"] for each in labels)
        if absent := ", ".join(actions.keys() - names):
            told = f"has no label {absent}; there are {', '.join(names)}"
            if not names.keys() & actions:
                raise Unusable(told)
            tell(f"{path}: {told}", "yellow")
        return [each | {"action": actions[each["action"]]} for each in labels if each["action"] in actions]

    def _mapping(self, capture: Capture) -> TrackMapping:
        from app.formats.mapping import TrackMapping  # noqa: PLC0415 (not for a request body)

        if self.mapping is not None:
            try:
                return TrackMapping.of(json.loads(self.mapping.read_bytes()))
            except (InvalidMapping, UnicodeDecodeError, json.JSONDecodeError) as error:
                raise Unusable(f"{self.mapping}: {error}") from error
        if HAND not in capture.tracks:
            raise Unusable(
                f"no track is called {HAND!r}: say which one is by --mapping; "
                "`gesta inspect FILE --write mapping.json` proposes one"
            )
        return TrackMapping((HAND,), {name: (name,) for name in capture.tracks if name != HAND})

    def _labels(self, path: Path, capture: Capture) -> Sequence[Label]:
        from app.formats.labels import read_labels  # noqa: PLC0415 (not for a request body)

        beside = (path.with_name(path.stem + end) for end in LABELS)
        found = self.labels or next((each for each in beside if each.is_file()), None)
        return capture.labels if found is None else read_labels(found.read_bytes(), capture)


def read_body(path: Path) -> Recorded:
    """Return the recording in a request: ``{"geometry", "scene"?, "trajectory"}``, or labelled, with
    ``{"trajectory", "segments"}`` as ``recording``. Raises Unusable.
    """
    try:
        body = json.loads(path.read_bytes())
    except ValueError as error:
        raise Unusable(f"no JSON: {error}") from error
    recording = body.get("recording", body) if isinstance(body, dict) else None
    if not isinstance(recording, dict) or "geometry" not in body or "trajectory" not in recording:
        raise Unusable("needs the fields geometry and trajectory")
    return Recorded(
        recording["trajectory"], body["geometry"], body.get("scene"), recording.get("segments", ())
    )
