"""Python client for Gesta, for asyncio and for plain code; imports nothing else of ``app``."""

from app.client.clients import AsyncGestaClient, GestaClient
from app.client.errors import ApiError, GestaError, JobFailed, StreamError
from app.client.stream import AsyncStream, Stream
from app.client.stream_state import start_message
from app.client.wire import METRES, Message, trajectory

__all__ = [
    "METRES",
    "ApiError",
    "AsyncGestaClient",
    "AsyncStream",
    "GestaClient",
    "GestaError",
    "JobFailed",
    "Message",
    "Stream",
    "StreamError",
    "start_message",
    "trajectory",
]
