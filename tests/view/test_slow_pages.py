"""Pages that read nothing: they cost a bounded amount of memory, disturb nobody, and are dropped."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from pathlib import Path

import pytest

from tests.observer.flights import Flyer
from tests.view.serving import MB, PATIENCE_S, UPGRADE, a_page, a_show, heard, run, serving, text_frame

pytest.importorskip("uvicorn", reason="needs ridlink[web]")

from ridlink.view import door
from ridlink.view import server as served

SILENT = 50


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")


async def a_silent_page(port: int) -> socket.socket:
    """Asks for everything there is, over and over, and reads no more than the first byte of the answer."""
    sock = socket.socket()
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    sock.setblocking(False)
    loop = asyncio.get_running_loop()
    await loop.sock_connect(sock, ("127.0.0.1", port))
    await loop.sock_sendall(sock, UPGRADE)
    await loop.sock_recv(sock, 1)
    with contextlib.suppress(OSError):  # refused
        await loop.sock_sendall(sock, 20 * text_frame(b'{"window":[0,1000],"series":[0,1000],"id":1}'))
    return sock


def test_f31_fifty_pages_that_never_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(served, "UNREAD_S", 1.0)
    monkeypatch.setattr(door, "NEWCOMER_EVERY_S", 0.0)
    crowd = [Flyer(k + 1, (40.0 * k, 0.0), (5.0, 0.0), b"CROWD%03d" % k) for k in range(60)]

    async def body() -> None:
        show = a_show(crowd, 4.0, live=True)
        async with serving(show) as server, contextlib.AsyncExitStack() as stack:
            port = int(server.url.rsplit(":", 1)[1].strip("/"))
            reader = await stack.enter_async_context(a_page(server))
            await heard(reader, "instant")
            before = resident_bytes()
            for _ in range(SILENT):
                stack.callback((await a_silent_page(port)).close)
            most = before
            while server.pages == 1 or server.counters["refused"] < SILENT + 1 - served.MOST_PAGES:
                server.publish()
                await heard(reader, "instant")
            async with asyncio.timeout(PATIENCE_S):
                while server.pages > 1:
                    server.publish()
                    await heard(reader, "instant")  # whoever reads is served all the while
                    most = max(most, resident_bytes())
            assert server.counters["served"] == served.MOST_PAGES
            assert most - before < 20 * MB

    run(body)
