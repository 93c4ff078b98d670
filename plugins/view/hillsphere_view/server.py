"""The server: one socket of this machine, and time limits for clients that are slow."""

from __future__ import annotations

import asyncio
import os
import socket
from typing import TYPE_CHECKING, Any

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from hillsphere.base.errors import InputError

if TYPE_CHECKING:
    from starlette.types import ASGIApp

__all__ = ["listen", "serve"]

HEAD_S = 5.0
"""Time for the head of a request; as much again is left for its body."""
WRITE_S = 10.0
"""Time for which a client may leave what it was sent unread."""
CONNECTIONS = 64
"""Connections at a time; a browser opens six."""
_END_S = 1
"""Time that requests have to end after Ctrl-C, before the server ends."""


class TimedProtocol(H11Protocol):
    """HTTP/1.1 with limits on the time that a client takes to send and to read.

    uvicorn limits only the time between two requests.
    """

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for the first request."""
        super().connection_made(transport)
        self._head = _Deadline(HEAD_S, transport)
        self._write = _Deadline(WRITE_S, transport)
        self._head.begin()

    def data_received(self, data: bytes) -> None:
        """Take data; the time for a head is not prolonged by its single bytes."""
        super().data_received(data)
        if self.conn.their_state is h11.IDLE:
            self._head.begin()
        else:
            self._head.end()

    def on_response_complete(self) -> None:
        """End a response; a body that was not wanted is not waited for."""
        super().on_response_complete()
        if self.conn.their_state is h11.SEND_BODY:
            self.transport.close()

    def pause_writing(self) -> None:
        """Begin to wait for a client that does not read."""
        super().pause_writing()
        self._write.begin()

    def resume_writing(self) -> None:
        """Go on, since the client has read."""
        super().resume_writing()
        self._write.end()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the deadlines."""
        super().connection_lost(exc)
        self._head.end()
        self._write.end()


class _Deadline:
    """A time after which a connection is cut off."""

    def __init__(self, seconds: float, transport: asyncio.Transport) -> None:
        self._seconds, self._transport = seconds, transport
        self._timer: asyncio.TimerHandle | None = None

    def begin(self) -> None:
        """Begin the time, unless it has begun."""
        if self._timer is None:
            loop = asyncio.get_running_loop()
            self._timer = loop.call_later(self._seconds, self._transport.abort)

    def end(self) -> None:
        """Forget the time."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def listen(port: int) -> socket.socket:
    """Return a socket that listens on 127.0.0.1 only.

    Parameters
    ----------
    port : int
        The port; 0 for a free one.

    Raises
    ------
    InputError
        If the port cannot be used.
    """
    made = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        if os.name == "posix":
            # A port is free again at once after its server has ended.
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(("127.0.0.1", port))
        made.listen(CONNECTIONS)
    except OSError as error:
        made.close()
        raise InputError(
            f"port {port} cannot be used: {error.strerror or error}; choose another with --port"
        ) from error
    return made


def serve(app: ASGIApp, listening: socket.socket) -> None:
    """Serve an application until a signal ends the process.

    Parameters
    ----------
    app : ASGI application
        What answers.
    listening : socket
        From `listen`.
    """
    server_of(app).run(sockets=[listening])


def server_of(app: ASGIApp) -> uvicorn.Server:
    """Return the server of an application."""
    # An error of a page is answered with status 500 and its message, not written to the terminal.
    level = "error" if os.environ.get("HILLSPHERE_TRACEBACK") == "1" else "critical"
    choices: dict[str, Any] = {
        "http": TimedProtocol, "ws": "none", "lifespan": "off", "loop": "asyncio",
        "log_level": level, "access_log": False, "server_header": False, "proxy_headers": False,
        "limit_concurrency": CONNECTIONS, "timeout_keep_alive": 5,
        "timeout_graceful_shutdown": _END_S,
    }  # fmt: skip
    return uvicorn.Server(uvicorn.Config(app, **choices))
