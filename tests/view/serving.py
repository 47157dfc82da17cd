"""A server in this process, and pages that speak to it over loopback."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

from websockets.asyncio.client import ClientConnection, connect

from ridlink.observer import Sky
from ridlink.view.scenery import Scenery
from ridlink.view.server import ViewServer
from ridlink.view.show import Show
from tests.observer.flights import HOME, Flyer, frames

PATIENCE_S = 20.0
HEAD_ON = [Flyer(1, (0.0, 0.0), (10.0, 0.0), b"ALPHA"), Flyer(2, (300.0, 5.0), (-10.0, 0.0), b"BRAVO")]


def a_show(flyers: list[Flyer] = HEAD_ON, until_s: float = 3.0, **facts: Any) -> Show:
    """What these flyers do, seen each tenth of a second; their truth is what they report."""
    show = Show(Scenery("a test", "file", **({"live": False, "origin": HOME} | facts)))
    sky, due_s = Sky(origin=HOME), 0.1
    for time_s, frame in [*frames(flyers, until_s), (until_s, None)]:
        while time_s >= due_s - 1e-6:
            show.add(sky.at(due_s))
            due_s = round(due_s + 0.1, 6)
        if frame is not None:
            sky.receive(frame, time_s)
    return show


@contextlib.asynccontextmanager
async def serving(show: Show, **options: Any) -> AsyncIterator[ViewServer]:
    server = ViewServer(show, **({"port": 0} | options))
    async with server.serving():
        yield server


@contextlib.asynccontextmanager
async def a_page(server: ViewServer, **options: Any) -> AsyncIterator[ClientConnection]:
    address = server.url.replace("http", "ws") + "ws/v1"
    async with connect(address, **({"compression": None} | options)) as page:
        yield page


async def heard(page: ClientConnection, kind: str, **facts: Any) -> dict[str, Any]:
    """The next message of a kind that says so."""
    async with asyncio.timeout(PATIENCE_S):  # wait_for of Python 3.11 can lose a cancellation, such as that of `run`
        while True:
            message = json.loads(await page.recv())
            if message["type"] == kind and all(message[key] == value for key, value in facts.items()):
                return message  # type: ignore[no-any-return]


def run(body: Callable[[], Awaitable[None]]) -> None:
    asyncio.run(asyncio.wait_for(body(), 60.0))


MB = 2**20


UPGRADE = (
    b"GET /ws/v1 HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)


def text_frame(text: bytes) -> bytes:
    """A masked WebSocket frame, with a mask of zeros."""
    return bytes((0x81, 0x80 | len(text))) + bytes(4) + text
