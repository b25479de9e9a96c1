"""What every sample of the field's formats gives: read, by what was said of it, or refused with the reason.

python benchmarks/importers.py [--data DIR] [--output PAGE]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.formats.capture import Capture, Declared
from app.formats.errors import FormatError, UndeclaredGeometry
from app.formats.isolation import read_apart
from app.formats.proposal import propose
from app.formats.reading import FORMATS
from benchmarks import page
from benchmarks.folders import SHARED

DOCUMENTS = (".md", ".txt")
"""Ends of the names of files that are no samples."""

INTRODUCTION = f"""\
Formats that are read: {", ".join(format_.title for format_ in FORMATS)}. Each sample was read by a process of
its own, as an upload is. *Declared*: what had to be said of it, as the file does not: the length unit, the
axis that is up. *Gaps*: frames in which a track is missing, of all tracks together. *Proposed*: what
`gesta inspect` takes for the hand, and for objects."""

COLUMNS = ("sample", "format", "declared", "proposed", "notes, or why it is refused")
FIGURES = ("tracks", "frames", "rate [Hz]", "gaps", "time [s]")


def samples(data: Path) -> Iterator[Path]:
    """Yield every sample, and a recording of each kind that people made."""
    yield from sorted(
        path for path in (data / "importers").rglob("*") if path.is_file() and path.suffix not in DOCUMENTS
    )
    yield from sorted((data / "vmci_pick_place" / "raw").glob("*_run1.tsv"))
    yield from sorted((data / "vmci_pick_place" / "sequences").glob("*_run1.csv"))


def row(path: Path, data: Path) -> list[str]:
    """Return what is told of a sample."""
    name, declared, begin = str(path.relative_to(data)), Declared(), time.monotonic()
    while True:
        try:
            capture = read_apart(path, declared)
        except UndeclaredGeometry as error:
            declared = Declared(
                declared.length_unit or ("m" if error.field == "length_unit" else None),
                declared.up_axis or ("z" if error.field == "up_axis" else None),
            )
        except FormatError as error:
            return [f"`{name}`", "refused", "", "", f"{error}".replace("|", "/"), *[""] * len(FIGURES)]
        else:
            seconds = time.monotonic() - begin
            return [
                f"`{name}`",
                capture.format,
                _said(declared),
                _proposed(capture),
                *_told(capture, seconds),
            ]


def _said(declared: Declared) -> str:
    said = (("length unit", declared.length_unit), ("up", declared.up_axis))
    return ", ".join(name for name, value in said if value) or "nothing"


def _proposed(capture: Capture) -> str:
    try:
        mapping = propose(capture).mapping.as_json()
    except FormatError:
        return "nothing"
    objects = "; ".join(", ".join(names) for names in mapping["objects"].values())
    return f"{', '.join(mapping['hand'])}{f'; {objects}' if objects else ''}"


def _told(capture: Capture, seconds: float) -> list[str]:
    gaps = sum(int(np.isnan(track[:, 0]).sum()) for track in capture.tracks.values())
    rate = f"{1.0 / capture.period:.4g}" if capture.period else ""
    notes = "; ".join(capture.notes).replace("|", "/")
    return [notes, str(len(capture.tracks)), str(len(capture)), rate, str(gaps), f"{seconds:.2f}"]


def main() -> None:
    """Read all, print and write the page."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--data", type=Path, default=SHARED, help="holds the folders of samples")
    options.add_argument("--output", type=Path, help="page to write")
    given = options.parse_args()
    rows = [row(path, given.data) for path in samples(given.data)]
    table = page.table((*COLUMNS, *FIGURES), rows, n_words=len(COLUMNS))
    page.publish(f"{page.heading('Formats', INTRODUCTION)}\n{table}", given.output)


if __name__ == "__main__":
    main()
