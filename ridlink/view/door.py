"""Who comes in, and how much of the loop's time they take.

A page loads some files and then says a few words a minute. Whoever says more is broken or hostile, and must not cost
the others their instants: what all of them send is read in a share of the loop's time, in pieces so small that none is
noticed, and newcomers come in one after the other. What is not read yet waits in the kernel, and then with its sender.
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
"""At once: of the smallest frames that is work for a few milliseconds."""

SHARE = 0.1
"""Of the loop's time, for reading what comes."""

VISIT_S = 20.0
"""A connection that has not become a WebSocket by then is ended; a browser lets go of it after 5 s anyway."""

OUT_OF_SOCKETS_S = 1.0
NEVER_AGAIN = (errno.EBADF, errno.EINVAL, errno.ENOTSOCK)
"""Why no connection is accepted any more. Else others may be: no sockets or no memory are left, the peer has gone, a
firewall forbids it, or the network has failed, of which Linux tells whoever accepts next."""


class Door:
    """Lets connections in to the protocols of a server.

    Args:
        protocol: Makes the protocol of a new connection; it may hand the connection on to another one.

    Attributes:
        counters: Connections that ``made_room`` for a newcomer because there were too many, that were ``turned_away``
            because nobody else could, ``not_accepted`` because there were no sockets left, or the network failed.
    """

    def __init__(self, protocol: Callable[[], asyncio.Protocol]) -> None:
        self.counters: Counter[str] = Counter()
        self.inside: set[_Visitor] = set()
        self._protocol = protocol
        self._free_at_s = 0.0

    async def run(self, listening: socket.socket) -> None:
        """Accept connections until cancelled.

        Raises:
            LinkError: If there is nothing any more that could be accepted from.
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
        """End the connection that was answered longest ago, or came and never was; pages stay. False if all are pages.

        A browser asks as soon as it is let in, so that its connection is among the last to go.
        """
        visitor = min((one for one in self.inside if one.is_visit), key=lambda one: one.answered_s, default=None)
        if visitor is None:
            return False
        self.counters["made_room"] += 1
        self.inside.discard(visitor)
        visitor.end_visit()
        return True

    def turn_after(self, spent_s: float) -> float:
        """When somebody whose words took so long may be read again [s], on the clock of `time.monotonic`."""
        self._free_at_s = max(self._free_at_s, time.monotonic()) + spent_s / SHARE
        return self._free_at_s


class _Visitor(asyncio.BufferedProtocol):
    """One connection, between the socket and the protocol that speaks on it.

    Attributes:
        answered_s: When something was last said to it, or it came, on the clock of `time.monotonic`.
    """

    def __init__(self, door: Door, protocol: asyncio.Protocol) -> None:
        self._door, self._protocol = door, protocol
        self._first = protocol
        self._buffer = bytearray(READ_BYTES)
        self._holds: set[str] = set()
        self.answered_s = time.monotonic()

    @property
    def is_visit(self) -> bool:
        """It has not become a WebSocket."""
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
        """Another protocol speaks from now on."""
        self._protocol = protocol

    def hold(self, why: str) -> None:
        """Read no more, until all who held it have released it."""
        self._holds.add(why)
        self._transport.pause_reading()

    def release(self, why: str) -> None:
        """Whoever held it has no reason any more."""
        self._holds.discard(why)
        if not self._holds:
            self._transport.resume_reading()

    def end_visit(self) -> None:
        """End it, unless it has become a WebSocket."""
        if not self.is_visit:
            return
        if self._transport.get_write_buffer_size():
            self._transport.abort()  # an answer that nobody reads would keep it open
        else:
            self._transport.close()


class _Transport:
    """What a protocol sees of the socket: reading goes on only when nobody else holds it."""

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
