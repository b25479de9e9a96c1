"""The file of a backup: a tar whose last two members tell what is in it, so that a part of one is none.

::

    registry/…        tables, or the file of the database
    engine/…          likewise, of the job engine
    store/sha256:…    artifacts and demonstrations
    manifest.json     what it is, and every member's digest
    manifest.sha256   that file's digest
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import tarfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any

from app.registry.directory import sync
from app.registry.errors import BackupInvalid

FORMAT = 1
MANIFEST, SEAL = "manifest.json", "manifest.sha256"
PIECE = 1 << 20
"""Bytes that are read at once."""

Json = dict[str, Any]


class BackupWriter:
    """A backup in the making; see ``writing``. ``folder``: for files that go into it."""

    def __init__(self, tar: tarfile.TarFile, folder: Path) -> None:
        self.folder = folder
        self._tar = tar
        self._members: Json = {}

    def add(self, name: str, source: Path | bytes) -> None:
        """Add the content of a file, or bytes."""
        with _opened(source) as (file, size):
            measured = _Measured(file)
            info = tarfile.TarInfo(name)
            info.size, info.mode = size, 0o600
            self._tar.addfile(info, measured)
        self._members[name] = {"size": size, "sha256": measured.digest.hexdigest()}

    def seal(self, told: Mapping[str, Any]) -> None:
        """Add what the backup is; nothing can be added after."""
        manifest = {"gesta_backup": FORMAT, **told, "members": self._members}
        text = json.dumps(manifest, indent=1, sort_keys=True, allow_nan=False).encode()
        self.add(MANIFEST, text)
        self.add(SEAL, f"{hashlib.sha256(text).hexdigest()}  {MANIFEST}\n".encode())


class BackupReader:
    """A whole backup; see ``reading``."""

    def __init__(self, path: str, tar: tarfile.TarFile, manifest: Json) -> None:
        self.manifest = manifest
        self.path = path
        self._tar = tar

    def names(self, beginning: str) -> Iterator[str]:
        """Yield the names of members that begin so, in their order."""
        return (name for name in self._tar.getnames() if name.startswith(beginning))

    def blocks(self, name: str) -> Iterator[bytes]:
        """Yield the content of a member, piece by piece."""
        return _blocks(self._tar, self._tar.getmember(name))

    def extract(self, name: str, to: Path) -> None:
        """Write a member to a file."""
        with to.open("wb") as file:
            for block in self.blocks(name):
                file.write(block)


@contextmanager
def writing(path: Path) -> Iterator[BackupWriter]:
    """Give a backup to write, which gets its name when it is whole and on the disk."""
    with TemporaryDirectory(dir=path.parent, prefix=".backup-") as temporary:
        folder = Path(temporary)
        with (folder / "backup.tar").open("wb") as file:
            with tarfile.open(fileobj=file, mode="w", format=tarfile.PAX_FORMAT) as tar:
                yield BackupWriter(tar, folder)
            file.flush()
            os.fsync(file.fileno())
        os.replace(folder / "backup.tar", path)
        sync(path.parent)


@contextmanager
def reading(path: Path) -> Iterator[BackupReader]:
    """Give a backup that is whole: every byte of it was read. Raises BackupInvalid, OSError."""
    with path.open("rb") as file:
        try:
            tar = tarfile.TarFile(fileobj=file)
        except tarfile.TarError as error:
            raise BackupInvalid(str(path), "is no backup of Gesta") from error
        yield BackupReader(str(path), tar, _checked(tar, str(path)))


def _checked(tar: tarfile.TarFile, path: str) -> Json:
    """Return the manifest of a backup that is what it says. Raises BackupInvalid."""
    try:
        found = {member.name: _measure(tar, member) for member in tar}
        text = b"".join(_blocks(tar, tar.getmember(MANIFEST)))
        seal = b"".join(_blocks(tar, tar.getmember(SEAL)))
    except (tarfile.TarError, KeyError) as error:
        raise BackupInvalid(path, "is cut off, or is no backup of Gesta") from error
    if seal.split() != [hashlib.sha256(text).hexdigest().encode(), MANIFEST.encode()]:
        raise BackupInvalid(path, f"was altered: {MANIFEST}")
    manifest: Json = json.loads(text)
    if manifest["gesta_backup"] != FORMAT:
        raise BackupInvalid(path, f"is of format {manifest['gesta_backup']}, this Gesta restores {FORMAT}")
    del found[MANIFEST], found[SEAL]
    for name in sorted(found.keys() | manifest["members"].keys()):
        if found.get(name) != manifest["members"].get(name):
            raise BackupInvalid(path, f"was altered: {name}")
    return manifest


def _measure(tar: tarfile.TarFile, member: tarfile.TarInfo) -> Json:
    digest = hashlib.sha256()
    for block in _blocks(tar, member):
        digest.update(block)
    return {"size": member.size, "sha256": digest.hexdigest()}


def _blocks(tar: tarfile.TarFile, member: tarfile.TarInfo) -> Iterator[bytes]:
    file = tar.extractfile(member)
    if file is None:
        raise tarfile.TarError(f"{member.name} is no file")
    with file:
        while block := file.read(PIECE):
            yield block


@contextmanager
def _opened(source: Path | bytes) -> Iterator[tuple[IO[bytes], int]]:
    if isinstance(source, bytes):
        yield io.BytesIO(source), len(source)
        return
    with source.open("rb") as file:
        yield file, os.fstat(file.fileno()).st_size


class _Measured:
    """A file whose digest grows as it is read."""

    def __init__(self, file: IO[bytes]) -> None:
        self.digest = hashlib.sha256()
        self._file = file

    def read(self, size: int = -1, /) -> bytes:
        block = self._file.read(size)
        self.digest.update(block)
        return block
