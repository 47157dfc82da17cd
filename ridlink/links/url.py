"""Connection strings, such as ``udpin:HOST:PORT``; every error shows the right spelling.

    udpin:127.0.0.1:14540      listen, and answer the peer that sent last
    udpout:127.0.0.1:14650     speak to a peer from a port of the kernel's choice
    tcpin:127.0.0.1:5760       wait for peers
    tcpout:127.0.0.1:5760      connect to a peer
    serial:/dev/ttyACM0:57600  a device and its baud rate

``//`` after the first colon is allowed, a missing host means 127.0.0.1, and IPv6 addresses are written in brackets.
"""

from __future__ import annotations

import difflib
import itertools
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NoReturn

from ridlink.errors import ConfigError

DEFAULT_HOST = "127.0.0.1"
"""A link is not reachable from other machines unless requested."""


class Scheme(StrEnum):
    """Kind of link."""

    UDPIN = "udpin"
    UDPOUT = "udpout"
    TCPIN = "tcpin"
    TCPOUT = "tcpout"
    SERIAL = "serial"


_LOCAL = {"localhost": "127.0.0.1", "127.0.0.1": "127.0.0.1", "::1": "::1"}
_HERE = {"127.0.0.1", "::1", "0.0.0.0", "::"}

_EXAMPLES = {
    Scheme.UDPIN: "udpin:127.0.0.1:14540",
    Scheme.UDPOUT: "udpout:127.0.0.1:14540",
    Scheme.TCPIN: "tcpin:127.0.0.1:5760",
    Scheme.TCPOUT: "tcpout:127.0.0.1:5760",
    Scheme.SERIAL: "serial:/dev/ttyACM0:57600",
}


@dataclass(frozen=True, slots=True)
class LinkUrl:
    """A parsed connection string.

    Args:
        scheme: Kind of link.
        host: Address or name; the device for ``serial``.
        port: Port; 0 lets the kernel choose (listening only); the baud rate for ``serial``.
    """

    scheme: Scheme
    host: str
    port: int

    @property
    def listens(self) -> bool:
        """Whether peers connect to this end."""
        return self.scheme in (Scheme.UDPIN, Scheme.TCPIN)

    @property
    def where_to_look(self) -> str:
        """What to check where no autopilot is heard on it."""
        if self.scheme is Scheme.SERIAL:
            return (
                f"does that port of the autopilot speak MAVLink at {self.port} baud (PX4: MAV_1_CONFIG, SER_TEL2_BAUD; "
                "ArduPilot: SERIAL2_PROTOCOL, SERIAL2_BAUD)?"
            )
        return "is the vehicle powered, and does it send here?" if self.listens else "does anything answer there?"

    def at(self, address: tuple[str, int]) -> LinkUrl:
        """The same link at the address that the system gave it."""
        return replace(self, host=address[0], port=address[1])

    def leads_to(self, other: LinkUrl) -> bool:
        """Whether the other link listens where this one sends to, so that a program with both would talk to itself."""
        if (self.scheme, other.scheme) not in ((Scheme.UDPOUT, Scheme.UDPIN), (Scheme.TCPOUT, Scheme.TCPIN)):
            return False
        mine, theirs = (_LOCAL.get(host.lower(), host) for host in (self.host, other.host))
        # Sending to the wildcard address sends to this machine, and a listener on the wildcard address receives it.
        return self.port == other.port and (mine == theirs or {mine, theirs} <= _HERE)

    def __str__(self) -> str:
        is_ipv6 = ":" in self.host and self.scheme is not Scheme.SERIAL
        return f"{self.scheme}:{f'[{self.host}]' if is_ipv6 else self.host}:{self.port}"


def _refuse(text: str, reason: str, right: str) -> NoReturn:
    raise ConfigError(f"connection string {text!r}: {reason}; write {right}")


