"""Addresses of sockets: how a name is resolved, and how the address of a peer is stored."""

from __future__ import annotations

import asyncio
import socket
from typing import Any

from ridlink.errors import LinkError
from ridlink.links.link import Address
from ridlink.links.url import LinkUrl

Resolved = tuple[int, int, Any]
"""Family, protocol and address, as the kernel expects them."""


async def resolve(url: LinkUrl, kind: socket.SocketKind) -> Resolved:
    """The address that is used for a host.

    A name may have addresses of both families, for example localhost; IPv4 wins, since autopilots and ground stations
    use it.

    Raises:
        LinkError: If the host has no address.
    """
    try:
        found = await asyncio.get_running_loop().getaddrinfo(url.host, url.port, type=kind)
    except (OSError, UnicodeError) as error:  # a name with a label of more than 63 letters is no OSError
        raise LinkError(f"{url}: no such host: {getattr(error, 'strerror', None) or error}") from error
    family, _, protocol, _, address = min(found, key=lambda each: each[0] != socket.AF_INET)
    return family, protocol, address


def host_and_port(address: tuple[Any, ...]) -> Address:
    """A socket address as stored; a link-local one keeps its scope, which a reply needs (RFC 4007, section 11)."""
    host, port, *more = address
    return f"{host}%{more[1]}" if more and more[1] else host, port
