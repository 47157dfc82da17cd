"""The link contract: bytes go out whole, bytes come in whole, and nothing that the network does raises.

A datagram link hands over datagrams; a stream link hands over one frame at a time. Addresses are opaque to callers:
they are compared, and handed back to `Link.send`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator

from ridlink.mavlink.frames import Frame, FrameParser

Address = tuple[str, int]
"""Host and port of a peer."""

OnDatagram = Callable[[bytes, Address], None]


class Link(ABC):
    """One end of a connection.

    Attributes:
        local_address: Where this end is, with the port that the kernel chose.
        counters: What went wrong, by cause.
    """

    local_address: Address

    def __init__(self, on_datagram: OnDatagram) -> None:
        self.counters: Counter[str] = Counter()
        self._on_datagram = on_datagram

    @abstractmethod
    def send(self, data: bytes, address: Address | None = None) -> bool:
        """Send one datagram or frame.

        Args:
            data: Bytes.
            address: Peer; without it the peer of the link, or whoever spoke last to a listening one.

        Returns:
            False if nothing was sent: nobody to send to, or the network refused. It is counted, and never raises.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the port; what comes later is dropped. May be called twice."""

    def _deliver(self, data: bytes, address: Address) -> None:
        """Hand bytes to the owner; what the owner raises is counted, for one bad datagram must not end the link."""
        try:
            self._on_datagram(data, address)
        except Exception as error:
            self.counters["handler_error"] += 1
            self.counters[f"handler_error_{type(error).__name__}"] += 1


def whole_frames(parser: FrameParser, data: bytes, counters: Counter[str]) -> Iterator[bytes]:
    """The frames of a stream that are complete with some more bytes of it; what is none is counted by cause."""
    for found in parser.feed(data):
        if isinstance(found, Frame):
            yield found.raw
        else:
            counters[found.cause] += 1
