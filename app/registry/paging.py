"""Listings in pages: a page token names the last record given out, so nothing is skipped or given twice."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from typing import Any

from sqlalchemy import Column, Row, Select
from sqlalchemy.orm import Session

from app.registry.errors import InvalidPageToken
from app.registry.records import Page, Record


def page_of(
    tx: Session,
    query: Select[Any],
    key: Column[Any],
    record: Callable[[Row[Any]], Record],
    *,
    size: int,
    after: str | None,
    newest_first: bool = False,
) -> Page[Record]:
    """Return the ``size`` records of the query that follow the token ``after``, in the order of ``key``.

    ``key`` is unique in the query and among its columns. Raises InvalidPageToken.
    """
    listing = str(key)
    if after is not None:
        last = _read(after, listing, key.type.python_type)
        query = query.where(key < last if newest_first else key > last)
    query = query.order_by(key.desc() if newest_first else key).limit(size + 1)
    rows = tx.execute(query).all()
    more = len(rows) > size
    kept = rows[:size]
    return Page(
        tuple(record(row) for row in kept),
        _token(listing, kept[-1]._mapping[key]) if more else None,
    )


def _token(listing: str, last: str | int) -> str:
    return base64.urlsafe_b64encode(json.dumps([listing, last]).encode()).decode()


def _read(token: str, listing: str, kind: type) -> str | int:
    try:
        found = json.loads(base64.b64decode(token, altchars=b"-_", validate=True))
    except (ValueError, RecursionError):
        raise InvalidPageToken from None
    match found:
        case [str() as of, str() | int() as last] if of == listing and type(last) is kind:
            return last
    raise InvalidPageToken
