"""Links: UDP, TCP and in-memory ends that carry datagrams or frames, opened by connection string."""

from __future__ import annotations

from ridlink.links.link import Address, Link, OnDatagram
from ridlink.links.memory import MemoryLink, memory_link_pair
from ridlink.links.signed import SigningOptions, open_signed_link
from ridlink.links.tcp import open_tcp_link
from ridlink.links.udp import open_udp_link
from ridlink.links.url import LinkUrl, Scheme, parse_link_url, refuse_serial, refuse_to_speak_to_oneself

__all__ = ["Address", "Link", "LinkUrl", "MemoryLink", "OnDatagram", "Scheme", "SigningOptions",
           "memory_link_pair", "open_link", "open_signed_link", "parse_link_url",
           "refuse_to_speak_to_oneself"]  # fmt: skip


async def open_link(url: LinkUrl | str, on_datagram: OnDatagram) -> Link:
    """Open a link.

    Args:
        url: Where to, as `parse_link_url` takes it.
        on_datagram: Called with the bytes and the sender of each datagram, or each frame of a stream.

    Raises:
        ConfigError: If the connection string is wrong, or names a serial device.
        LinkError: If the port or peer cannot be used.
    """
    url = parse_link_url(url) if isinstance(url, str) else url
    refuse_serial(url)
    if url.scheme in (Scheme.UDPIN, Scheme.UDPOUT):
        return await open_udp_link(url, on_datagram)
    return await open_tcp_link(url, on_datagram)
