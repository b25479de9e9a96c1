"""``gesta segment``: an archive of recordings, each a job, over every worker of a server.

The same command a second time does nothing twice: a job is known by model version and content. Files are
read by their kind (``READERS``) into the body of a request; the rest does not know where it came from.

::

    Unusable    a file that holds no recording, or an archive without any; says which and why
"""

from __future__ import annotations

import csv
import hashlib
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Protocol

import httpx
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from app.client import ApiError, GestaClient, GestaError, Message

AT_ONCE = 8
"""Requests under way at most; what is asked for waits in the server's queue."""
PATIENCE_S, PAUSE_S = 60.0, 0.5
"""How long a request is tried where the server is away, and the pause between two attempts [s]."""
DONE_IN_VAIN = ("failed", "cancelled")

AXES = ("x", "y", "z")
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


class Unusable(Exception):
    """A file that holds no recording, or an archive without any."""


def read_json(path: Path, _: Mapping[str, str]) -> Message:
    """Return the request in a file: ``{"geometry", "scene"?, "trajectory"}``. Raises Unusable."""
    try:
        body = json.loads(path.read_bytes())
    except ValueError as error:
        raise Unusable(f"no JSON: {error}") from error
    if not isinstance(body, dict) or not {"geometry", "trajectory"} <= body.keys():
        raise Unusable("needs the fields geometry and trajectory")
    return body


def read_csv(path: Path, geometry: Mapping[str, str]) -> Message:
    """Return the request for a table ``t,hand.x,hand.y,hand.z,NAME.x,…`` in this geometry. Raises Unusable.

    A position with an empty cell is a dropout.
    """
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = csv.reader(file)
        names = [name.strip() for name in next(rows, [])]
        tracks = _tracks(names)
        table = [_numbers(row, names, rows.line_num) for row in rows if row]
    at = {name: column for column, name in enumerate(names)}
    motion = {
        track: [_position([row[at[f"{track}.{axis}"]] for axis in AXES]) for row in table] for track in tracks
    }
    times = [row[at["t"]] for row in table]
    if None in times:
        raise Unusable(f"column t is empty in row {times.index(None) + 1}")
    hand = motion.pop("hand")
    return {"geometry": dict(geometry), "trajectory": {"t": times, "hand": hand, "objects": motion}}


READERS: dict[str, Callable[[Path, Mapping[str, str]], Message]] = {".json": read_json, ".csv": read_csv}
"""By the ending of a file's name."""


def _tracks(names: Sequence[str]) -> list[str]:
    """Return what a table tells the positions of, the hand first."""
    tracks = dict.fromkeys(["hand", *(name.rpartition(".")[0] for name in names if name != "t")])
    wanted = ["t", *(f"{track}.{axis}" for track in tracks for axis in AXES)]
    if sorted(names) != sorted(wanted):
        missing, extra = sorted(set(wanted) - set(names)), sorted(set(names) - set(wanted))
        wrong = [f"{what} {', '.join(of)}" for what, of in (("without", missing), ("with", extra)) if of]
        raise Unusable(
            f"columns {' and '.join(wrong) or 'twice'}; needed: t, hand.x, hand.y, hand.z, NAME.x, …"
        )
    return list(tracks)


def _numbers(row: Sequence[str], names: Sequence[str], line: int) -> list[float | None]:
    if len(row) != len(names):
        raise Unusable(f"line {line} has {len(row)} cells, the first line has {len(names)}")
    numbers: list[float | None] = []
    for name, cell in zip(names, row, strict=True):
        try:
            number = float(cell) if cell.strip() else math.nan
        except ValueError:
            raise Unusable(f"line {line}: {name} is {cell!r}, no number") from None
        if math.isinf(number):
            raise Unusable(f"line {line}: {name} is not finite")
        numbers.append(None if math.isnan(number) else number)
    return numbers


def _position(cells: list[float | None]) -> list[float | None] | None:
    return None if None in cells else cells


def recordings(paths: Sequence[Path], but: Path | None = None) -> list[Path]:
    """Return these files, and those of a known kind in and under these directories. Raises Unusable."""
    found: dict[Path, None] = {}
    for path in paths:
        if path.is_dir():
            inside = (each for each in path.rglob("*") if each.suffix.lower() in READERS and each.is_file())
            found |= dict.fromkeys(sorted(inside))
        elif path.is_file():
            found[path] = None
        else:
            raise Unusable(f"{path}: there is no such file or directory")
    listed = [path for path in found if but is None or path.resolve() != but.resolve()]
    if not listed:
        raise Unusable(f"no recordings ({', '.join(READERS)}) in {', '.join(map(str, paths))}")
    return listed


