"""UDP links: one socket, read in batches; ICMP errors do not end it.

asyncio's own datagram transport wakes up once per datagram and queues datagrams that cannot be sent. Here one wake-up
reads all that has arrived, up to a batch. A datagram that the kernel does not take at once is dropped and counted,
since an old setpoint is worth nothing.
"""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import Callable
from typing import Any

from ridlink.errors import LinkError
from ridlink.links.addresses import host_and_port, resolve
from ridlink.links.link import Address, Link, OnDatagram
from ridlink.links.url import LinkUrl, Scheme

RECEIVE_BUFFER_BYTES = 4 * 2**20
"""Buffer requested from the kernel: four seconds of a thousand aircraft at 10 Hz. The kernel caps it at
net.core.rmem_max."""

BATCH = 128
BATCH_S = 0.01
"""Limits of one wake-up, in datagrams and in time: a flood, or a few datagrams that take long to read, must not make
the loop miss its deadline."""

LARGEST_DATAGRAM = 65535

PASSING = {errno.ECONNREFUSED, errno.EMSGSIZE, errno.ENOBUFS, errno.EHOSTUNREACH, errno.EPERM, errno.EACCES}
"""Errors that concern one datagram. Any other error concerns the socket, whose interface is down or whose address is
gone: the socket is then created again."""

FIRST_RETRY_S, LONGEST_RETRY_S = 0.1, 1.0


class UdpLink(Link):
    """A UDP socket in an asyncio loop; made by `open_udp_link`."""

    def __init__(self, sock: socket.socket, make: Callable[[], socket.socket], on_datagram: OnDatagram,
                 loop: asyncio.AbstractEventLoop, peer: Address | None) -> None:  # fmt: skip
        super().__init__(on_datagram)
        self._make = make
        self._connected = peer is not None
        self._peer = peer
        self._loop = loop
        self._closed = False
        self._retry: asyncio.TimerHandle | None = None
        self._retry_s = FIRST_RETRY_S
        self._use(sock)

    def _use(self, sock: socket.socket) -> None:
        self._socket = sock
        self.local_address = host_and_port(sock.getsockname())
        self._loop.add_reader(sock.fileno(), self._read)

    def _make_anew(self) -> None:
        """Close the socket, and create another one as soon as possible."""
        self._retry = None
        if self._closed:
            return
        if self._socket.fileno() >= 0:
            self._loop.remove_reader(self._socket.fileno())
            self._socket.close()
        try:
            sock = self._make()
        except OSError:
            self.counters["socket_lost"] += 1
            self._retry_s = min(2.0 * self._retry_s, LONGEST_RETRY_S)
            self._retry = self._loop.call_later(self._retry_s, self._make_anew)
            return
        self._retry_s = FIRST_RETRY_S
        self.counters["socket_made_anew"] += 1
        self._use(sock)

    def _read(self) -> None:
        enough_s = self._loop.time() + BATCH_S
        for _ in range(BATCH):
            try:
                data, address = self._socket.recvfrom(LARGEST_DATAGRAM)
            except (BlockingIOError, InterruptedError):
                return
            except OSError as error:  # ICMP errors for earlier datagrams arrive here
                self._count(error)
                if self._retry is not None:
                    return
                continue
            peer = host_and_port(address)
            if not self._connected and peer[1]:  # port 0 means that no answer is wanted
                self._peer = peer
            self._deliver(data, peer)
            closed_meanwhile = self._socket.fileno() < 0
            if closed_meanwhile or self._loop.time() >= enough_s:
                return

    def _count(self, error: OSError) -> None:
        self.counters["refused" if error.errno == errno.ECONNREFUSED else "network_error"] += 1
        if error.errno not in PASSING and self._retry is None:
            self._retry = self._loop.call_later(self._retry_s, self._make_anew)

    def send(self, data: bytes, address: Address | None = None) -> bool:
        """Send one datagram; see `Link.send`."""
        if self._socket.fileno() < 0:
            return False
        target = address or self._peer
        if target is None or not target[1]:
            self.counters["no_peer"] += 1
            return False
        # The next call reports the ICMP error of an earlier datagram and sends nothing, so send once more.
        for _ in range(2):
            try:
                if self._connected:
                    self._socket.send(data)
                else:
                    self._socket.sendto(data, target)
                return True
            except (BlockingIOError, InterruptedError):
                self.counters["send_buffer_full"] += 1
                return False
            except OSError as error:
                self._count(error)
                if error.errno != errno.ECONNREFUSED:
                    return False
        return False

    def close(self) -> None:
        """Release the port."""
        self._closed = True
        if self._retry is not None:
            self._retry.cancel()
        if self._socket.fileno() >= 0:
            self._loop.remove_reader(self._socket.fileno())
            self._socket.close()


async def open_udp_link(url: LinkUrl, on_datagram: OnDatagram) -> UdpLink:
    """Bind (``udpin``) or connect (``udpout``) a socket.

    Raises:
        LinkError: If the port is in use, or the address is unknown or not of this machine.
    """
    loop = asyncio.get_running_loop()
    family, protocol, address = await resolve(url, socket.SOCK_DGRAM)
    listens = url.scheme is Scheme.UDPIN
    bound: list[Any] = []

    def make() -> socket.socket:
        sock = socket.socket(family, socket.SOCK_DGRAM, protocol)
        try:
            sock.setblocking(False)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            if listens:
                sock.bind(bound[0] if bound else address)  # keep the port that the kernel chose before
            else:
                sock.connect(address)  # the kernel drops datagrams from others than the peer
        except OSError:
            sock.close()
            raise
        return sock

    try:
        sock = make()
    except OSError as error:
        raise LinkError(open_failure(url, error)) from error
    bound.append(sock.getsockname())
    return UdpLink(sock, make, on_datagram, loop, None if listens else host_and_port(address))


def open_failure(url: LinkUrl, error: OSError) -> str:
    """One line that says why a link did not open and what to do about it."""
    if error.errno == errno.EADDRINUSE:
        kind = "u" if url.scheme is Scheme.UDPIN else "t"
        return (
            f"{url}: port {url.port} is in use by another program; stop it (ss -{kind}lpn shows which) or choose "
            f"another port, as in {url.scheme}:{url.host}:{url.port + 1}"
        )
    if error.errno == errno.EADDRNOTAVAIL:
        return f"{url}: {url.host} is no address of this machine; 127.0.0.1 is for this machine only, 0.0.0.0 for all"
    if error.errno == errno.EACCES and url.scheme is Scheme.UDPOUT:
        return f"{url}: {url.host} is the address of a whole network; write that of one machine"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"{url}: not allowed to use port {url.port}; ports from 1024 up need no privileges"
    if error.errno == errno.ECONNREFUSED:
        return f"{url}: nobody listens there"
    if error.errno == errno.EMFILE:
        return f"{url}: {error.strerror}; 'ulimit -n' says how many there may be, and sets it"
    return f"{url}: {error.strerror or error}"
