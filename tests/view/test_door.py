"""Connections that flood, idle or come in crowds: those who look on are served all the while."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import resource
import socket
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from tests.view.serving import MB, PATIENCE_S, UPGRADE, a_page, a_show, heard, run, serving, text_frame

pytest.importorskip("uvicorn", reason="needs ridlink[web]")

from ridlink.errors import LinkError
from ridlink.view import door as doors
from ridlink.view.door import Door

FLOOD = """
import socket, sys
opening, words = (bytes.fromhex(text) for text in sys.argv[2:])
while True:
    try:
        with socket.create_connection(("127.0.0.1", int(sys.argv[1]))) as sock:
            sock.sendall(opening)
            sock.recv(1)
            while True:
                sock.sendall(words)
    except (ConnectionResetError, BrokenPipeError):
        continue
"""
INSTANTS_A_SECOND = 10
PING = b"\x89\x80" + bytes(4)
FLOODS = {"pings": 8000 * PING, "requests": 3500 * text_frame(b'{"at":1}'), "mistakes": 8000 * text_frame(b"")}


def port_of(url: str) -> int:
    return int(url.rsplit(":", 1)[1].strip("/"))


@pytest.mark.parametrize("kind", FLOODS)
def test_f31_who_floods_takes_nobody_their_instants(kind: str) -> None:
    async def body() -> None:
        async with serving(a_show(live=True)) as server, a_page(server) as page:
            await heard(page, "instant")
            arguments = "-c", FLOOD, str(port_of(server.url)), UPGRADE.hex(), FLOODS[kind].hex()
            floods = [await asyncio.create_subprocess_exec(sys.executable, *arguments) for _ in range(4)]
            try:
                while server.counters["served"] == 1:
                    await asyncio.sleep(0.01)
                async with asyncio.timeout(PATIENCE_S):  # ten times as long as they take
                    for _ in range(10 * INSTANTS_A_SECOND):
                        server.publish()
                        await heard(page, "instant")
                assert all(flood.returncode is None for flood in floods)
            finally:
                for flood in floods:
                    flood.kill()
                    await flood.wait()

    run(body)


def test_f31_pings_whose_answers_nobody_reads_fill_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doors, "SHARE", 1e9)
    ping = b"\x89\xfd" + bytes(4) + 125 * b"x"

    async def body() -> None:
        async with serving(a_show()) as server:
            loop = asyncio.get_running_loop()
            with socket.socket() as sock:
                for buffer in (socket.SO_RCVBUF, socket.SO_SNDBUF):
                    sock.setsockopt(socket.SOL_SOCKET, buffer, 4096)
                sock.setblocking(False)
                await loop.sock_connect(sock, ("127.0.0.1", port_of(server.url)))
                await loop.sock_sendall(sock, UPGRADE)
                await loop.sock_recv(sock, 1)
                for _ in range(100):
                    await loop.sock_sendall(sock, 400 * ping)
                await loop.sock_sendall(sock, text_frame(b'{"at":1,"id":9}'))
                answered, last = 0, b""
                while b'"id":9' not in last:
                    piece = await asyncio.wait_for(loop.sock_recv(sock, 2**16), PATIENCE_S)
                    answered, last = answered + len(piece), last[-100:] + piece
                assert answered < MB, "5 MB were sent"

    run(body)


def test_f31_who_asks_for_nothing_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doors, "VISIT_S", 0.2)

    async def body() -> None:
        async with serving(a_show()) as server, a_page(server) as page:
            for said in (b"", b"GET / HT", b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\nGET"):
                reader, writer = await asyncio.open_connection("127.0.0.1", port_of(server.url))
                writer.write(said)
                answer = await asyncio.wait_for(reader.read(), PATIENCE_S)
                assert answer.endswith(b"ok\n") if said.endswith(b"GET") else not answer
                writer.close()
            server.publish()
            await heard(page, "instant")  # a page may say nothing for as long as it likes

    run(body)


HEALTHZ = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"


async def a_visit(stack: contextlib.AsyncExitStack, port: int) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    stack.callback(writer.close)
    return reader, writer


def test_f31_who_idles_longest_makes_room_for_a_newcomer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doors, "MOST_CONNECTIONS", 4)

    async def body() -> None:
        async with serving(a_show()) as server, a_page(server) as page, contextlib.AsyncExitStack() as stack:
            port = port_of(server.url)
            idle, trickling, asking = [await a_visit(stack, port) for _ in range(3)]
            trickling[1].write(b"GET / HT")
            asking[1].write(HEALTHZ)
            await asyncio.wait_for(asking[0].readuntil(b"ok\n"), PATIENCE_S)
            for goes in (idle, trickling):  # in the order in which they came
                newcomer = await a_visit(stack, port)
                newcomer[1].write(HEALTHZ)
                await asyncio.wait_for(newcomer[0].readuntil(b"ok\n"), PATIENCE_S)
                assert await asyncio.wait_for(goes[0].read(), PATIENCE_S) == b""
                asking[1].write(HEALTHZ)
                await asyncio.wait_for(asking[0].readuntil(b"ok\n"), PATIENCE_S)
            assert (await heard(page, "health"))["rejects"] == {"made_room": 2}, "a page never does"

    run(body)


def test_f31_where_all_are_pages_a_newcomer_is_turned_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doors, "MOST_CONNECTIONS", 1)

    async def body() -> None:
        async with serving(a_show()) as server, a_page(server) as page, contextlib.AsyncExitStack() as stack:
            reader, _ = await a_visit(stack, port_of(server.url))
            with contextlib.suppress(ConnectionResetError):
                assert await asyncio.wait_for(reader.read(), PATIENCE_S) == b""
            assert (await heard(page, "health"))["rejects"] == {"turned_away": 1}

    run(body)


def test_f31_a_page_too_many_that_says_no_farewell_keeps_no_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """It has become a WebSocket, so that it makes no room for newcomers."""
    monkeypatch.setattr("ridlink.view.server.MOST_PAGES", 1)
    monkeypatch.setattr("ridlink.view.server.LEAVES_S", 0.01)

    async def body() -> None:
        async with serving(a_show()) as server, a_page(server) as page, contextlib.AsyncExitStack() as stack:
            await heard(page, "hello")
            reader, writer = await a_visit(stack, port_of(server.url))
            writer.write(UPGRADE)
            said = await asyncio.wait_for(reader.read(), PATIENCE_S / 4.0)
            assert said.endswith(b"1 pages look on already"), said

    run(body)


def the_listening_socket(port: int) -> socket.socket:
    """Of this process, once more."""
    for entry in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):
            sock = socket.socket(fileno=os.dup(int(entry.name)))
            if sock.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN) and sock.getsockname()[1] == port:
                return sock
            sock.close()
    raise AssertionError(f"nobody listens on {port}")


def test_a_socket_that_is_shut_under_the_server_ends_what_is_served_beside_it() -> None:
    async def body() -> None:
        with pytest.raises(LinkError, match="lets nobody in any more: Invalid argument"):
            async with serving(a_show()) as server, a_page(server) as page:
                await heard(page, "hello")
                with the_listening_socket(port_of(server.url)) as listening:
                    listening.shutdown(socket.SHUT_RDWR)
                await asyncio.Event().wait()

    run(body)


class Told(asyncio.Protocol):
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.said: list[bytes] = []
        self.changed = asyncio.Event()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self.said.append(data)
        self.changed.set()


@contextlib.asynccontextmanager
async def a_door(*protocols: Told, kind: type[socket.socket] = socket.socket) -> AsyncIterator[tuple[Door, int]]:
    waiting = iter(protocols)
    door = Door(lambda: next(waiting))
    with kind() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        task = asyncio.create_task(door.run(listening))
        try:
            yield door, listening.getsockname()[1]
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            for protocol in protocols:
                protocol.transport.close()
            await asyncio.sleep(0)


def test_f31_words_are_read_in_small_pieces_with_pauses_for_others(monkeypatch: pytest.MonkeyPatch) -> None:
    async def body() -> None:
        first, second = Told(), Told()
        async with a_door(first, second) as (door, port):
            _, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(bytes(100_000))
            while sum(map(len, first.said)) < 100_000:
                first.changed.clear()
                await asyncio.wait_for(first.changed.wait(), PATIENCE_S)
            assert max(map(len, first.said)) <= doors.READ_BYTES
            monkeypatch.setattr(doors, "SHARE", 1e-12)
            pieces = len(first.said)
            writer.write(bytes(100_000))
            first.changed.clear()
            await asyncio.wait_for(first.changed.wait(), PATIENCE_S)
            _, other = await asyncio.open_connection("127.0.0.1", port)
            other.write(b"hello")
            await asyncio.wait_for(second.changed.wait(), PATIENCE_S)
            assert len(first.said) == pieces + 1, "it has had its share"
            writer.close()
            other.close()
            assert not door.counters

    run(body)


@pytest.mark.parametrize("cause", ["EPERM", "EPROTO", "ENETDOWN", "ECONNABORTED"])
def test_f31_what_the_network_did_to_one_newcomer_keeps_no_other_out(
    cause: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Linux reports it from accept; a firewall that forbids a connection does so, too."""
    monkeypatch.setattr(doors, "OUT_OF_SOCKETS_S", 0.0)
    failing = [getattr(errno, cause)]

    class Failing(socket.socket):
        def accept(self) -> tuple[socket.socket, object]:
            accepted = super().accept()
            if failing:
                accepted[0].close()
                raise OSError(failing.pop(), cause)
            return accepted

    async def body() -> None:
        told = Told()
        async with a_door(told, kind=Failing) as (door, port):
            with socket.create_connection(("127.0.0.1", port)), socket.create_connection(("127.0.0.1", port)) as second:
                second.sendall(b"hello")
                await asyncio.wait_for(told.changed.wait(), PATIENCE_S)
            assert told.said == [b"hello"] and door.counters == {"not_accepted": 1}

    run(body)


def test_f31_without_sockets_left_newcomers_wait_and_nothing_is_logged(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(doors, "OUT_OF_SOCKETS_S", 0.01)
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)

    async def body() -> None:
        told = Told()
        async with a_door(told) as (door, port):
            with socket.socket() as sock:
                highest = max(int(entry.name) for entry in Path("/proc/self/fd").iterdir())
                sock.setblocking(False)
                with contextlib.ExitStack() as taken:
                    while (free := taken.enter_context(socket.socket()).fileno()) < highest:
                        continue
                    resource.setrlimit(resource.RLIMIT_NOFILE, (free + 1, limits[1]))
                    await asyncio.get_running_loop().sock_connect(sock, ("127.0.0.1", port))
                    while not door.counters["not_accepted"]:
                        await asyncio.sleep(0.01)
                    resource.setrlimit(resource.RLIMIT_NOFILE, limits)
                await asyncio.get_running_loop().sock_sendall(sock, b"hello")
                await asyncio.wait_for(told.changed.wait(), PATIENCE_S)
                assert told.said == [b"hello"]

    try:
        run(body)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert not caplog.records
