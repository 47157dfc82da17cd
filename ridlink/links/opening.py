"""Opens the link that a connection string names."""

from __future__ import annotations

from ridlink.links.link import Link, OnDatagram
from ridlink.links.serial import open_serial_link
from ridlink.links.tcp import open_tcp_link
from ridlink.links.udp import open_udp_link
from ridlink.links.url import LinkUrl, Scheme, parse_link_url


async def open_link(url: LinkUrl | str, on_datagram: OnDatagram) -> Link:
    """Open a link.

    Args:
        url: Connection string, as for `parse_link_url`.
        on_datagram: Called with the bytes and the sender of each datagram, or of each frame of a stream.

    Raises:
        ConfigError: If the connection string is wrong.
        MissingExtraError: If it names a serial device and pyserial is not installed.
        LinkError: If the port, peer or device cannot be used.
    """
    url = parse_link_url(url) if isinstance(url, str) else url
    match url.scheme:
        case Scheme.UDPIN | Scheme.UDPOUT:
            return await open_udp_link(url, on_datagram)
        case Scheme.TCPIN | Scheme.TCPOUT:
            return await open_tcp_link(url, on_datagram)
        case Scheme.SERIAL:
            return await open_serial_link(url, on_datagram)
