"""Objects in a bucket that speaks S3; loaded only where the store is one.

Credentials, endpoint and region are those of the usual variables (``AWS_ACCESS_KEY_ID``, ``AWS_REGION``,
``AWS_ENDPOINT_URL``, …), which the library reads itself. It tries again what may be tried again.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta

import obstore
from obstore.exceptions import BaseError
from obstore.store import S3Store

from app.registry.errors import InvalidUrl
from app.registry.objects import Item

PATIENCE = timedelta(seconds=20)
"""For how long after its first failure a request is tried again."""


class Bucket:
    """Objects under a prefix of a bucket; see ``Objects``. Raises InvalidUrl if the variables are wrong."""

    def __init__(self, bucket: str, prefix: str) -> None:
        try:
            self._store = S3Store(
                bucket, prefix=prefix or None, retry_config={"max_retries": 4, "retry_timeout": PATIENCE}
            )
        except BaseError as error:
            raise InvalidUrl(f"the store cannot use its AWS_… variables: {_first_line(error)}") from error

    def read(self, key: str) -> bytes:
        """Return the bytes. Raises FileNotFoundError."""
        with _as_os_errors():
            return obstore.get(self._store, key).bytes().to_bytes()

    def write(self, key: str, data: bytes) -> None:
        """Put the object in one request: nothing is left of one that is broken off."""
        with _as_os_errors():
            obstore.put(self._store, key, data, use_multipart=False)

    def move(self, key: str, to: str) -> None:
        """Copy, then delete. Raises FileNotFoundError."""
        with _as_os_errors():
            obstore.copy(self._store, key, to)
            obstore.delete(self._store, key)

    def remove(self, key: str) -> None:
        """Delete an object, or nothing."""
        with _as_os_errors():
            obstore.delete(self._store, key)

    def items(self) -> Iterator[Item]:
        """Yield all objects."""
        with _as_os_errors():
            for page in obstore.list(self._store):
                for found in page:
                    yield Item(found["path"], found["size"], found["last_modified"])

    def clear(self, before: datetime) -> None:
        """Do nothing: see ``write``."""

    def ping(self) -> None:
        """Raise OSError if it does not answer."""
        with _as_os_errors():
            next(obstore.list(self._store, chunk_size=1), None)


@contextmanager
def _as_os_errors() -> Iterator[None]:
    """Let an error be an OSError, and only a missing object a FileNotFoundError."""
    try:
        yield
    except FileNotFoundError as error:
        if "NoSuchBucket" in str(error):
            raise OSError("there is no such bucket") from error
        raise
    except BaseError as error:
        raise OSError(_first_line(error)) from error


def _first_line(error: BaseError) -> str:
    return str(error).partition("\n")[0]
