"""TCP links: a byte stream per peer, cut into frames, which are delivered like datagrams."""

from __future__ import annotations

import asyncio
import socket

from ridlink.errors import LinkError
from ridlink.links.addresses import host_and_port, resolve
from ridlink.links.link import Address, Link, OnDatagram, whole_frames
from ridlink.links.udp import open_failure
from ridlink.links.url import LinkUrl, Scheme
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import FrameParser

SEND_BUFFER_BYTES = 64 * 1024
"""A peer that does not read loses what exceeds this buffer: seconds of setpoints, which would be stale anyway."""

MAX_PEERS = 8
RECONNECT_S = 1.0
OPEN_TIMEOUT_S = 5.0

VANISHED_S = 15
"""Silence of a peer's machine after which it counts as gone: a machine that lost power or network does not close the
connection. Without this limit, a client would wait forever and a server would keep the peer's place."""

PROBES = 3
NOTICES = ((socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
           (socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, VANISHED_S // PROBES),
           (socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, VANISHED_S // PROBES),
           (socket.IPPROTO_TCP, socket.TCP_KEEPCNT, PROBES - 1),
           (socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 1000 * VANISHED_S))  # fmt: skip
"""Socket options that make the kernel notice a lost peer: probes while the connection is idle, and a limit for
unacknowledged data, since the kernel does not probe while there are any."""


class _Peer(asyncio.Protocol):
    """One connection."""

    def __init__(self, link: TcpLink) -> None:
        self.link = link
        self.parser = FrameParser(CRC_EXTRAS)
        self.address: Address = ("", 0)
        self.transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        peer = transport.get_extra_info("peername")
        if peer is None:  # it has disconnected already
            transport.abort()
            return
        self.address = host_and_port(peer)
        for option in NOTICES:
            transport.get_extra_info("socket").setsockopt(*option)
        self.link._joined(self)

    def data_received(self, data: bytes) -> None:
        for frame in whole_frames(self.parser, data, self.link.counters):
            self.link._heard(frame, self)

    def connection_lost(self, exc: Exception | None) -> None:
        self.link._left(self)


class TcpLink(Link):
    """A TCP server or client; made by `open_tcp_link`. A client that lost its peer tries to connect every second."""

    def __init__(self, url: LinkUrl, on_datagram: OnDatagram) -> None:
        super().__init__(on_datagram)
        self._url = url
        self._peers: dict[Address, _Peer] = {}
        self._last: Address | None = None
        self._server: asyncio.Server | None = None
        self._retry: asyncio.Task[None] | None = None
        self._closed = False

    async def _open(self) -> None:
        loop = asyncio.get_running_loop()
        if self._url.scheme is Scheme.TCPIN:
            family, _, address = await resolve(self._url, socket.SOCK_STREAM)
            host, port = host_and_port(address)
            self._server = await loop.create_server(lambda: _Peer(self), host, port, family=family)
            self.local_address = host_and_port(self._server.sockets[0].getsockname())
        else:
            async with asyncio.timeout(OPEN_TIMEOUT_S):
                transport, _ = await loop.create_connection(lambda: _Peer(self), self._url.host, self._url.port)
            self.local_address = host_and_port(transport.get_extra_info("sockname"))

    def _joined(self, peer: _Peer) -> None:
        assert peer.transport is not None
        if self._closed or len(self._peers) >= MAX_PEERS:
            self.counters["too_many_peers"] += 1
            peer.transport.abort()
            return
        self._peers[peer.address] = peer
        self._last = peer.address

    def _heard(self, frame: bytes, peer: _Peer) -> None:
        if not self._closed:
            self._last = peer.address
            self._deliver(frame, peer.address)

    def _left(self, peer: _Peer) -> None:
        if self._peers.get(peer.address) is peer:
            del self._peers[peer.address]
            self.counters["peer_left"] += 1
        if self._last == peer.address:
            self._last = next(reversed(self._peers), None)
        if self._url.scheme is Scheme.TCPOUT and not self._closed and self._retry is None:
            self._retry = asyncio.get_running_loop().create_task(self._reconnect())

    async def _reconnect(self) -> None:
        try:
            while not self._peers and not self._closed:
                await asyncio.sleep(RECONNECT_S)
                try:
                    await self._open()
                except OSError:
                    self.counters["refused"] += 1
        finally:
            self._retry = None

    def send(self, data: bytes, address: Address | None = None) -> bool:
        """Send one frame; see `Link.send`."""
        peer = self._peers.get(address or self._last or ("", 0))
        if peer is None or peer.transport is None or peer.transport.is_closing():
            self.counters["no_peer"] += 1
            return False
        if peer.transport.get_write_buffer_size() + len(data) > SEND_BUFFER_BYTES:
            self.counters["send_buffer_full"] += 1
            return False
        peer.transport.write(data)
        return True

    def close(self) -> None:
        """Release the port and every connection."""
        self._closed = True
        if self._retry is not None:
            self._retry.cancel()
        if self._server is not None:
            self._server.close()
        for peer in list(self._peers.values()):
            if peer.transport is not None:
                peer.transport.close()


async def open_tcp_link(url: LinkUrl, on_datagram: OnDatagram) -> TcpLink:
    """Listen (``tcpin``) or connect (``tcpout``).

    Raises:
        LinkError: If the port is in use or nobody answers.
    """
    link = TcpLink(url, on_datagram)
    try:
        await link._open()
    except TimeoutError as error:
        raise LinkError(f"{url}: no answer within {OPEN_TIMEOUT_S:g} s") from error
    except LinkError:
        raise
    except UnicodeError as error:
        raise LinkError(f"{url}: no such host: {error}") from error
    except OSError as error:
        raise LinkError(open_failure(url, error)) from error
    return link