@dataclass(frozen=True)
class Archive:
    """Whom to ask, for which version, and what the numbers of tables mean."""

    client: GestaClient
    model: str
    version: int
    geometry: Mapping[str, str]

    def submit(self, path: Path) -> str:
        """Ask for the segments of a file and return the job. Raises Unusable, OSError, what clients raise."""
        read = READERS.get(path.suffix.lower())
        if read is None:
            raise Unusable(f"is not of a known kind ({', '.join(READERS)})")
        body = read(path, self.geometry)
        key = _key(self.version, body)
        while (job := self._ask(body, key))["state"] in DONE_IN_VAIN:  # by an earlier command
            key = _key(key, job["id"])
        return str(job["id"])

    def _ask(self, body: Message, key: str) -> Message:
        fields = {name: value for name, value in body.items() if name != "trajectory"}
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                return self.client.segment(
                    self.model,
                    self.version,
                    body["trajectory"],
                    as_job=True,
                    idempotency_key=key,
                    **fields,
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
                    except (Unusable, OSError, GestaError, httpx.HTTPError) as error:
                        yield path, error
            finally:
                pool.shutdown(cancel_futures=True)


def _key(*of: Any) -> str:
    return f"archive-{hashlib.sha256(json.dumps(of, sort_keys=True).encode()).hexdigest()}"


class Writer(Protocol):
    """Writes the segments of a recording."""

    def __call__(self, path: Path, result: Message) -> None:
        """Write them."""


def lines(file: IO[str]) -> Writer:
    """Return what writes JSON lines: a recording each, with its segments."""

    def write(path: Path, result: Message) -> None:
        file.write(json.dumps({"recording": str(path), **result}) + "\n")

    return write


def table(file: IO[str]) -> Writer:
    """Return what writes a table: a segment a row, its objects as ``role=name``."""
    rows = csv.DictWriter(file, COLUMNS, extrasaction="ignore", lineterminator="\n")
    rows.writeheader()

    def write(path: Path, result: Message) -> None:
        for segment in result["segments"]:
            objects = " ".join(f"{role}={name}" for role, name in segment["objects"].items())
            rows.writerow({"recording": str(path), **segment, "objects": objects})

    return write


@contextmanager
def _writing(output: Path | None) -> Iterator[Writer]:
    if output is None:
        yield lines(typer.get_text_stream("stdout"))
        return
    with output.open("w", newline="", encoding="utf-8") as file:
        yield (table if output.suffix.lower() == ".csv" else lines)(file)


def segment(
    paths: Sequence[Path],
    model: str,
    version: str | None,
    url: str,
    output: Path | None,
    geometry: Mapping[str, str],
) -> None:
    """Have all recordings segmented and write what was found; exit with 1 where any failed."""
    console = Console(stderr=True, highlight=False)
    try:
        listed = recordings(paths, but=output)
        with GestaClient(url) as client, _writing(output) as write:
            archive = Archive(client, model, _number(client, model, version), geometry)
            n_failed = _run(archive, listed, write, console)
    except (Unusable, GestaError, OSError) as error:
        console.print(str(error), style="red", markup=False, soft_wrap=True)
        raise typer.Exit(1) from error
    except httpx.HTTPError as error:
        console.print(f"{url} does not answer: {error}", style="red", markup=False, soft_wrap=True)
        raise typer.Exit(1) from error
    if n_failed:
        console.print(f"{n_failed} of {len(listed)} recordings failed", style="red")
        raise typer.Exit(1)


def _number(client: GestaClient, model: str, ref: str | None) -> int:
    """Return the number of a version, which does not move under the way; None: as for a stream."""
    try:
        return int(client.version(model, ref or "production")["version"])
    except ApiError as error:
        if ref is not None or error.code != "version_not_found":
            raise
        return int(client.version(model, "latest")["version"])


def _run(archive: Archive, paths: Sequence[Path], write: Writer, console: Console) -> int:
    """Show how far it is; return how many failed."""
    n_failed = 0
    columns: tuple[Any, ...] = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console) as progress:
        task = progress.add_task("Segmenting", total=len(paths))
        for path, found in archive.segments(paths):
            if isinstance(found, Exception):
                n_failed += 1
                console.print(f"{path}: {found}", style="red", markup=False, soft_wrap=True)
            else:
                write(path, found)
            progress.advance(task)
    return n_failed
