"""Waiting for what the page shows: ``wait_for_function`` evaluates text, which the page forbids."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from playwright.sync_api import Page

PATIENCE_S = 15.0


def until(page: Page, expression: str) -> Any:
    """Return what an expression says as soon as it is true."""
    deadline = time.monotonic() + PATIENCE_S
    while not (found := page.evaluate(expression)):
        assert time.monotonic() < deadline, f"it never came true: {expression}"
        page.wait_for_timeout(40)
    return found
