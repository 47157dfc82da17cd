"""Links on the real loopback: what goes in comes out, and nothing that the network does is raised."""

from __future__ import annotations

import asyncio
import os
import socket
import struct

import pytest

from ridlink.errors import LinkError
from ridlink.links import Address, Link, memory_link_pair, open_link, parse_link_url
from ridlink.links.addresses import host_and_port
from ridlink.links.tcp import VANISHED_S, TcpLink, _Peer
from ridlink.links.udp import BATCH_S, UdpLink
from tests.links.ends import PATIENCE_S, Inbox, counted, heartbeat
from tests.loopback import free_port, run, turn


def test_udp_both_ways() -> None:
    async def test() -> None:
        at_server, at_client = Inbox(), Inbox()
        server = await open_link("udpin:127.0.0.1:0", at_server)
        client = await open_link(f"udpout:127.0.0.1:{server.local_address[1]}", at_client)
        assert not server.send(b"nobody there yet")
        assert server.counters["no_peer"] == 1
        assert client.send(b"one") and client.send(b"")
        assert await at_server.count(2) == [b"one", b""]
        assert at_server.datagrams[0][1] == client.local_address
        assert server.send(b"to whoever spoke last")
        assert server.send(b"by address", client.local_address)
        assert await at_client.count(2) == [b"to whoever spoke last", b"by address"]
        server.close()
        server.close()
        client.close()
        assert not client.send(b"closed")

    run(test)


def test_udpin_answers_whoever_spoke_last() -> None:
    async def test() -> None:
        at_server, at_first, at_second = Inbox(), Inbox(), Inbox()
        server = await open_link("udpin:127.0.0.1:0", at_server)
        url = f"udpout:127.0.0.1:{server.local_address[1]}"
        first, second = await open_link(url, at_first), await open_link(url, at_second)
        first.send(b"1")
        await at_server.count(1)
        second.send(b"2")
        await at_server.count(2)
        server.send(b"answer")
        assert await at_second.count(1) == [b"answer"]
        assert at_first.datagrams == []
        for link in (server, first, second):
            link.close()

    run(test)


def test_datagrams_that_take_long_to_read_leave_the_loop_its_turns() -> None:
    async def test() -> None:
        loop = asyncio.get_running_loop()
        turns: list[int] = []
        read = 0

        def slow(_: bytes, __: Address) -> None:
            nonlocal read
            read += 1
            began = loop.time()
            while loop.time() - began < BATCH_S:
                pass

        server = await open_link("udpin:127.0.0.1:0", slow)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flood:
            for _ in range(8):
                flood.sendto(b"x", server.local_address)
        while read < 8:
            await turn()
            turns.append(read)
        server.close()
        assert max(after - before for before, after in zip([0, *turns], turns, strict=False)) == 1

    run(test)


def test_udpout_hears_its_peer_only() -> None:
    async def test() -> None:
        at_server, at_client = Inbox(), Inbox()
        server = await open_link("udpin:127.0.0.1:0", at_server)
        client = await open_link(f"udpout:127.0.0.1:{server.local_address[1]}", at_client)
        stranger = await open_link(f"udpout:127.0.0.1:{client.local_address[1]}", Inbox())
        stranger.send(b"forged")
        client.send(b"hello")
        await at_server.count(1)
        server.send(b"true")
        assert await at_client.count(1) == [b"true"]
        for link in (server, client, stranger):
            link.close()

    run(test)


def test_f24_refused_datagrams_are_counted_and_the_link_lives_on() -> None:
    async def test() -> None:
        port, inbox = free_port(), Inbox()
        client = await open_link(f"udpout:127.0.0.1:{port}", inbox)
        for _ in range(5):
            client.send(b"into the void")
        await counted(client, "refused")
        server = await open_link(f"udpin:127.0.0.1:{port}", at_server := Inbox())
        client.send(b"now")
        client.send(b"and again")
        await at_server.count(1)
        server.send(b"alive")
        await inbox.count(1)
        client.close()
        server.close()

    run(test)


