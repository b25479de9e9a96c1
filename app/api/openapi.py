"""What the served OpenAPI document says of the whole API."""

from __future__ import annotations

from typing import Any

DESCRIPTION: dict[str, Any] = {
    "version": "1.0.0",
    "summary": "Learns actions from demonstrations, recognises them online, re-enacts them.",
    "description": (
        "Positions in answers are in metres, right-handed, Z up; times in seconds. Every upload declares its "
        "`geometry`. Unknown fields in requests are refused. Errors are problems (RFC 9457) with a stable "
        "`code`. Frames are streamed over `GET /v1/stream`, a WebSocket that the AsyncAPI document describes."
    ),
    "license_info": {"name": "Apache-2.0", "identifier": "Apache-2.0"},
    "openapi_url": "/v1/openapi.json",
    "docs_url": None,
    "redoc_url": None,
}
