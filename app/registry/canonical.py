"""Canonical JSON: one value, one text, so that a hash of the text is a hash of the value.

Keys are sorted, nothing is padded, numbers are written as Python's ``repr`` does, which reads back exactly;
nothing non-finite is written or read.
"""

from __future__ import annotations

import json
import math
from dataclasses import fields, is_dataclass
from typing import Any, NoReturn, get_args, get_origin, get_type_hints

import numpy as np

from app.motion.trajectory import Floats
from app.registry.errors import ArtifactInvalid

AXES_AT_MOST = 2
"""Arrays have no more axes than this."""


def write(value: Any) -> bytes:
    """Return the canonical JSON of plain JSON data. Raises ValueError for a number that is not finite."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return text.encode("ascii")


def read(data: bytes, format_: str, version: int) -> dict[str, Any]:
    """Return the JSON object in the bytes without its format fields. Raises ArtifactInvalid."""
    try:
        found = json.loads(data.decode(), object_pairs_hook=_unique, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise ArtifactInvalid("", f"not JSON: {error}") from error
    if not isinstance(found, dict):
        raise ArtifactInvalid("", "not a JSON object")
    for field, wanted in (("format", format_), ("format_version", version)):
        given = found.pop(field, None)
        if type(given) is not type(wanted) or given != wanted:
            raise ArtifactInvalid(field, f"must be {wanted!r}")
    return found


def plain(value: Any) -> Any:
    """Return a dataclass of str, int, float, arrays, tuples and dataclasses as plain JSON data."""
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    return value


def build(type_: Any, value: Any, place: str = "") -> Any:
    """Return the dataclass that ``plain`` made plain data of. Raises ArtifactInvalid, naming the place."""
    check_keys(value, {field.name for field in fields(type_)}, place)
    hints = get_type_hints(type_)
    prefix = f"{place}." if place else ""
    return type_(**{name: _field(hints[name], item, f"{prefix}{name}") for name, item in value.items()})


def check_keys(value: Any, wanted: set[str], place: str) -> None:
    """Raise ArtifactInvalid unless the value is an object with these keys and no others."""
    if not isinstance(value, dict):
        raise ArtifactInvalid(place, "must be an object")
    prefix = f"{place}." if place else ""
    for name in sorted(wanted - value.keys()):
        raise ArtifactInvalid(f"{prefix}{name}", "is missing")
    for name in sorted(value.keys() - wanted):
        raise ArtifactInvalid(f"{prefix}{name}", "is not known")


def number(value: Any, place: str) -> float:
    """Return a finite number. Raises ArtifactInvalid."""
    if type(value) not in (int, float):
        raise ArtifactInvalid(place, "must be a number")
    try:
        found = float(value)
    except OverflowError:
        found = math.inf
    if not math.isfinite(found):
        raise ArtifactInvalid(place, "must be finite")
    return found


def string(value: Any, place: str) -> str:
    """Return a string. Raises ArtifactInvalid."""
    if not isinstance(value, str):
        raise ArtifactInvalid(place, "must be a string")
    return value


def _field(type_: Any, value: Any, place: str) -> Any:
    if type_ is str:
        return string(value, place)
    if type_ is float:
        return number(value, place)
    if type_ is int:
        if type(value) is not int:
            raise ArtifactInvalid(place, "must be a whole number")
        return value
    if get_origin(type_) is np.ndarray:
        return _array(value, place)
    if get_origin(type_) is tuple:
        if not isinstance(value, list):
            raise ArtifactInvalid(place, "must be a list")
        return tuple(_field(get_args(type_)[0], item, f"{place}[{at}]") for at, item in enumerate(value))
    return build(type_, value, place)


def _array(value: Any, place: str) -> Floats:
    """Return a read-only array of the numbers in nested lists of equal lengths."""
    _check_numbers(value, place, AXES_AT_MOST)
    try:
        array: Floats = np.array(value, dtype=np.float64)
    except ValueError as error:
        raise ArtifactInvalid(place, "must be lists of equal lengths") from error
    array.setflags(write=False)
    return array


def _check_numbers(value: Any, place: str, deep: int) -> None:
    if deep == 0 or not isinstance(value, list):
        number(value, place)
        return
    for at, item in enumerate(value):
        _check_numbers(item, f"{place}[{at}]", deep - 1)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key stands twice in one object")
    return found


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is not a number")
