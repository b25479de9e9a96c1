"""Python client for Gesta, for asyncio and for plain code; imports nothing else of ``app``."""

from app.client.errors import ApiError, GestaError, JobFailed, StreamError
from app.client.rest import GestaClient
from app.client.stream import AsyncStream, Stream, start_message
from app.client.wire import METRES, Message, trajectory

__all__ = [
    "METRES",
    "ApiError",
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
