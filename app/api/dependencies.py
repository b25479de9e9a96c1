"""What endpoints are given."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request

from app.service.lab import Lab
from app.service.live import LiveSessions


def _lab(request: Request) -> Lab:
    lab: Lab = request.app.state.lab
    return lab


def _live(request: Request) -> LiveSessions:
    live: LiveSessions = request.app.state.live
    return live


LabOf = Annotated[Lab, Depends(_lab)]
LiveOf = Annotated[LiveSessions, Depends(_live)]
