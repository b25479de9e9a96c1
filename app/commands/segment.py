"""``gesta segment``: an archive of recordings, each a job, over every worker of a server.

The same command a second time does nothing twice: a job is known by model version and content.
"""

from __future__ import annotations

import csv
import hashlib
import json
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Annotated, Any

import httpx
import typer
from rich.progress import MofNCompleteColumn, Progress

from app.client import ApiError, GestaClient, GestaError, Message
from app.commands.archive import recordings
from app.commands.asking import URL, Url, Version, asking, number_of
from app.commands.recordings import MappingFile, Reading, Recorded, Unit, Up
from app.commands.terminal import AsJson, failure, progress, show_json, show_table, tell
from app.formats.errors import FormatError

AT_ONCE = 8
"""Requests under way at most; what is asked for waits in the server's queue."""
PATIENCE_S, PAUSE_S = 60.0, 0.5
"""How long a request is tried where the server is away, and the pause between two attempts [s]."""
DONE_IN_VAIN = ("failed", "cancelled")

COLUMNS = (
    "recording",
    "segment",
    "action",
    "t_start",
    "t_end",
    "start_seq",
    "end_seq",
    "objects",
    "margin",
    "novelty",
    "model",
    "version",
)
"""Of the table that a ``.csv`` becomes."""
SHOWN = COLUMNS[:5]
"""Of the table that is told."""


def segment(
    paths: Annotated[list[Path], typer.Argument(help="Recordings, or folders of them.")],
    model: Annotated[str, typer.Option(help="Whose actions are to be found.")],
    version: Version = None,
    output: Annotated[
        Path | None, typer.Option(help="File to write: a table if .csv, else a line of JSON a recording.")
    ] = None,
    mapping: MappingFile = None,
    unit: Unit = None,
    up: Up = None,
    as_json: AsJson = False,
    url: Url = URL,
) -> None:
    """Find the actions in recordings: a job each, over every worker. The same again does nothing twice.

    Where some fail they are named, the others are done, and the end is 1.
    """
    with asking(url) as client:
        listed = recordings(paths, output, mapping)
        archive = Archive(client, model, number_of(client, model, version), Reading(unit, up, mapping))
        with ExitStack() as files:
            writer = Writer(None, as_json)
            if output is not None:
                file = files.enter_context(output.open("w", newline="", encoding="utf-8"))
                writer = Writer(file, output.suffix.lower() != ".csv")
            bar = progress("Segmenting", MofNCompleteColumn(), as_json=as_json)
            n_failed = _run(archive, listed, writer, bar)
    if n_failed:
        raise failure(f"{n_failed} of {len(listed)} recordings failed")


@dataclass(frozen=True)
class Archive:
    """Whom to ask, for which version, and how files are read."""

    client: GestaClient
    model: str
    version: int
    reading: Reading

    def submit(self, path: Path) -> str:
        """Ask for the segments of a file; return the job. Raises FormatError, OSError, what clients raise."""
        recorded = self.reading.read(path)
        key = _key(self.version, recorded.ground | {"trajectory": recorded.trajectory})
        while (job := self._ask(recorded, key))["state"] in DONE_IN_VAIN:  # by an earlier command
            key = _key(key, job["id"])
        return str(job["id"])

    def _ask(self, recorded: Recorded, key: str) -> Message:
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                return self.client.segment(
                    self.model,
                    self.version,
                    recorded.trajectory,
                    as_job=True,
                    idempotency_key=key,
                    **recorded.ground,
                )
            except (httpx.TransportError, ApiError) as error:
                refused = isinstance(error, ApiError) and not error.is_passing
                if refused or time.monotonic() > deadline:
                    raise
            time.sleep(PAUSE_S)

    def segments(self, paths: Sequence[Path]) -> Iterator[tuple[Path, Message | Exception]]:
        """Yield each file with the result of its job, or with why there is none."""
        with ThreadPoolExecutor(AT_ONCE) as pool:
            submitted = [pool.submit(self.submit, path) for path in paths]
            try:
                for path, job_id in zip(paths, submitted, strict=True):
                    try:
                        yield path, self.client.result(job_id.result())
                    except (FormatError, OSError, GestaError, httpx.HTTPError) as error:
                        yield path, error
            finally:
                pool.shutdown(cancel_futures=True)


class Writer:
    """Tells what was found in recordings: a line of JSON each, or a row of a table for each segment.

    file: None for standard output, where a table is told at the end.
    """

    def __init__(self, file: IO[str] | None, as_json: bool) -> None:
        self._file, self._as_json = file, as_json
        self._told: list[tuple[Any, ...]] = []
        self._rows = csv.DictWriter(file, COLUMNS, lineterminator="\n") if file else None
        if self._rows and not as_json:
            self._rows.writeheader()

    def write(self, path: Path, result: Message) -> None:
        """Tell the segments of a recording, or keep them for the table."""
        if self._as_json:
            told = {"recording": str(path), **result}
            show_json(told) if self._file is None else self._file.write(json.dumps(told) + "\n")
            return
        for each in result["segments"]:
            objects = " ".join(f"{role}={name}" for role, name in each["objects"].items())
            row = {"recording": str(path), **each, "objects": objects}
            if self._rows:
                self._rows.writerow({column: row[column] for column in COLUMNS})
            else:
                self._told.append(tuple(row[column] for column in SHOWN))

    def finish(self) -> None:
        """Tell the table that was kept."""
        if self._file is None and not self._as_json:
            show_table(SHOWN, *self._told)


def _run(
    archive: Archive, paths: Sequence[Path], writer: Writer, bar: AbstractContextManager[Progress]
) -> int:
    """Show how far it is; return how many failed."""
    n_failed = 0
    with bar as shown:
        [task] = shown.task_ids
        shown.update(task, total=len(paths))
        for path, found in archive.segments(paths):
            if isinstance(found, Exception):
                n_failed += 1
                tell(f"{path}: {found}", "red")
            else:
                writer.write(path, found)
            shown.advance(task)
    writer.finish()
    return n_failed


def _key(*of: Any) -> str:
    return f"archive-{hashlib.sha256(json.dumps(of, sort_keys=True).encode()).hexdigest()}"
