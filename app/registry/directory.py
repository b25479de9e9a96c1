"""Objects in a local directory: written, fsynced, renamed."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from stat import S_ISREG

from app.registry.objects import Item

NEW = ".new-"
"""How the name of a file begins that is not whole yet."""


class Directory:
    """Objects as files under ``root``; see ``Objects``."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._durable: set[Path] = set()

    def read(self, key: str) -> bytes:
        """Return the bytes. Raises FileNotFoundError."""
        return (self.root / key).read_bytes()

    def write(self, key: str, data: bytes) -> None:
        """Write the file, or only renew its time where it holds these bytes."""
        path = self.root / key
        self._prepare(path.parent)
        if path.is_file() and path.read_bytes() == data:
            os.utime(path)
        else:
            _replace(path, data)
        sync(path.parent)

    def move(self, key: str, to: str) -> None:
        """Renew the time of a file, then rename it. Raises FileNotFoundError."""
        path, target = self.root / key, self.root / to
        os.utime(path)
        self._prepare(target.parent)
        os.replace(path, target)
        sync(target.parent)
        sync(path.parent)

    def remove(self, key: str) -> None:
        """Delete a file, or nothing."""
        (self.root / key).unlink(missing_ok=True)

    def items(self) -> Iterator[Item]:
        """Yield the files that are whole."""
        for path, found in self._files():
            if not path.name.startswith(NEW):
                yield Item(path.relative_to(self.root).as_posix(), found.st_size, _time(found))

    def clear(self, before: datetime) -> None:
        """Delete files that never became whole."""
        for path, found in self._files():
            if path.name.startswith(NEW) and _time(found) < before:
                path.unlink(missing_ok=True)

    def ping(self) -> None:
        """Raise OSError if nothing can be written."""
        self.root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=self.root) as file:
            file.write(b"\0")

    def _prepare(self, folder: Path) -> None:
        """Make a folder whose name is durable, which of one that is there already nobody may have seen to."""
        if folder in self._durable and folder.is_dir():
            return
        folder.mkdir(parents=True, exist_ok=True)
        within = folder
        while within != self.root.parent:
            within = within.parent
            sync(within)
        self._durable.add(folder)

    def _files(self) -> Iterator[tuple[Path, os.stat_result]]:
        """Yield the files; those that go while one looks are left out."""
        for path in self.root.rglob("*"):
            try:
                found = path.stat()
            except FileNotFoundError:
                continue
            if S_ISREG(found.st_mode):
                yield path, found


def _time(found: os.stat_result) -> datetime:
    return datetime.fromtimestamp(found.st_mtime, UTC)


def _replace(path: Path, data: bytes) -> None:
    """Write the file so that at every moment it is whole or not there."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=NEW)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def sync(folder: Path) -> None:
    """Make the names in a folder durable."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