def refuse_to_speak_to_oneself(links: Mapping[str, LinkUrl | None]) -> None:
    """Refuse links of one program that would talk to each other, or that use the same port or device.

    Args:
        links: Links by the names that the user knows; None if there is none.

    Raises:
        ConfigError: If one of them leads to another, or two listen on one port, or are one device.
    """
    given = {key: link for key, link in links.items() if link is not None}
    for (key, link), (other, its) in itertools.permutations(given.items(), 2):
        if link.leads_to(its):
            raise ConfigError(
                f"{key} {link} leads to the port that {other} listens on, {its}: what is sent would be heard "
                f"here; give {key} another port"
            )
        if link.listens and link.port and link == its:
            raise ConfigError(f"{key} and {other} both listen on {link}: give one of them another port")
        if link.scheme is its.scheme is Scheme.SERIAL and link.host == its.host:
            raise ConfigError(
                f"{key} {link} and {other} {its} are one device, which one link alone can have; let mavlink-router "
                "bridge it to UDP for both"
            )


def parse_link_url(text: str) -> LinkUrl:
    """Parse a connection string.

    Raises:
        ConfigError: If it is invalid; the text shows a right spelling.
    """
    name, colon, rest = text.strip().partition(":")
    rest = rest.removeprefix("//")
    lowered = name.lower()
    if lowered in ("udp", "tcp"):
        tail = _tail(Scheme(lowered + "out"), rest)
        _refuse(
            text,
            f"'{lowered}:' does not say who speaks first",
            f"{lowered}in:{tail} to listen or {lowered}out:{tail} to speak to a peer",
        )
    if lowered not in list(Scheme):
        near = difflib.get_close_matches(lowered, list(Scheme), n=1, cutoff=0.5)
        if near:
            _refuse(text, f"unknown scheme {name!r}", f"{near[0]}:{_tail(Scheme(near[0]), rest)}")
        if place := _place(text.strip()):
            _refuse(text, "no scheme", f"udpin:{place} to listen or udpout:{place} to speak to a peer")
        _refuse(text, f"unknown scheme {name!r}" if colon else "no scheme", ", ".join(_EXAMPLES.values()))
    scheme = Scheme(lowered)
    example = _EXAMPLES[scheme]
    if match := re.fullmatch(r"\[([^\]]*)\](?::(.*))?", rest):
        host, port_text = match[1], match[2] or ""
    else:
        host, found, port_text = rest.rpartition(":")
        if not found:
            host, port_text = rest, ""
    if scheme is Scheme.SERIAL:
        if not host:
            _refuse(text, "no device", example)
        host = re.sub("^//+", "/", host)
        if (baud := _number(port_text)) <= 0:
            _refuse(text, "no baud rate", f"serial:{host}:57600")
        return LinkUrl(scheme, host, baud)
    if re.search(r"[\s/?#@\[\]]", host) or (":" in host and not rest.startswith("[")):
        _refuse(text, f"host {host!r} is not an address or a name", example)
    if not port_text:
        if host.isascii() and host.isdecimal():
            _refuse(text, "no host", f"{scheme}:{_tail(scheme, f'{DEFAULT_HOST}:{host}')}")
        _refuse(text, "no port", str(LinkUrl(scheme, host or DEFAULT_HOST, int(example.rpartition(":")[2]))))
    port = _number(port_text)
    if not 0 <= port <= 65535:
        _refuse(text, f"port {port_text!r} is not a number from 0 to 65535", example)
    url = LinkUrl(scheme, host or DEFAULT_HOST, port)
    if url.port == 0 and not url.listens:
        _refuse(text, "port 0 is for listening only", example)
    return url


def _number(text: str) -> int:
    """A number of at most nine digits, more than any port or baud rate has; -1 if it is no number."""
    return int(text) if re.fullmatch(r"[0-9]{1,9}", text) else -1


def _place(text: str) -> str | None:
    """Host and port of a text without a scheme, with defaults for a missing part; None if it is no such text."""
    found = re.fullmatch(r"(?:(\w[\w.\-]*|\[[0-9a-fA-F:.]+\]):?)??([0-9]*)", text, re.ASCII)
    if not text or found is None:
        return None
    port = _number(found[2] or _EXAMPLES[Scheme.UDPIN].rpartition(":")[2])
    return f"{found[1] or DEFAULT_HOST}:{port}" if 0 < port <= 65535 else None


def _tail(scheme: Scheme, rest: str) -> str:
    """Host and port as given, if they are usable in a corrected spelling, else those of an example."""
    if re.fullmatch(r"[\w.\-/]+:\d+|\[[0-9a-fA-F:.]+\]:\d+", rest):
        with suppress(ConfigError):
            parse_link_url(f"{scheme}:{rest}")
            return rest
    return _EXAMPLES[scheme].partition(":")[2]
