"""A broker in this process, bridges to it, and somebody who listens there."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from typing import Any

import pytest

pytest.importorskip("aiomqtt", reason="needs ridlink[mqtt]")
pytest.importorskip("amqtt", reason="needs amqtt, a broker")

import aiomqtt
from amqtt.broker import Broker

from ridlink.links import parse_link_url
from ridlink.mqtt import BrokerUrl, Publisher, PublisherSettings, Topics
from ridlink.mqtt.bridge import Bridge

TOPICS = Topics("here")
PATIENCE_S = 20.0
SOURCE = parse_link_url("udpin:127.0.0.1:0")


@pytest.fixture(autouse=True)
def collected() -> Iterator[None]:
    """What the broker in this process leaves open is collected here, where that is no failure, and not by chance in
    whatever is tested next."""
    yield
    gc.collect()


@contextlib.asynccontextmanager
async def a_broker(port: int, **listener: Any) -> AsyncIterator[None]:
    logging.getLogger("amqtt").setLevel(logging.CRITICAL)
    logging.getLogger("transitions").setLevel(logging.CRITICAL)
    broker = Broker(
        {
            "listeners": {"default": {"type": "tcp", "bind": f"127.0.0.1:{port}", **listener}},
            "plugins": {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}},
        }
    )
    await broker.start()
    try:
        yield
    finally:
        try:
            await asyncio.wait_for(broker.shutdown(), 5.0)
        except TimeoutError:
            # It may wait for ever for a client that has gone: on a busy machine for its reader, which is left out now;
            # under Python 3.12 for its transport, after all else.
            if broker.transitions.state == "started":
                await broker.shutdown()


class Heard:
    """Everything published under the topics of a site."""

    def __init__(self) -> None:
        self.messages: list[tuple[str, bytes]] = []
        self.changed = asyncio.Condition()

    async def listen(self, port: int, ready: asyncio.Event) -> None:
        async with aiomqtt.Client("127.0.0.1", port) as client:
            await client.subscribe("ridlink/#")
            ready.set()
            async for message in client.messages:
                async with self.changed:
                    self.messages.append((str(message.topic), bytes(message.payload)))  # type: ignore[arg-type]
                    self.changed.notify_all()

    async def until(self, condition: Callable[[list[tuple[str, bytes]]], bool]) -> None:
        async with self.changed:
            await asyncio.wait_for(self.changed.wait_for(lambda: condition(self.messages)), PATIENCE_S)


@contextlib.asynccontextmanager
async def a_listener(port: int) -> AsyncIterator[Heard]:
    heard, ready = Heard(), asyncio.Event()
    task = asyncio.create_task(heard.listen(port, ready))
    try:
        await asyncio.wait_for(ready.wait(), PATIENCE_S)
        yield heard
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


@contextlib.asynccontextmanager
async def a_bridge(
    port: int, publisher: Publisher | None = None, **options: Any
) -> AsyncIterator[tuple[Bridge, Publisher]]:
    publisher = publisher or Publisher(PublisherSettings(TOPICS, rate_hz=10.0))
    bridge = Bridge(BrokerUrl("127.0.0.1", port, False), TOPICS, publisher, SOURCE, **options)
    stop = asyncio.Event()
    task = asyncio.create_task(bridge.run(stop))
    connected = asyncio.create_task(bridge.connected.wait())
    await asyncio.wait({task, connected}, timeout=PATIENCE_S, return_when=asyncio.FIRST_COMPLETED)
    try:
        if task.done():
            task.result()
        yield bridge, publisher
    finally:
        connected.cancel()
        stop.set()
        await asyncio.wait_for(asyncio.gather(task, return_exceptions=True), PATIENCE_S)


def run(body: Callable[[], Awaitable[None]]) -> None:
    asyncio.run(asyncio.wait_for(body(), 60.0))
