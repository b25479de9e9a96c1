"""The store: artifacts and demonstrations by content, in a local directory.

What ``put`` acknowledged is on the disk; what ``get`` returns is what was put, or an error.
"""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from pathlib import Path

from app.registry.errors import ArtifactAltered, ArtifactMissing, InvalidUrl

_DIGEST = re.compile(r"sha256:([0-9a-f]{64})")


def digest_of(data: bytes) -> str:
    """Return the digest by which the store knows the bytes."""
    return f"sha256:{hashlib.sha256(data).hexdigest()}"


class Store:
    """A directory of files named by the hash of their content, ``ab/cdef…``. Raises InvalidUrl."""

    def __init__(self, url: str | Path) -> None:
        if "://" in str(url):
            scheme = str(url).partition("://")[0]
            raise InvalidUrl(f"the store needs the path of a directory; {scheme}:// is not supported")
        self.root = Path(url)

    def put(self, data: bytes) -> str:
        """Keep the bytes for good and return their digest."""
        digest = digest_of(data)
        path = self._path(digest)
        folder = path.parent
        if not folder.is_dir():
            folder.mkdir(parents=True, exist_ok=True)
            _sync(self.root.parent)
            _sync(self.root)
        if not path.is_file() or path.read_bytes() != data:
            _replace(path, data)
        _sync(folder)
        return digest

    def get(self, digest: str) -> bytes:
        """Return the bytes of a digest. Raises ArtifactMissing, ArtifactAltered."""
        try:
            data = self._path(digest).read_bytes()
        except FileNotFoundError:
            raise ArtifactMissing(digest) from None
        if digest_of(data) != digest:
            raise ArtifactAltered(digest)
        return data

    def ping(self) -> None:
        """Raise OSError if nothing can be written."""
        self.root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=self.root) as file:
            file.write(b"\0")

    def _path(self, digest: str) -> Path:
        found = _DIGEST.fullmatch(digest)
        if found is None:
            raise ArtifactMissing(digest)
        return self.root / found[1][:2] / found[1][2:]


def _replace(path: Path, data: bytes) -> None:
    """Write the file so that at every moment it is whole or not there."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".new-")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _sync(folder: Path) -> None:
    """Make the names in a folder durable."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