@pytest.mark.parametrize("scheme", ["udpin", "udpout"])
def test_f24_a_socket_that_the_machine_takes_away_is_made_anew_on_its_port(scheme: str) -> None:
    async def test() -> None:
        inbox, at_peer = Inbox(), Inbox()
        if scheme == "udpin":
            link = await open_link("udpin:127.0.0.1:0", inbox)
            peer = await open_link(f"udpout:127.0.0.1:{link.local_address[1]}", at_peer)
        else:
            peer = await open_link("udpin:127.0.0.1:0", at_peer)
            link = await open_link(f"udpout:127.0.0.1:{peer.local_address[1]}", inbox)
        assert isinstance(link, UdpLink)
        port = link.local_address[1]
        assert (peer if scheme == "udpin" else link).send(b"hello")
        await (inbox if scheme == "udpin" else at_peer).count(1)
        with open(os.devnull, "wb") as nothing:  # as after an interface went down: the descriptor is no socket any more
            os.dup2(nothing.fileno(), link._socket.fileno())
        assert not link.send(b"lost")
        await counted(link, "socket_made_anew")
        if scheme == "udpin":
            assert link.local_address[1] == port
            peer.send(b"again")
            assert (await inbox.count(2))[1] == b"again"
        assert link.send(b"back")
        await at_peer.until(lambda: at_peer.datagrams[-1][0] == b"back" if at_peer.datagrams else False)
        link.close()
        peer.close()

    run(test)


@pytest.mark.parametrize("nobody", [("127.0.0.1", 0), ("127.255.255.255", 9)])
def test_f24_a_peer_that_none_can_be_answered_costs_no_socket(nobody: Address) -> None:
    async def test() -> None:
        link = await open_link("udpin:127.0.0.1:0", Inbox())
        assert isinstance(link, UdpLink)
        assert not link.send(b"into the void", nobody)
        assert link.counters["network_error"] + link.counters["no_peer"] == 1
        assert link._retry is None, "what came in meanwhile would be lost with the socket"
        link.close()

    run(test)


def test_who_speaks_from_port_0_and_wants_no_answer_is_heard_and_takes_nobodys_place() -> None:
    async def test() -> None:
        link = await open_link("udpin:127.0.0.1:0", inbox := Inbox())
        port = link.local_address[1]
        peer = await open_link(f"udpout:127.0.0.1:{port}", at_peer := Inbox())
        peer.send(b"hello")
        await inbox.count(1)
        try:
            raw = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_UDP)
        except PermissionError:
            pytest.skip("a raw socket is for the superuser")
        with raw:
            raw.sendto(struct.pack("!HHHH", 0, port, 8 + 5, 0) + b"quiet", ("127.0.0.1", 0))
        assert (await inbox.count(2))[1] == b"quiet"
        assert link.send(b"answer")
        assert await at_peer.count(1) == [b"answer"]
        link.close()
        peer.close()

    run(test)


def test_f24_a_socket_that_cannot_be_made_is_tried_again_within_a_second() -> None:
    async def test() -> None:
        inbox = Inbox()
        link = await open_link("udpin:127.0.0.1:0", inbox)
        assert isinstance(link, UdpLink)
        with open(os.devnull, "wb") as nothing:
            os.dup2(nothing.fileno(), link._socket.fileno())
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as squatter:
            squatter.bind(link.local_address)  # the port is taken while we are away
            link.send(b"lost", ("127.0.0.1", 9))
            await counted(link, "socket_lost")
        await counted(link, "socket_made_anew")
        link.close()
        closed = await open_link("udpin:127.0.0.1:0", inbox)
        assert isinstance(closed, UdpLink)
        with open(os.devnull, "wb") as nothing:
            os.dup2(nothing.fileno(), closed._socket.fileno())
        closed.send(b"lost", ("127.0.0.1", 9))
        closed.close()
        closed._make_anew()
        assert closed.counters["socket_made_anew"] == 0

    run(test)


def test_a_larger_receive_buffer_is_asked_for_than_a_socket_has() -> None:
    async def test() -> None:
        link = await open_link("udpin:127.0.0.1:0", Inbox())
        assert isinstance(link, UdpLink)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            usual, granted = (each.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) for each in (other, link._socket))
        assert granted > usual
        link.close()

    run(test)


def test_f25_a_handler_that_raises_costs_its_datagram_only() -> None:
    async def test() -> None:
        inbox = Inbox()

        def fragile(data: bytes, address: Address) -> None:
            if data == b"poison":
                raise RuntimeError("no")
            inbox(data, address)

        server = await open_link("udpin:127.0.0.1:0", fragile)
        client = await open_link(f"udpout:127.0.0.1:{server.local_address[1]}", Inbox())
        client.send(b"poison")
        client.send(b"good")
        assert await inbox.count(1) == [b"good"]
        assert server.counters["handler_error"] == 1
        assert server.counters["handler_error_RuntimeError"] == 1
        server.close()
        client.close()

    run(test)


def test_a_handler_may_close_its_link() -> None:
    async def test() -> None:
        links: list[Link] = []
        closed = asyncio.Event()

        def close(_: bytes, __: Address) -> None:
            links[0].close()
            closed.set()

        server = await open_link("udpin:127.0.0.1:0", close)
        links.append(server)
        client = await open_link(f"udpout:127.0.0.1:{server.local_address[1]}", Inbox())
        client.send(b"1")
        client.send(b"2")
        await asyncio.wait_for(closed.wait(), PATIENCE_S)
        assert not server.send(b"", ("127.0.0.1", 9))
        client.close()

    run(test)


