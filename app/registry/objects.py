"""What the store needs of where its objects are: bytes by key, in a directory or in a bucket."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from typing import NamedTuple, Protocol


class Item(NamedTuple):
    """An object that is there: its size [bytes], and when it was last put there."""

    key: str
    size: int
    since: datetime


class Objects(Protocol):
    """Bytes by key, ``ab/cdef…``; an object is whole or not there. What goes wrong is an OSError."""

    def read(self, key: str) -> bytes:
        """Return the bytes. Raises FileNotFoundError."""

    def write(self, key: str, data: bytes) -> None:
        """Keep the bytes for good, as of now, whatever was there before."""

    def move(self, key: str, to: str) -> None:
        """Give an object another key, as of now; it is never without one. Raises FileNotFoundError."""

    def remove(self, key: str) -> None:
        """Delete an object, or nothing."""

    def items(self) -> Iterator[Item]:
        """Yield all objects, in any order."""

    def clear(self, before: datetime) -> None:
        """Delete what writes that were broken off left behind before then."""

    def ping(self) -> None:
        """Raise OSError if it cannot be used."""
