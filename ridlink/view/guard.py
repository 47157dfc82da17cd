"""Decides which requests are answered: those of this server's pages, and of programs with the right headers.

A page of another site must not use this server through a browser that has both open. Its Origin reveals it; if it has
made its own name resolve to this machine, the Host does.
"""

from __future__ import annotations

import ipaddress
import logging
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from typing import Any

LOG = logging.getLogger(__name__)

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

HEADERS = (
    (b"content-security-policy", b"default-src 'self'; img-src 'self' data:; object-src 'none'; base-uri 'none'; "
                                 b"form-action 'none'; frame-ancestors 'none'"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-cache"),
)  # fmt: skip
"""Headers of every answer."""

LOOPBACK = ("localhost", "127.0.0.1", "::1")


class Guard:
    """Passes requests to an application, or refuses them.

    Args:
        app: The application.
        host: Address that the server listens on.
        names: Further host names that are accepted.

    Attributes:
        failures: Requests and pages that failed by an error of the application; the first is logged.
    """

    def __init__(self, app: App, host: str, names: Iterable[str] = ()) -> None:
        self.failures = 0
        self._app = app
        self._names = {*LOOPBACK, host.lower(), *(name.lower() for name in names)}
        self._any_address = _is_wildcard(host)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is not None:
            await refuse(scope, send, *refusal)
            return

        async def send_with_headers(message: MutableMapping[str, Any]) -> None:
            if message["type"] in ("http.response.start", "websocket.accept", "websocket.http.response.start"):
                message["headers"] = [*message.get("headers", ()), *HEADERS]
            await send(message)

        try:
            await self._app(scope, receive, send_with_headers)
        except Exception as error:
            self.failures += 1
            if self.failures == 1:
                LOG.error("an answer failed, as others may: those are counted", exc_info=error)
            raise

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        hosts = [value for name, value in scope["headers"] if name == b"host"]
        origins = [value for name, value in scope["headers"] if name == b"origin"]
        if len(hosts) != 1 or not self._is_ours(hosts[0].decode("latin-1")):
            return 403, "this name is not served here"
        own = {scheme + hosts[0].lower() for scheme in (b"http://", b"https://")}
        if origins and (len(origins) > 1 or origins[0].lower() not in own):
            return 403, "pages of other sites are not answered"
        if scope["type"] == "http" and scope["method"] not in ("GET", "HEAD"):
            return 405, "only GET is answered"
        return None

    def _is_ours(self, host: str) -> bool:
        name = host_name(host)
        if name in self._names:
            return True
        return self._any_address and _is_address(name)  # no name, since anybody may make a name resolve to this machine


def host_name(host: str) -> str:
    """Name in a Host header, without port and brackets, in lower case."""
    if host.startswith("["):
        return host[1:].partition("]")[0].lower()
    return host.partition(":")[0].lower()


async def refuse(scope: Scope, send: Send, status: int, text: str) -> None:
    """Answer a request, or the handshake of a WebSocket, with an error."""
    kind = "http" if scope["type"] == "http" else "websocket.http"
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *HEADERS]
    body = f"{text}\n".encode()
    await send({"type": f"{kind}.response.start", "status": status, "headers": headers})
    await send({"type": f"{kind}.response.body", "body": body})


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _is_wildcard(host: str) -> bool:
    return _is_address(host) and ipaddress.ip_address(host).is_unspecified
