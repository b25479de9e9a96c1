"""Motion-capture files: what is in one, and one as demonstrations. A process of its own reads them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from threading import BoundedSemaphore
from typing import Any

from app.formats import mapping as tracks
from app.formats.capture import Capture, Declared, Label, LengthUnit, UpAxis
from app.formats.errors import FormatError, InvalidLabels, InvalidMapping, UndeclaredGeometry
from app.formats.isolation import read_content_apart
from app.formats.labels import read_labels, renamed, segments
from app.formats.proposal import propose
from app.motion.errors import InvalidSegment, InvalidTrajectory
from app.motion.trajectory import Recording, Scene
from app.registry.records import Added
from app.service.errors import ContentRefused, Issue, ReadersBusy
from app.service.lab import Lab
from app.service.uploads import Position, ground, keep_recording, rows_of

AT_A_TIME, PATIENCE_S = 2, 5.0
"""Files that are read at a time, each with memory of its own; how long another waits for its turn [s]."""

_turns = BoundedSemaphore(AT_A_TIME)


@dataclass(frozen=True)
class SentFile:
    """A motion-capture file as sent: its content, its name, and what is said of its numbers."""

    content: bytes
    name: str
    declared: Declared


@dataclass(frozen=True)
class Captured:
    """What is in a file, ready to be told; proposal: a mapping, None where the names suggest none."""

    format: str
    rate: float | None
    times: list[float]
    tracks: dict[str, list[Position | None]]
    labels: Sequence[Label]
    proposal: dict[str, Any] | None
    reasons: list[str]
    notes: list[str]


def declared(length_unit: LengthUnit | None, up_axis: UpAxis | None) -> Declared:
    """Return what the sender says of a file's numbers, None where that is left to the file."""
    return Declared(length_unit, up_axis)


def look(sent: SentFile) -> Captured:
    """Return what is in a file, and what its names suggest. Raises ContentRefused, ReadersBusy."""
    with _refusing():
        capture = _read(sent)
    try:
        mapping, reasons = propose(capture)
        proposal = mapping.as_json()
    except InvalidMapping as error:
        proposal, reasons = None, (str(error),)
    return Captured(
        format=capture.format,
        rate=capture.rate,
        times=capture.times.tolist(),
        tracks={name: rows_of(track) for name, track in capture.tracks.items()},
        labels=capture.labels,
        proposal=proposal,
        reasons=list(reasons),
        notes=list(capture.notes),
    )


@dataclass(frozen=True)
class SentLabels:
    """What a file shows, as sent: its tracks' mapping in JSON; the content of a file of labels, in JSON or
    CSV, None for those in the file itself; the action classes of labels in JSON, None where they are ones.
    """

    mapping: str
    labels: bytes | None
    actions: str | None


def add(lab: Lab, model: str, sent: SentFile, shown: SentLabels, scene: Scene | None) -> Added:
    """Add the labelled segments of a file, all or none, and keep the recording they are from.

    Raises NotFound, ContentRefused, ReadersBusy.
    """
    specification, chosen = ground(lab, model, scene)
    with _refusing():
        capture = _read(sent)
        trajectory = tracks.trajectory(capture, tracks.TrackMapping.of(_parsed(shown.mapping)))
        labels = capture.labels if shown.labels is None else read_labels(shown.labels, capture)
        found = segments(labels if shown.actions is None else _named(labels, shown.actions), trajectory)
        recording = Recording(trajectory, found, chosen)
    if not found:
        raise ContentRefused([Issue("/segments", "invalid_labels", "there are no labels to learn from")])
    pointers = [f"/segments/{index}" for index in range(len(found))]
    return keep_recording(lab, model, recording, specification, pointers)


def _read(sent: SentFile) -> Capture:
    if not _turns.acquire(timeout=PATIENCE_S):
        raise ReadersBusy
    try:
        return read_content_apart(sent.content, sent.name, sent.declared)
    finally:
        _turns.release()


def _named(labels: Sequence[Label], actions: str) -> Sequence[Label]:
    """Return the labels that have an action class, by its name. Raises ContentRefused."""
    try:
        named = _parsed(actions)
    except InvalidMapping as error:
        raise ContentRefused([Issue("/actions", "invalid_actions", str(error))]) from error
    if not isinstance(named, dict) or not all(isinstance(name, str) for name in named.values()):
        raise ContentRefused([Issue("/actions", "invalid_actions", "needs the form {LABEL: ACTION}")])
    return renamed(labels, named)


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InvalidMapping("", f"is not JSON: {error}") from error


def _place(error: FormatError) -> str:
    match error:
        case UndeclaredGeometry():
            return f"/{error.field}"
        case InvalidMapping():
            return "/mapping"
        case InvalidLabels():
            return "/segments"
    return "/file"


@contextmanager
def _refusing() -> Iterator[None]:
    """Let what a file is refused for be a refusal that names the part of the request."""
    try:
        yield
    except FormatError as error:
        code = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", type(error).__name__).lower()
        raise ContentRefused([Issue(_place(error), code, str(error))]) from error
    except InvalidTrajectory as error:
        raise ContentRefused([Issue("/file", error.code, str(error))]) from error
    except InvalidSegment as error:
        raise ContentRefused([Issue(f"/segments/{error.index}", "invalid_segment", str(error))]) from error
