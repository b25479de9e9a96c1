"""The server: wires the rooms together."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from datetime import timedelta
from typing import Any

from fastapi import FastAPI

from app import dashboard
from app.api import (
    captures,
    demonstrations,
    health,
    jobs,
    models,
    openapi,
    problems,
    recognition,
    server,
    sessions,
    stream,
    trajectories,
    versions,
)
from app.api.middleware import BodyLimit, RequestIds
from app.motion.warming import warm_recognition
from app.service.lab import open_lab
from app.service.live import Limits, LiveSessions
from app.service.session_retention import keep_tidy
from app.service.session_store import SessionStore
from app.settings import Settings


def create_app(settings: Settings | None = None, limits: Limits | None = None) -> FastAPI:
    """Return the server; settings: by default those of the environment; limits: of its streams."""
    chosen = settings or Settings()
    app = FastAPI(title="Gesta", lifespan=_lifespan(chosen, limits or Limits()), **openapi.DESCRIPTION)
    rooms = (
        models,
        captures,
        demonstrations,
        versions,
        trajectories,
        recognition,
        jobs,
        sessions,
        stream,
        server,
        health,
    )
    app.include_router(captures.forms)
    for room in rooms:
        app.include_router(room.router)
    app.routes.extend(dashboard.routes())
    problems.install(app)
    app.add_middleware(BodyLimit, most=chosen.max_body_bytes)
    app.add_middleware(RequestIds)
    return app


def _lifespan(
    settings: Settings, limits: Limits
) -> Callable[[FastAPI], AbstractAsyncContextManager[dict[str, Any]]]:
    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[dict[str, Any]]:
        await asyncio.to_thread(warm_recognition)
        lab = await asyncio.to_thread(open_lab, settings.database_url, settings.store_url)
        live = LiveSessions(SessionStore(lab, timedelta(seconds=limits.resume)), limits)
        app.state.lab, app.state.live = lab, live
        tidying = asyncio.create_task(keep_tidy(live, settings.session_retention))
        try:
            yield {"drain": live.drain}
        finally:
            tidying.cancel()
            await live.drain()
            lab.close()

    return lifespan
