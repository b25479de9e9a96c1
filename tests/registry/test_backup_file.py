"""The file of a backup: what is not whole, byte for byte, is none."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.registry.backup_file import reading, writing
from app.registry.errors import BackupInvalid

CONTENT = {"registry/models": b"a\tb\n" * 1000, "store/sha256:00": b"", "store/sha256:01": b"1" * 700}


@pytest.fixture
def tar(tmp_path: Path) -> Path:
    path = tmp_path / "backup.tar"
    write(path)
    return path


def write(path: Path) -> None:
    with writing(path) as backup:
        for name, content in CONTENT.items():
            backup.add(name, content)
        backup.seal({"revision": "0002"})


def test_what_was_written_is_read(tar: Path, tmp_path: Path) -> None:
    with reading(tar) as backup:
        assert backup.manifest["revision"] == "0002"
        assert {name: b"".join(backup.blocks(name)) for name in CONTENT} == CONTENT
        assert list(backup.names("store/")) == ["store/sha256:00", "store/sha256:01"]
        backup.extract("registry/models", tmp_path / "models")
    assert (tmp_path / "models").read_bytes() == CONTENT["registry/models"]


def test_a_file_cut_off_anywhere_is_refused(tar: Path) -> None:
    whole = tar.read_bytes().rstrip(b"\0")
    for length in range(0, len(whole), 97):
        tar.write_bytes(whole[:length])
        with pytest.raises(BackupInvalid, match=r"(is cut off|is no backup)"), reading(tar):
            pass


def test_a_byte_altered_anywhere_is_refused_or_does_not_matter(tar: Path) -> None:
    whole = tar.read_bytes()
    refused = 0
    for at in range(0, len(whole), 41):
        tar.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        try:
            with reading(tar) as backup:
                assert {name: b"".join(backup.blocks(name)) for name in CONTENT} == CONTENT
        except BackupInvalid:
            refused += 1
    assert refused > sum(map(len, CONTENT.values())) / 41


def test_what_was_altered_is_named(tar: Path) -> None:
    whole = tar.read_bytes()
    tar.write_bytes(whole.replace(b"1" * 700, b"1" * 699 + b"2"))
    with pytest.raises(BackupInvalid, match=r"backup\.tar: was altered: store/sha256:01$"), reading(tar):
        pass
    tar.write_bytes(whole.replace(b'"revision": "0002"', b'"revision": "0001"'))
    with pytest.raises(BackupInvalid, match=r"backup\.tar: was altered: manifest\.json$"), reading(tar):
        pass


def test_a_format_of_the_future_is_refused(tar: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("app.registry.backup_file.FORMAT", 2)
        write(tar)
    with pytest.raises(BackupInvalid, match="is of format 2, this Gesta restores 1"), reading(tar):
        pass


def test_a_backup_that_fails_leaves_the_one_before(tar: Path) -> None:
    before = tar.read_bytes()
    with pytest.raises(FileNotFoundError), writing(tar) as backup:
        backup.add("registry/models", tar.with_name("nowhere"))
    assert tar.read_bytes() == before
    assert list(tar.parent.iterdir()) == [tar]