def test_a_datagram_larger_than_udp_is_counted_not_raised() -> None:
    async def test() -> None:
        client = await open_link("udpout:127.0.0.1:9", Inbox())
        assert not client.send(bytes(70_000))
        assert client.counters["network_error"] == 1
        client.close()

    run(test)


@pytest.mark.parametrize(("scheme", "shows"), [("udpin", "ss -ulpn"), ("tcpin", "ss -tlpn")])
def test_a_port_in_use_is_named_with_a_way_out(scheme: str, shows: str) -> None:
    async def test() -> None:
        first = await open_link(f"{scheme}:127.0.0.1:0", Inbox())
        port = first.local_address[1]
        with pytest.raises(LinkError, match=f"port {port} is in use") as caught:
            await open_link(f"{scheme}:127.0.0.1:{port}", Inbox())
        assert f"{scheme}:127.0.0.1:{port + 1}" in str(caught.value) and shows in str(caught.value)
        first.close()

    run(test)


def test_addresses_that_are_none_of_ours() -> None:
    async def test() -> None:
        with pytest.raises(LinkError, match="no address of this machine"):
            await open_link("udpin:192.0.2.1:14540", Inbox())
        with pytest.raises(LinkError, match="nobody listens there"):
            await open_link(f"tcpout:127.0.0.1:{free_port(socket.SOCK_STREAM)}", Inbox())
        with pytest.raises(LinkError, match="a whole network"):
            await open_link("udpout:127.255.255.255:14550", Inbox())
        for scheme in ("udpout", "tcpout", "tcpin"):
            with pytest.raises(LinkError, match=rf"^{scheme}:\w+:1: no such host: (?!{scheme})"):
                await open_link(f"{scheme}:{'long' * 20}:1", Inbox())

    run(test)


