"""Accepts connections, and limits their share of the loop's time.

A page loads some files and then sends a few requests a minute. A client that sends more is broken or hostile, and must
not delay the instants of other pages. So reading from all connections takes only a share of the loop's time, in small
pieces, and new connections are accepted one by one. Unread data wait in the kernel, and then at the sender.
"""

from __future__ import annotations

import asyncio
import errno
import socket
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from ridlink.errors import LinkError

MOST_CONNECTIONS = 128
NEWCOMER_EVERY_S = 0.02
READ_BYTES = 1024
"""Bytes read at once: with the smallest frames, work for a few milliseconds."""

SHARE = 0.1
"""Share of the loop's time for reading."""

VISIT_S = 20.0
"""A connection that has not become a WebSocket by then is closed; a browser closes it after 5 s anyway."""

OUT_OF_SOCKETS_S = 1.0
NEVER_AGAIN = (errno.EBADF, errno.EINVAL, errno.ENOTSOCK)
"""Errors after which no connection can be accepted any more. After any other error, later connections may succeed:
there are no sockets or no memory left, the peer has gone, a firewall forbids it, or the network has failed, which Linux
reports to the next accept."""


class Door:
    """Accepts connections for the protocols of a server.

    Args:
        protocol: Creates the protocol of a new connection; it may pass the connection on to another one.

    Attributes:
        counters: Connections that ``made_room`` for a new one because there were too many, that were ``turned_away``
            because no other could be closed, ``not_accepted`` because there were no sockets left, or the network
            failed.
    """

    def __init__(self, protocol: Callable[[], asyncio.Protocol]) -> None:
        self.counters: Counter[str] = Counter()
        self.inside: set[_Visitor] = set()
        self._protocol = protocol
        self._free_at_s = 0.0

    async def run(self, listening: socket.socket) -> None:
        """Accept connections until cancelled.

        Raises:
            LinkError: If the listening socket cannot accept any more.
        """
        listening.setblocking(False)
        loop = asyncio.get_running_loop()
        while True:
            try:
                connection, _ = await loop.sock_accept(listening)
            except OSError as error:
                if error.errno in NEVER_AGAIN:
                    raise LinkError(f"the page lets nobody in any more: {error.strerror}") from error
                self.counters["not_accepted"] += 1
                await asyncio.sleep(OUT_OF_SOCKETS_S)
                continue
            if len(self.inside) < MOST_CONNECTIONS or self._make_room():
                await loop.connect_accepted_socket(lambda: _Visitor(self, self._protocol()), connection)
            else:
                self.counters["turned_away"] += 1
                connection.close()
            await asyncio.sleep(NEWCOMER_EVERY_S)

    def _make_room(self) -> bool:
        """Close the connection whose last answer, or else arrival, is longest ago; False if all are pages, which stay.

        A browser sends its request at once, so its connection is among the last to be closed.
        """
        visitor = min((one for one in self.inside if one.is_visit), key=lambda one: one.answered_s, default=None)
        if visitor is None:
            return False
        self.counters["made_room"] += 1
        self.inside.discard(visitor)
        visitor.end_visit()
        return True

    def turn_after(self, spent_s: float) -> float:
        """Time when a connection whose data took `spent_s` may be read again [s], on the clock of `time.monotonic`."""
        self._free_at_s = max(self._free_at_s, time.monotonic()) + spent_s / SHARE
        return self._free_at_s


class _Visitor(asyncio.BufferedProtocol):
    """One connection, between the socket and its protocol.

    Attributes:
        answered_s: Time of the last answer, or of its arrival, on the clock of `time.monotonic`.
    """

    def __init__(self, door: Door, protocol: asyncio.Protocol) -> None:
        self._door, self._protocol = door, protocol
        self._first = protocol
        self._buffer = bytearray(READ_BYTES)
        self._holds: set[str] = set()
        self.answered_s = time.monotonic()

    @property
    def is_visit(self) -> bool:
        """Whether it has not become a WebSocket."""
        return self._protocol is self._first

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport, self._loop = transport, asyncio.get_running_loop()
        self._door.inside.add(self)
        self._visit = self._loop.call_later(VISIT_S, self.end_visit)
        self._turn: asyncio.TimerHandle | None = None
        self._protocol.connection_made(_Transport(transport, self))  # type: ignore[arg-type]

    def connection_lost(self, exc: Exception | None) -> None:
        self._door.inside.discard(self)
        self._visit.cancel()
        if self._turn is not None:
            self._turn.cancel()
        self._protocol.connection_lost(exc)

    def get_buffer(self, sizehint: int) -> bytearray:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        began_s = time.perf_counter()
        self._protocol.data_received(bytes(self._buffer[:nbytes]))
        turn_s = self._door.turn_after(time.perf_counter() - began_s)
        self.hold("turn")
        self._turn = self._loop.call_later(turn_s - time.monotonic(), self.release, "turn")

    def eof_received(self) -> bool | None:
        return self._protocol.eof_received()

    def pause_writing(self) -> None:
        self._protocol.pause_writing()

    def resume_writing(self) -> None:
        self._protocol.resume_writing()

    def hand_on(self, protocol: asyncio.Protocol) -> None:
        """Use another protocol from now on."""
        self._protocol = protocol

    def hold(self, why: str) -> None:
        """Stop reading until every reason to hold has been released."""
        self._holds.add(why)
        self._transport.pause_reading()

    def release(self, why: str) -> None:
        """Release one reason to hold."""
        self._holds.discard(why)
        if not self._holds:
            self._transport.resume_reading()

    def end_visit(self) -> None:
        """Close it, unless it has become a WebSocket."""
        if not self.is_visit:
            return
        if self._transport.get_write_buffer_size():
            self._transport.abort()  # an unread answer would keep it open
        else:
            self._transport.close()


class _Transport:
    """The transport for a protocol: reading continues only if there is no other reason to hold."""

    def __init__(self, transport: asyncio.Transport, visitor: _Visitor) -> None:
        self._transport, self._visitor = transport, visitor

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def write(self, data: bytes) -> None:
        self._visitor.answered_s = time.monotonic()
        self._transport.write(data)

    def pause_reading(self) -> None:
        self._visitor.hold("protocol")

    def resume_reading(self) -> None:
        self._visitor.release("protocol")

    def set_protocol(self, protocol: asyncio.Protocol) -> None:
        self._visitor.hand_on(protocol)
