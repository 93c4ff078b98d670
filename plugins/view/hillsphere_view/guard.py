"""The gate before every route: who may ask, from which page, how much and for how long.

A page that a browser shows can send requests to any server of this machine, and so can other users
of the machine. A request therefore needs the session's cookie, which the printed address gives,
and must have been made for this server's own name by this server's own page.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from urllib.parse import parse_qs

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["MAX_BODY_BYTES", "Guard", "Session", "page_policy"]

MAX_BODY_BYTES = 64 << 10
"""Largest body of a request: the settings of a run are a few lines."""
BODY_S = 5.0
"""Time for a body after its head, for which the server allows as much: 10 s together."""
_TOKEN_BYTES = 32
"""Random bytes of token and cookie, 256 bits: nobody guesses them."""

_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cache-control", b"no-store"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
)
"""Headers of every response."""
_NOTHING = b"default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
"""Content security policy of a response that has none of its own."""
_ENTRY = (
    '<!doctype html><html lang="en"><meta charset="utf-8"><title>Runs</title>'
    '<meta http-equiv="refresh" content="0;url=/"><p><a href="/">Runs</a></p></html>'
)
"""Answer to the printed address. A redirection would not do: a browser that comes from another
site sends no strict cookie along with it, but does with what a page of this site leads to."""


def page_policy(host: str, *, has_plots: bool) -> str:
    """Return the content security policy of a page.

    Parameters
    ----------
    host : str
        Name and port of this server, as the request has them.
    has_plots : bool
        Whether plotly.js draws on it, which sets styles of elements.
    """
    styles = " 'unsafe-inline'" if has_plots else ""
    return (
        f"default-src 'none'; script-src http://{host}/static/; "
        f"style-src http://{host}/static/{styles}; img-src 'self' data: blob:; "
        "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    )


@dataclass(frozen=True)
class Session:
    """The secrets of one server.

    Parameters
    ----------
    port : int
        Its port.
    token : str
        What the printed address has.
    cookie : str
        What a browser gets for the token.
    """

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(_TOKEN_BYTES), repr=False)
    cookie: str = field(default_factory=lambda: secrets.token_urlsafe(_TOKEN_BYTES), repr=False)

    @property
    def address(self) -> str:
        """Return the address to open."""
        return f"http://127.0.0.1:{self.port}/?token={self.token}"

    @property
    def cookie_name(self) -> str:
        """Return the cookie's name; cookies hold for all ports of a host, hence the port in it."""
        return f"hillsphere-view-{self.port}"

    def hosts(self) -> tuple[str, ...]:
        """Return the names under which the server may be asked."""
        return f"127.0.0.1:{self.port}", f"localhost:{self.port}"

    def has_cookie(self, headers: Iterable[str]) -> bool:
        """Return whether one of the values of ``Cookie`` holds the session's cookie."""
        for header in headers:
            for pair in header.split(";"):
                name, _, value = pair.strip().partition("=")
                if name == self.cookie_name and _is_equal(value, self.cookie):
                    return True
        return False

    def has_token(self, query: bytes) -> bool:
        """Return whether a query string holds the token."""
        try:
            given = parse_qs(query.decode("ascii"), max_num_fields=8).get("token", [])
        except ValueError:
            return False
        return len(given) == 1 and _is_equal(given[0], self.token)


def _is_equal(given: str, secret: str) -> bool:
    return secrets.compare_digest(given.encode("utf-8", "replace"), secret.encode())


class Guard:
    """ASGI application around another, which gets only requests that may be answered.

    Parameters
    ----------
    app : ASGI application
        The pages.
    session : Session
        The secrets.
    """

    def __init__(self, app: ASGIApp, session: Session) -> None:
        self.app = app
        self.session = session

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on with its whole body."""
        if scope["type"] != "http":  # a websocket: closing before accepting is answered with 403
            if scope["type"] == "websocket":
                await send({"type": "websocket.close"})
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = {name for name, _ in message["headers"]}
                extra = [*_HEADERS, (b"content-security-policy", _NOTHING)]
                message["headers"] += [pair for pair in extra if pair[0] not in own]
            await send(message)

        refusal = self._refusal(scope)
        if refusal is not None:
            await _refuse(send_with_headers, *refusal)
            return
        if self._is_entry(scope):
            cookie = (
                f"{self.session.cookie_name}={self.session.cookie}; Path=/; HttpOnly; "
                "SameSite=Strict"
            )
            headers = [(b"content-type", b"text/html; charset=utf-8"),
                       (b"set-cookie", cookie.encode())]  # fmt: skip
            await _answer(send_with_headers, 200, headers, _ENTRY.encode())
            return
        body = await _read_body(scope, receive)
        if isinstance(body, int):
            reason = {413: "the request is too large", 408: "the request took too long"}
            await _refuse(send_with_headers, body, reason.get(body, "bad request"))
            return
        waiting = [body]

        async def receive_body() -> Message:
            if waiting:
                return {"type": "http.request", "body": waiting.pop(), "more_body": False}
            return await receive()

        scope["hillsphere.body"] = body
        await self.app(scope, receive_body, send_with_headers)

    def _is_entry(self, scope: Scope) -> bool:
        return (
            scope["method"] == "GET"
            and scope["path"] == "/"
            and self.session.has_token(scope["query_string"])
        )

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Return status and reason if a request may not be answered."""
        hosts, origins = _values(scope, b"host"), _values(scope, b"origin")
        if len(hosts) != 1 or hosts[0] not in self.session.hosts():
            return 403, "this server is asked under another name"
        if origins not in ([], [f"http://{hosts[0]}"]):
            return 403, "the request comes from another page"
        if scope["method"] not in ("GET", "HEAD") and not origins:
            return 403, "the request does not say which page it comes from"
        if not (self.session.has_cookie(_values(scope, b"cookie")) or self._is_entry(scope)):
            return 403, "open the address that hillsphere view has printed"
        return None


def _values(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key == name]


async def _read_body(scope: Scope, receive: Receive) -> bytes | int:
    """Return the body of a request, or the status of its refusal."""
    for length in _values(scope, b"content-length"):
        if not length.isascii() or not length.isdigit():
            return 400
        if len(length) > 9 or int(length) > MAX_BODY_BYTES:
            return 413
    body = bytearray()
    try:
        async with asyncio.timeout(BODY_S):
            while True:
                message = await receive()
                if message["type"] != "http.request":
                    return 400  # the client has gone; nobody reads the answer
                body += message.get("body", b"")
                if len(body) > MAX_BODY_BYTES:
                    return 413
                if not message.get("more_body", False):
                    return bytes(body)
    except TimeoutError:
        return 408


async def _refuse(send: Send, status: int, reason: str) -> None:
    # The connection is closed, so that what is left of the request is not read.
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")]
    await _answer(send, status, headers, f"{reason}\n".encode())


async def _answer(send: Send, status: int, headers: list[tuple[bytes, bytes]], body: bytes) -> None:
    headers = [*headers, (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