@pytest.mark.parametrize("url", ["udpin:localhost:0", "udpout:localhost:9", "tcpin:localhost:0"])
def test_a_name_with_addresses_of_both_families_is_taken_by_that_of_ipv4(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def both(host: str, port: int, *_: object, type: int = 0, **__: object) -> list[tuple[object, ...]]:
        return [
            (socket.AF_INET6, type, 0, "", ("::1", port, 0, 0)),  # most machines have it first
            (socket.AF_INET, type, 0, "", ("127.0.0.1", port)),
        ]

    async def test() -> None:
        monkeypatch.setattr(socket, "getaddrinfo", both)
        link = await open_link(url, Inbox())
        assert link.local_address[0] == "127.0.0.1"
        if isinstance(link, TcpLink):
            assert link._server is not None
            assert len(link._server.sockets) == 1, "each family would have a port of its own"
        link.close()

    run(test)


def test_an_address_of_one_link_keeps_its_scope_and_any_other_is_host_and_port() -> None:
    peer = host_and_port(("fe80::1", 14550, 0, 1))
    [(*_, answered)] = socket.getaddrinfo(*peer, type=socket.SOCK_DGRAM)  # what the kernel is handed
    assert answered == ("fe80::1", 14550, 0, 1)
    assert host_and_port(("::1", 14550, 0, 0)) == ("::1", 14550)
    assert host_and_port(("127.0.0.1", 14550)) == ("127.0.0.1", 14550)


@pytest.mark.parametrize("scheme", ["udp", "tcp"])
def test_ipv6_on_loopback_is_heard_and_answered(scheme: str) -> None:
    async def test() -> None:
        try:
            server = await open_link(f"{scheme}in:[::1]:0", at_server := Inbox())
        except LinkError:
            pytest.skip("this machine has no IPv6")
        client = await open_link(f"{scheme}out:[::1]:{server.local_address[1]}", at_client := Inbox())
        client.send(heartbeat(1))
        await at_server.count(1)
        assert at_server.datagrams[0][1] == client.local_address and client.local_address[0] == "::1"
        assert server.send(heartbeat(2), client.local_address)
        assert await at_client.count(1) == [heartbeat(2)]
        server.close()
        client.close()

    run(test)


def test_tcp_streams_come_out_as_frames() -> None:
    async def test() -> None:
        at_server, at_client = Inbox(), Inbox()
        server = await open_link("tcpin:127.0.0.1:0", at_server)
        assert not server.send(b"nobody")
        client = await open_link(f"tcpout:127.0.0.1:{server.local_address[1]}", at_client)
        frames = [heartbeat(seq) for seq in range(5)]
        stream = b"".join(frames)
        assert client.send(stream[:7]) and client.send(stream[7:30]) and client.send(b"junk" + stream[30:])
        # The junk tears one frame; what is whole arrives whole, in order.
        got = await at_server.count(4)
        assert got == [frame for frame in frames if frame in got] and len(got) == 4
        assert server.counters["garbage"] + server.counters["bad_checksum"] > 0
        server.send(frames[0])
        assert await at_client.count(1) == [frames[0]]
        server.send(frames[1], at_server.datagrams[0][1])
        assert await at_client.count(2) == frames[:2]
        client.close()
        await counted(server, "peer_left")
        assert not server.send(frames[0])
        server.close()

    run(test)


def test_tcp_a_peer_that_vanishes_without_a_farewell_is_noticed_by_both_ends() -> None:
    async def test() -> None:
        server = await open_link("tcpin:127.0.0.1:0", at_server := Inbox())
        client = await open_link(f"tcpout:127.0.0.1:{server.local_address[1]}", Inbox())
        client.send(heartbeat())
        await at_server.count(1)
        for link in (server, client):
            assert isinstance(link, TcpLink)
            [peer] = link._peers.values()
            assert peer.transport is not None
            sock = peer.transport.get_extra_info("socket")
            assert sock.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
            idle, every, probes = (
                sock.getsockopt(socket.IPPROTO_TCP, option)
                for option in (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT)
            )
            assert idle + every * probes == VANISHED_S  # where nothing is said
            assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 1000 * VANISHED_S  # where it is
        client.close()
        server.close()

    run(test)


def test_tcp_client_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ridlink.links.tcp.RECONNECT_S", 0.01)

    async def test() -> None:
        at_server = Inbox()
        server = await open_link("tcpin:127.0.0.1:0", at_server)
        port = server.local_address[1]
        client = await open_link(f"tcpout:127.0.0.1:{port}", Inbox())
        client.send(heartbeat())
        await at_server.count(1)
        server.close()
        await counted(client, "refused")
        server = await open_link(f"tcpin:127.0.0.1:{port}", at_server)
        assert isinstance(client, TcpLink) and client._retry is not None
        await asyncio.wait_for(client._retry, PATIENCE_S)  # ends when there is a connection again
        assert client.send(heartbeat(1))
        await at_server.count(2)
        client.close()
        server.close()

    run(test)


def test_tcp_peer_that_does_not_read_loses_what_is_stale() -> None:
    async def test() -> None:
        inbox = Inbox()
        server = await open_link("tcpin:127.0.0.1:0", inbox)
        with socket.create_connection(server.local_address) as deaf:
            deaf.sendall(heartbeat())
            await inbox.count(1)
            for _ in range(2000):
                if not server.send(bytes(16_000)):
                    break
            assert server.counters["send_buffer_full"] >= 1
        server.close()
        assert isinstance(server, TcpLink)

    run(test)


def test_tcp_peers_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ridlink.links.tcp.MAX_PEERS", 1)

    async def test() -> None:
        at_server = Inbox()
        server = await open_link("tcpin:127.0.0.1:0", at_server)
        with socket.create_connection(server.local_address) as first:
            first.sendall(heartbeat())
            await at_server.count(1)
            with socket.create_connection(server.local_address):
                await counted(server, "too_many_peers")
        server.close()

    run(test)


def test_memory_pair() -> None:
    at_first: list[tuple[bytes, Address]] = []
    at_second: list[tuple[bytes, Address]] = []
    first, second = memory_link_pair(lambda *a: at_first.append(a), lambda *a: at_second.append(a))
    assert first.send(b"there") and second.send(b"back", first.local_address)
    assert at_second == [(b"there", first.local_address)]
    assert at_first == [(b"back", second.local_address)]
    assert not first.send(b"elsewhere", ("memory", 9))
    first.close()
    first.close()
    assert not first.send(b"") and not second.send(b"")


def test_a_server_that_has_gone_when_the_connection_stands_is_tried_again(caplog: pytest.LogCaptureFixture) -> None:
    """It resets what it accepts, until it is told to stay."""

    async def body() -> None:
        loop = asyncio.get_running_loop()
        with socket.create_server(("127.0.0.1", 0)) as server:
            url = parse_link_url(f"tcpout:127.0.0.1:{server.getsockname()[1]}")
            link = TcpLink(url, lambda data, address: None)
            client = socket.create_connection(server.getsockname())
            accepted, _ = server.accept()
            accepted.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            accepted.close()
            client.setblocking(False)
            await loop.create_connection(lambda: _Peer(link), sock=client)
            server.setblocking(False)
            async with asyncio.timeout(PATIENCE_S):
                accepted, _ = await loop.sock_accept(server)
                with accepted:
                    while not link.send(b"hello"):
                        await turn()
                    assert await loop.sock_recv(accepted, 5) == b"hello"
            link.close()

    run(body)
    assert not caplog.records
