"""The store: content by hash, checked on each load, whole or not there."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.registry.errors import ArtifactAltered, ArtifactMissing, InvalidUrl
from app.registry.store import Store, digest_of


def files(store: Store) -> list[Path]:
    return [path for path in store.root.rglob("*") if path.is_file()]


@given(data=st.binary(max_size=200))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25, deadline=None)
def test_what_was_put_is_got(store: Store, data: bytes) -> None:
    digest = store.put(data)
    assert digest == digest_of(data)
    assert store.get(digest) == data


def test_the_same_content_is_kept_once(store: Store) -> None:
    with ThreadPoolExecutor(4) as pool:
        assert len(set(pool.map(store.put, [b"content"] * 8))) == 1
    assert len(files(store)) == 1


def test_an_altered_artifact_is_named_and_a_new_put_heals_it(store: Store) -> None:
    digest = store.put(b"content")
    files(store)[0].write_bytes(b"Content")
    with pytest.raises(ArtifactAltered, match=digest):
        store.get(digest)
    store.put(b"content")
    assert store.get(digest) == b"content"


def test_a_missing_artifact_is_named(store: Store) -> None:
    digest = digest_of(b"never put")
    with pytest.raises(ArtifactMissing, match=digest):
        store.get(digest)


@pytest.mark.parametrize("digest", ["", "sha256:../../etc/passwd", "md5:00", "sha256:" + "A" * 64])
def test_what_is_no_digest_is_missing(store: Store, digest: str) -> None:
    with pytest.raises(ArtifactMissing):
        store.get(digest)


def test_a_put_that_fails_leaves_no_file(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    store.put(b"content")

    def full(_handle: int) -> None:
        raise OSError(28, "no space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", full)
        with pytest.raises(OSError, match="no space"):
            store.put(b"other content")
    assert len(files(store)) == 1


def test_ping_tells_whether_it_can_be_written(store: Store, tmp_path: Path) -> None:
    store.ping()
    assert files(store) == []
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"):
        Store(tmp_path / "file").ping()


def test_a_bucket_is_refused_by_its_kind() -> None:
    with pytest.raises(InvalidUrl, match="s3:// is not supported") as raised:
        Store("s3://key:hidden@bucket/models")
    assert "hidden" not in str(raised.value)
