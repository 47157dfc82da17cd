"""The link contract: bytes are sent and received as whole datagrams or frames, and network errors never raise.

A datagram link delivers datagrams; a stream link delivers one frame at a time. Addresses are opaque to callers, which
only compare them and pass them to `Link.send`.
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
        local_address: Address of this end, with the port that the kernel chose.
        counters: Number of failures, by cause.
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
            address: Peer; by default the peer of the link, or, for a listening link, the peer that sent last.

        Returns:
            False if nothing was sent, since there is no peer or the network refused. This is counted and never raises.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the port; data that arrive later are dropped. May be called twice."""

    def _deliver(self, data: bytes, address: Address) -> None:
        """Deliver bytes to the owner. Exceptions of the owner are counted, since one bad datagram must not end the
        link."""
        try:
            self._on_datagram(data, address)
        except Exception as error:
            self.counters["handler_error"] += 1
            self.counters[f"handler_error_{type(error).__name__}"] += 1


def whole_frames(parser: FrameParser, data: bytes, counters: Counter[str]) -> Iterator[bytes]:
    """Feed bytes to a stream's parser; the frames that are complete now. Bytes that are no frame are counted by
    cause."""
    for found in parser.feed(data):
        if isinstance(found, Frame):
            yield found.raw
        else:
            counters[found.cause] += 1
