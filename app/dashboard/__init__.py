"""The page: static files that use the public API like any other client. ``/`` is it, its parts lie beside.

No script and no style stands in the HTML itself, and nothing comes from elsewhere: the browser is told so.
"""

from __future__ import annotations

import os
from pathlib import Path

from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

STATIC = Path(__file__).with_name("static")

POLICY = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data: blob:; object-src 'none'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
ASK_ANEW = "no-cache"
KEEP = "public, max-age=31536000, immutable"
"""For the libraries: their names carry their versions."""


class Parts(StaticFiles):
    """The files of the page, each with an ETag; those of our own are asked for anew every time."""

    def file_response(
        self,
        full_path: str | os.PathLike[str],
        stat_result: os.stat_result,
        scope: Scope,
        status_code: int = 200,
    ) -> Response:
        """Say how long a file may be kept, also where it has not changed."""
        response = super().file_response(full_path, stat_result, scope, status_code)
        of_others = Path(full_path).parent.name == "vendor"
        response.headers["Cache-Control"] = KEEP if of_others else ASK_ANEW
        response.headers["X-Content-Type-Options"] = "nosniff"
        return response


async def _page(_: Request) -> FileResponse:
    return FileResponse(STATIC / "index.html", headers={"Cache-Control": ASK_ANEW, **POLICY})


def routes() -> list[BaseRoute]:
    """Return the page and its parts; they are no part of the API and of its OpenAPI document."""
    return [
        Route("/", _page, name="page", include_in_schema=False),
        Mount("/static", Parts(directory=STATIC), name="static"),
    ]
