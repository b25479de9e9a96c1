"""The store: artifacts and demonstrations by content, in a local directory or in an S3 bucket.

What ``put`` acknowledged is on the disk; what ``get`` returns is what was put, or an error. What a sweep
takes away it first sets aside, where ``get`` still finds it: a ``put`` that found its content there, a moment
before it was taken away, has lost nothing.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from app.registry.directory import Directory
from app.registry.errors import ArtifactAltered, ArtifactMissing, InvalidUrl, StoreUnavailable
from app.registry.objects import Objects

ASIDE = "aside/"
"""How the keys begin of what a sweep has set aside."""

_DIGEST = re.compile(r"sha256:([0-9a-f]{64})")
_KEY = re.compile(r"(aside/)?([0-9a-f]{2})/([0-9a-f]{62})")
_BUCKET = re.compile(r"s3://([a-z0-9][a-z0-9.-]+)(?:/([\w./=-]*))?")


def digest_of(data: bytes) -> str:
    """Return the digest by which the store knows the bytes."""
    return f"sha256:{hashlib.sha256(data).hexdigest()}"


class Held(NamedTuple):
    """Something the store holds: its size [bytes], when it was last put or set aside."""

    digest: str
    size: int
    since: datetime
    aside: bool


class Store:
    """Objects named by the hash of their content, ``ab/cdef…``. Raises InvalidUrl.

    url: the path of a directory, or ``s3://BUCKET/PREFIX``. All methods raise StoreUnavailable.
    """

    def __init__(self, url: str | Path) -> None:
        self.url = str(url)
        self.objects: Objects = _objects(self.url)

    def put(self, data: bytes) -> str:
        """Keep the bytes for good and return their digest; what was altered is whole again."""
        digest = digest_of(data)
        with _available():
            self.objects.write(_key(digest), data)
        return digest

    def get(self, digest: str, of: str = "") -> bytes:
        """Return the bytes of a digest. Raises ArtifactMissing, ArtifactAltered.

        of: what has this digest, such as ``version 3 of model 'table-top'``, for these errors to name it.
        """
        key = _key(digest, of)
        data = self._read(key)
        if data is None:
            data = self._read(f"{ASIDE}{key}")
        if data is None:
            raise ArtifactMissing(digest, of)
        if digest_of(data) != digest:
            raise ArtifactAltered(digest, of)
        return data

    def listing(self) -> Iterator[Held]:
        """Yield all that is held."""
        with _available():
            for item in self.objects.items():
                if found := _KEY.fullmatch(item.key):
                    yield Held(f"sha256:{found[2]}{found[3]}", item.size, item.since, found[1] is not None)

    def set_aside(self, digest: str) -> None:
        """Keep it where only ``get`` finds it; where it is not there any more, do nothing."""
        self._move(_key(digest), f"{ASIDE}{_key(digest)}")

    def bring_back(self, digest: str) -> None:
        """Undo ``set_aside``."""
        self._move(f"{ASIDE}{_key(digest)}", _key(digest))

    def discard(self, digest: str) -> None:
        """Delete what was set aside."""
        with _available():
            self.objects.remove(f"{ASIDE}{_key(digest)}")

    def clear(self, before: datetime) -> None:
        """Delete what writes that were broken off left behind before then."""
        with _available():
            self.objects.clear(before)

    def ping(self) -> None:
        """Raise StoreUnavailable if it cannot be used."""
        with _available():
            self.objects.ping()

    def _read(self, key: str) -> bytes | None:
        with _available():
            try:
                return self.objects.read(key)
            except FileNotFoundError:
                return None

    def _move(self, key: str, to: str) -> None:
        with _available():
            try:
                self.objects.move(key, to)
            except FileNotFoundError:
                return


def _objects(url: str) -> Objects:
    if "://" not in url:
        return Directory(Path(url))
    found = _BUCKET.fullmatch(url)
    if found is None:
        raise InvalidUrl(f"the store needs the path of a directory or s3://BUCKET/PREFIX{_other(url)}")
    from app.registry.bucket import Bucket  # noqa: PLC0415 (a server on a directory needs no S3)

    return Bucket(found[1], found[2] or "")


def _other(url: str) -> str:
    """Say what else the URL is, and nothing of it that may be secret."""
    scheme = url.partition("://")[0]
    return "" if scheme == "s3" else f"; {scheme}:// is not supported"


def _key(digest: str, of: str = "") -> str:
    found = _DIGEST.fullmatch(digest)
    if found is None:
        raise ArtifactMissing(digest, of)
    return f"{found[1][:2]}/{found[1][2:]}"


@contextmanager
def _available() -> Iterator[None]:
    """Say in the registry's words that the store cannot be used."""
    try:
        yield
    except OSError as error:
        raise StoreUnavailable(str(error)) from error
