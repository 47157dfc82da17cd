"""Links over UDP, TCP, serial devices and memory. They carry datagrams or frames; a connection string opens one."""

from __future__ import annotations

from ridlink.links.link import Address, Link, OnDatagram
from ridlink.links.memory import MemoryLink, memory_link_pair
from ridlink.links.opening import open_link
from ridlink.links.signed import open_signed_link
from ridlink.links.signing_options import SigningOptions
from ridlink.links.url import LinkUrl, Scheme, parse_link_url, refuse_to_speak_to_oneself

__all__ = ["Address", "Link", "LinkUrl", "MemoryLink", "OnDatagram", "Scheme", "SigningOptions",
           "memory_link_pair", "open_link", "open_signed_link", "parse_link_url",
           "refuse_to_speak_to_oneself"]  # fmt: skip
