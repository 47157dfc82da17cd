"""A link between two objects of one process: no socket, delivery at once, for tests and examples."""

from __future__ import annotations

from ridlink.links.link import Address, Link, OnDatagram


class MemoryLink(Link):
    """One end of a pair; made by `memory_link_pair`."""

    def __init__(self, address: Address, on_datagram: OnDatagram) -> None:
        super().__init__(on_datagram)
        self.local_address = address
        self._other: MemoryLink | None = None

    def send(self, data: bytes, address: Address | None = None) -> bool:
        """Deliver to the other end; False if it is closed or the address is another one."""
        other = self._other
        if other is None or address not in (None, other.local_address):
            self.counters["no_peer"] += 1
            return False
        other._deliver(data, self.local_address)
        return True

    def close(self) -> None:
        """Disconnect the two ends."""
        if self._other is not None:
            self._other._other = None
            self._other = None


def memory_link_pair(on_first: OnDatagram, on_second: OnDatagram) -> tuple[MemoryLink, MemoryLink]:
    """Two connected ends: data sent by one go to the callback of the other."""
    first, second = MemoryLink(("memory", 1), on_first), MemoryLink(("memory", 2), on_second)
    first._other, second._other = second, first
    return first, second
