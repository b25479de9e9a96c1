"""A text file as rows of cells, which says the line where something is wrong."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.formats.capture import Geometry, distinct
from app.formats.errors import Unreadable

if TYPE_CHECKING:
    from app.motion.trajectory import Floats, Indices

AXES = ("x", "y", "z")
WHOLE = 2.0**53
"""Numbers beyond have no whole neighbours."""


def read_text(path: Path) -> str:
    """Return the text of a file: UTF-8 or UTF-16 by its mark, else Latin-1, which takes any byte."""
    content = path.read_bytes()
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


class Sheet:
    """Rows of cells; row i is line i + 1. Raises Unreadable."""

    def __init__(self, text: str, delimiter: str, *, quoted: bool = True) -> None:
        lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        reader = csv.reader(
            lines, delimiter=delimiter, quoting=csv.QUOTE_MINIMAL if quoted else csv.QUOTE_NONE
        )
        try:
            self.rows = [[cell.strip() for cell in row] for row in reader]
        except csv.Error as error:
            raise Unreadable("", f"no table: {error}") from error

    def row(self, index: int) -> list[str]:
        """Return the cells of a row, the trailing empty ones left out; none past the end."""
        cells = self.rows[index] if index < len(self.rows) else []
        stop = len(cells)
        while stop and not cells[stop - 1]:
            stop -= 1
        return cells[:stop]

    def filled(self, first: int) -> list[int]:
        """Return the indices of the rows from ``first`` on in which there is something. Raises Unreadable."""
        return _some([index for index in range(first, len(self.rows)) if any(self.rows[index])])

    def block(self, first: int) -> list[int]:
        """Return the indices of the rows from ``first`` on, up to an empty one. Raises Unreadable."""
        stop = first
        while stop < len(self.rows) and any(self.rows[stop]):
            stop += 1
        return _some(list(range(first, stop)))

    def numbers(self, indices: Sequence[int], columns: Sequence[int]) -> Floats:
        """Return the cells (n_rows, n_columns) as numbers; an empty one is NaN. Raises Unreadable."""
        table = np.empty((len(indices), len(columns)))
        for at, index in enumerate(indices):
            row = self.rows[index]
            try:
                table[at] = [float(row[column] or "nan") for column in columns]
            except (IndexError, ValueError) as error:
                raise self._wrong(index, columns) from error
        return table

    def whole_numbers(self, indices: Sequence[int], column: int) -> Indices:
        """Return a column (n_rows,) of whole numbers. Raises Unreadable."""
        found = self.numbers(indices, [column])[:, 0]
        sound = (found == np.round(found)) & (np.abs(found) < WHOLE)
        if len(bad := np.flatnonzero(~sound)):
            index = indices[bad[0]]
            raise Unreadable(f"line {index + 1}", f"{self.rows[index][column]!r} is no frame number")
        return found.astype(np.int64)

    def number(self, name: str, cell: str) -> float:
        """Return one number of a header by its name. Raises Unreadable."""
        try:
            return float(cell)
        except ValueError as error:
            raise Unreadable(name, f"{cell!r} is no number") from error

    def _wrong(self, index: int, columns: Sequence[int]) -> Unreadable:
        row = self.rows[index]
        if len(row) <= max(columns):
            return Unreadable(f"line {index + 1}", f"has {len(row)} cells, needs {max(columns) + 1}")
        column = next(column for column in columns if not _is_number(row[column] or "nan"))
        return Unreadable(f"line {index + 1}, column {column + 1}", f"{row[column]!r} is no number")


def triples(kinds: Sequence[str], names: Sequence[str]) -> dict[int, str]:
    """Return column -> name of all positions: where x, y, z stand side by side under one name.

    kinds: the axis over each column; names: the name over each column, empty: that of the column before.
    """
    found, name = {}, ""
    for column in range(len(kinds)):
        name = (names[column] if column < len(names) else "") or name
        if name and tuple(kind.casefold() for kind in kinds[column : column + 3]) == AXES:
            found[column] = name
    return found


def positions(
    sheet: Sheet, indices: Sequence[int], found: Mapping[int, str], geometry: Geometry
) -> dict[str, Floats]:
    """Return track -> (n_rows, 3) [m] of rows, by column -> name as of ``triples``. Raises Unreadable."""
    columns = [start + axis for start in found for axis in range(3)]
    metres = geometry.to_metres(sheet.numbers(indices, columns).reshape(len(indices), len(found), 3))
    return {name: metres[:, at] for at, name in enumerate(distinct(list(found.values())))}


def _some(indices: list[int]) -> list[int]:
    if not indices:
        raise Unreadable("", "has no frames")
    return indices


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
