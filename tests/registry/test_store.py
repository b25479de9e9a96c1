"""The store: content by hash, checked on each load, whole or not there; in a directory and in a bucket."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.registry.errors import ArtifactAltered, ArtifactMissing, InvalidUrl, StoreUnavailable
from app.registry.store import Store, digest_of

ROOT = Path(__file__).parents[2]
NOBODY = 65534
WRITE = """
import os, resource, sys
from app.registry.errors import StoreUnavailable
from app.registry.store import Store
os.chdir(sys.argv[1])
{}
store = Store("store")
print(store.get(sys.argv[2]).decode())
try:
    store.put(b"x" * 100_000)
except StoreUnavailable as error:
    print(error.reason)
"""


@pytest.fixture(params=["directory", "bucket"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Store:
    """An empty store, each test runs with one of either kind."""
    if request.param == "directory":
        return Store(tmp_path / "store")
    return Store(request.getfixturevalue("s3_url"))


@pytest.fixture
def directory(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


def key(digest: str) -> str:
    found = digest.removeprefix("sha256:")
    return f"{found[:2]}/{found[2:]}"


def keys(store: Store) -> list[str]:
    return [item.key for item in store.objects.items()]


def files(store: Store) -> list[Path]:
    return [path for path in Path(store.url).rglob("*") if path.is_file()]


@given(data=st.binary(max_size=200))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25, deadline=None)
def test_what_was_put_is_got(store: Store, data: bytes) -> None:
    digest = store.put(data)
    assert digest == digest_of(data)
    assert store.get(digest) == data


def test_the_same_content_is_kept_once(store: Store) -> None:
    with ThreadPoolExecutor(4) as pool:
        assert len(set(pool.map(store.put, [b"content"] * 8))) == 1
    assert keys(store) == [key(digest_of(b"content"))]


def test_an_altered_artifact_is_named_and_a_new_put_heals_it(store: Store) -> None:
    digest = store.put(b"content")
    store.objects.write(key(digest), b"Content")
    with pytest.raises(ArtifactAltered, match=digest):
        store.get(digest)
    with pytest.raises(ArtifactAltered, match=f"version 3 of model 'm': the store's {digest} was altered"):
        store.get(digest, "version 3 of model 'm'")
    store.put(b"content")
    assert store.get(digest) == b"content"


def test_a_missing_artifact_is_named(store: Store) -> None:
    digest = digest_of(b"never put")
    with pytest.raises(ArtifactMissing, match=digest):
        store.get(digest)
    with pytest.raises(ArtifactMissing, match=f"version 3 of model 'm': the store does not hold {digest}"):
        store.get(digest, "version 3 of model 'm'")


@pytest.mark.parametrize("digest", ["", "sha256:../../etc/passwd", "md5:00", "sha256:" + "A" * 64])
def test_what_is_no_digest_is_missing(store: Store, digest: str) -> None:
    with pytest.raises(ArtifactMissing):
        store.get(digest)


def test_what_is_set_aside_is_still_got_and_can_be_brought_back(store: Store) -> None:
    digest = store.put(b"content")
    for _ in range(2):  # the second time there is nothing left to set aside
        store.set_aside(digest)
    assert [(held.digest, held.aside, held.size) for held in store.listing()] == [(digest, True, 7)]
    assert store.get(digest) == b"content"
    store.bring_back(digest)
    assert [(held.digest, held.aside) for held in store.listing()] == [(digest, False)]
    assert store.get(digest) == b"content"


def test_what_is_put_again_outlives_what_was_set_aside(store: Store) -> None:
    digest = store.put(b"content")
    store.set_aside(digest)
    store.put(b"content")
    for _ in range(2):  # the second time there is nothing left to discard
        store.discard(digest)
    assert store.get(digest) == b"content"


def test_what_is_discarded_is_missing(store: Store) -> None:
    digest = store.put(b"content")
    store.set_aside(digest)
    store.discard(digest)
    assert list(store.listing()) == []
    with pytest.raises(ArtifactMissing):
        store.get(digest)


def test_ages_count_from_the_last_put_or_setting_aside(directory: Store) -> None:
    digest = directory.put(b"content")
    long_ago = datetime(2020, 1, 1, tzinfo=UTC)
    for change in (directory.put, lambda _: directory.set_aside(digest)):
        [path] = files(directory)
        os.utime(path, (long_ago.timestamp(), long_ago.timestamp()))
        assert [held.since for held in directory.listing()] == [long_ago]
        change(b"content")
        [held] = directory.listing()
        assert held.since > datetime.now(UTC) - timedelta(minutes=5)


def test_ping_changes_nothing(store: Store) -> None:
    store.ping()
    assert keys(store) == []


def test_what_is_there_cannot_be_used_where_it_is_no_directory(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    store = Store(tmp_path / "file")
    for use in (store.ping, lambda: store.put(b"content"), lambda: store.get(digest_of(b"content"))):
        with pytest.raises(StoreUnavailable):
            use()


def test_a_bucket_that_is_not_there_cannot_be_used(s3_url: str) -> None:
    store = Store("s3://gesta-nowhere/at/all")
    uses = (
        store.ping,
        lambda: list(store.listing()),
        lambda: store.put(b"1"),
        lambda: store.get(digest_of(b"1")),
    )
    for use in uses:
        with pytest.raises(StoreUnavailable):
            use()


def test_an_s3_server_that_is_away_is_no_missing_artifact(
    s3_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    digest = Store(s3_url).put(b"content")
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    away = Store(s3_url)
    for use in (lambda: away.get(digest), lambda: away.put(b"content"), away.ping):
        with pytest.raises(StoreUnavailable):
            use()


def test_variables_that_are_wrong_are_told(s3_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_CHECKSUM_ALGORITHM", "none at all")
    with pytest.raises(InvalidUrl, match="none at all"):
        Store(s3_url)


def test_a_prefix_is_a_store_of_its_own(s3_url: str) -> None:
    digest = Store(s3_url).put(b"content")
    with pytest.raises(ArtifactMissing):
        Store(f"{s3_url}/within").get(digest)


def test_a_put_that_fails_leaves_no_file(directory: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    directory.put(b"content")

    def fails(_handle: int) -> None:
        raise OSError(5, "input/output error")

    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", fails)
        with pytest.raises(StoreUnavailable):
            directory.put(b"other content")
    assert len(files(directory)) == 1


@pytest.mark.parametrize(
    ("limit", "reason"),
    [
        pytest.param(
            "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))", "File too large", id="no more room"
        ),
        pytest.param(f"os.getuid() or os.setuid({NOBODY})", "Permission denied", id="read-only"),
    ],
)
def test_a_store_that_takes_nothing_says_so_and_gives_what_it_has(
    directory: Store, tmp_path: Path, limit: str, reason: str
) -> None:
    digest = directory.put(b"content")
    tmp_path.chmod(0o755)
    Path(directory.url).chmod(0o555)
    files(directory)[0].chmod(0o444)
    ran = subprocess.run(
        [sys.executable, "-c", WRITE.format(limit), str(tmp_path), digest],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert ran.stderr == ""
    told = ran.stdout.splitlines()
    assert told[0] == "content"
    assert reason in told[1]
    assert len(files(directory)) == 1


def test_what_broken_off_writes_left_is_cleared_when_it_is_old(directory: Store) -> None:
    digest = directory.put(b"content")
    left = (Path(directory.url) / key(digest)).with_name(".new-abc")
    left.write_bytes(b"cont")
    assert [held.digest for held in directory.listing()] == [digest]
    directory.clear(datetime.now(UTC) - timedelta(hours=1))
    assert left.exists()
    directory.clear(datetime.now(UTC) + timedelta(hours=1))
    assert not left.exists()
    assert directory.get(digest) == b"content"


@pytest.mark.parametrize(
    "url", ["s3://", "s3://key:hidden@bucket/models", "s3://bucket?key=hidden", "ftp://hidden/x"]
)
def test_a_url_that_is_none_is_refused_without_its_secrets(url: str) -> None:
    with pytest.raises(InvalidUrl, match="s3://BUCKET/PREFIX") as raised:
        Store(url)
    assert "hidden" not in str(raised.value)


def test_a_store_in_a_directory_loads_no_s3() -> None:
    start = "import sys\nfrom app.registry.store import Store\nStore('x')\nprint('obstore' in sys.modules)"
    ran = subprocess.run([sys.executable, "-c", start], cwd=ROOT, capture_output=True, text=True, check=True)
    assert ran.stdout == "False\n"
