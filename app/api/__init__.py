"""The wire: REST, WebSocket, server-sent events, errors."""
