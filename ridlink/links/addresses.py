"""Addresses of sockets: which one a name has here, and how a peer's is kept."""

from __future__ import annotations

import asyncio
import socket
from typing import Any

from ridlink.errors import LinkError
from ridlink.links.link import Address
from ridlink.links.url import LinkUrl

Resolved = tuple[int, int, Any]
"""Family, protocol and address, as the kernel takes them."""


async def resolve(url: LinkUrl, kind: socket.SocketKind) -> Resolved:
    """The one address that a host is taken by.

    A name may have addresses of both families, localhost for one; autopilots and ground stations speak IPv4.

    Raises:
        LinkError: If it has none.
    """
    try:
        found = await asyncio.get_running_loop().getaddrinfo(url.host, url.port, type=kind)
    except (OSError, UnicodeError) as error:  # a name with a label of more than 63 letters is no OSError
        raise LinkError(f"{url}: no such host: {getattr(error, 'strerror', None) or error}") from error
    family, _, protocol, _, address = min(found, key=lambda each: each[0] != socket.AF_INET)
    return family, protocol, address


def host_and_port(address: tuple[Any, ...]) -> Address:
    """An address of a socket as it is kept and handed back: that of a link keeps its scope, without which nobody there
    can be answered (RFC 4007, section 11)."""
    host, port, *more = address
    return f"{host}%{more[1]}" if more and more[1] else host, port
