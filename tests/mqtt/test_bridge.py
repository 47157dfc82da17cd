"""The bridge against a broker in this process, over TCP and UDP on loopback."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import socket
import time
from typing import Any

import pytest

pytest.importorskip("aiomqtt", reason="needs ridlink[mqtt]")
pytest.importorskip("amqtt", reason="needs amqtt, a broker")

import aiomqtt

from ridlink.errors import ConfigError
from ridlink.links import open_link, parse_link_url
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.mqtt import BrokerUrl, Publisher, PublisherSettings
from ridlink.mqtt.bridge import Bridge, BrokerError
from ridlink.mqtt.outbox import Outgoing
from ridlink.observer import Sky
from tests.loopback import free_port, turn
from tests.mqtt.brokers import PATIENCE_S, SOURCE, TOPICS, a_bridge, a_broker, a_listener, run
from tests.mqtt.brokers import collected as collected
from tests.observer.flights import Flyer, frames

pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """The broker in this process answers nothing to MQTT 5, in which bridges with a feed ask first."""
    monkeypatch.setattr("ridlink.mqtt.bridge.ANSWER_S", 1.0)


def feed_the(publisher: Publisher) -> None:
    now_s = time.monotonic()
    for time_s, frame in frames([Flyer(1, (0.0, 0.0), (5.0, 0.0), b"ALPHA")], 1.0):
        publisher.receive(frame, now_s + time_s - 1.0)


def test_states_arrive_and_the_end_is_announced() -> None:
    async def body() -> None:
        port = free_port(socket.SOCK_STREAM)
        async with a_broker(port), a_listener(port) as heard:
            async with a_bridge(port) as (_, publisher):
                feed_the(publisher)
                await heard.until(lambda seen: any(topic == TOPICS.state("ALPHA") for topic, _ in seen))
            for topic in (TOPICS.availability, TOPICS.aircraft_availability("ALPHA")):
                await heard.until(lambda seen, topic=topic: (topic, b"offline") in seen)  # type: ignore[misc]
                assert (topic, b"online") in heard.messages
        [state, *_] = [json.loads(payload) for topic, payload in heard.messages if topic == TOPICS.state("ALPHA")]
        assert state["uas"] == "ALPHA"

    run(body)


def test_f30_a_broker_that_comes_back_gets_the_newest_first_and_nobody_is_disturbed() -> None:
    async def body() -> None:
        port = free_port(socket.SOCK_STREAM)
        said: asyncio.Queue[str] = asyncio.Queue()
        async with contextlib.AsyncExitStack() as life:
            async with a_broker(port):
                bridge, publisher = await life.enter_async_context(a_bridge(port, on_event=said.put_nowait))
                feed_the(publisher)
            while "trying again" not in await said.get():
                continue
            async with a_broker(port), a_listener(port) as heard:
                feed_the(publisher)
                await heard.until(lambda seen: any(topic == TOPICS.state("ALPHA") for topic, _ in seen))
                assert bridge.counters["connections"] == 2
                assert len(bridge.outbox) <= 1000

    run(body)


class Silent:
    """So much of MQTT 3.1.1 as a broker needs that dies on whoever tells it of an encounter, or of something else, the
    first time, and refuses every subscription."""

    def __init__(self, dies_of: bytes = b"/encounter/") -> None:
        self.dies_of = dies_of
        self.connections = 0
        self.versions: list[int] = []
        self.told_again = asyncio.Event()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        with contextlib.closing(writer), contextlib.suppress(asyncio.IncompleteReadError):
            while True:
                kind, body = await self._packet(reader)
                if kind >> 4 == 1:  # CONNECT
                    self.versions.append(body[6])
                    writer.write(b"\x20\x02\x00\x00" if body[6] == 4 else b"\x20\x02\x00\x01")
                elif kind & 0xF6 == 0x32:  # PUBLISH, QoS 1
                    length = int.from_bytes(body[:2], "big")
                    if self.dies_of in body[2 : 2 + length]:
                        if self.connections == 1:
                            return
                        self.told_again.set()
                    self.acknowledge(body[2 : 2 + length], body[2 + length : 4 + length], writer)
                elif kind >> 4 == 8:  # SUBSCRIBE
                    writer.write(b"\x90\x03" + body[:2] + b"\x80")

    def acknowledge(self, topic: bytes, packet: bytes, writer: asyncio.StreamWriter) -> None:
        writer.write(b"\x40\x02" + packet)

    async def _packet(self, reader: asyncio.StreamReader) -> tuple[int, bytes]:
        kind, length, shift = (await reader.readexactly(1))[0], 0, 0
        while True:
            (digit,) = await reader.readexactly(1)
            length |= (digit & 0x7F) << shift
            shift += 7
            if digit < 0x80:
                return kind, await reader.readexactly(length)


class Slow(Silent):
    """Acknowledges when so many wait for it, until it has heard all that it will be greeted with."""

    def __init__(self, waiting: int, greeting: int) -> None:
        super().__init__(b"?")
        self.waiting = waiting
        self.greeting = greeting
        self.topics: list[bytes] = []
        self.held: list[bytes] = []

    def acknowledge(self, topic: bytes, packet: bytes, writer: asyncio.StreamWriter) -> None:
        self.topics.append(topic)
        self.held.append(packet)
        if len(self.held) >= self.waiting or len(self.topics) >= self.greeting:
            for one in self.held:
                super().acknowledge(topic, one, writer)
            self.held.clear()


def test_f30_what_was_on_its_way_when_the_broker_died_is_told_to_the_next_one() -> None:
    async def body() -> None:
        silent = Silent()
        server = await asyncio.start_server(silent.serve, "127.0.0.1", 0)
        async with server, a_bridge(server.sockets[0].getsockname()[1]) as (bridge, _):
            bridge.outbox.put(Outgoing("here/encounter/a~b", b"{}", 1))
            await asyncio.wait_for(silent.told_again.wait(), PATIENCE_S)
        assert bridge.counters["connections"] == 2

    run(body)


class Mute:
    """Takes every connection and says nothing."""

    def __init__(self) -> None:
        self.open = self.most_open = self.connections = 0
        self.third = asyncio.Event()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        self.open += 1
        self.most_open = max(self.most_open, self.open)
        if self.connections == 3:
            self.third.set()
        with contextlib.closing(writer):
            await reader.read()
        self.open -= 1


def test_f30_a_broker_that_does_not_answer_has_one_connection_open_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every attempt left one: after some hours of them no file could be opened any more."""
    monkeypatch.setattr("ridlink.mqtt.bridge.ANSWER_S", 0.2)
    monkeypatch.setattr("ridlink.mqtt.bridge.BACK_OFF_S", (0.2, 0.2))

    async def body() -> None:
        mute = Mute()
        server = await asyncio.start_server(mute.serve, "127.0.0.1", 0)
        broker = BrokerUrl("127.0.0.1", server.sockets[0].getsockname()[1], False)
        bridge = Bridge(broker, TOPICS, Publisher(PublisherSettings(TOPICS)), SOURCE)
        async with server, asyncio.timeout(PATIENCE_S):
            task = asyncio.create_task(bridge.run(asyncio.Event()))
            await mute.third.wait()
            task.cancel()  # while it waits for an answer
            await asyncio.gather(task, return_exceptions=True)
            while mute.open:
                await turn()
        assert mute.most_open == 1

    run(body)


def test_f30_a_broker_that_dies_of_the_greeting_is_tried_again_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ridlink.mqtt.bridge.ANSWER_S", 1000.0)

    async def body() -> None:
        silent = Silent(dies_of=b"/availability")
        server = await asyncio.start_server(silent.serve, "127.0.0.1", 0)
        async with server, a_bridge(server.sockets[0].getsockname()[1]) as (bridge, _):
            await asyncio.wait_for(bridge.connected.wait(), PATIENCE_S)
        assert bridge.counters["connections"] == 2

    run(body)


class Leaving(Silent):
    """Dies of the next message once it is told to leave."""

    leaves = False

    def acknowledge(self, topic: bytes, packet: bytes, writer: asyncio.StreamWriter) -> None:
        if self.leaves:
            writer.transport.abort()
        else:
            super().acknowledge(topic, packet, writer)


def test_f30_a_broker_that_dies_of_the_farewell_is_nobodys_error() -> None:
    """asyncio wrote on stderr that nobody had asked how the connection ended."""
    complaints: list[dict[str, Any]] = []

    async def body() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: complaints.append(context))
        leaving = Leaving(b"?")
        server = await asyncio.start_server(leaving.serve, "127.0.0.1", 0)
        async with server, a_bridge(server.sockets[0].getsockname()[1]):
            leaving.leaves = True
        gc.collect()

    run(body)
    assert not complaints


def test_a_greeting_of_many_aircraft_does_not_wait_for_each_answer() -> None:
    async def body() -> None:
        publisher = Publisher(PublisherSettings(TOPICS))
        for _, frame in frames([Flyer(number, (0.0, 400.0 * number), (5.0, 0.0)) for number in range(1, 100)], 0.1):
            publisher.receive(frame, time.monotonic())
        publisher.step(time.monotonic(), time.time())
        greeting = [message.topic.encode() for message in publisher.greeting()]
        assert len(greeting) == 101
        slow = Slow(10, len(greeting))
        server = await asyncio.start_server(slow.serve, "127.0.0.1", 0)
        async with server, a_bridge(server.sockets[0].getsockname()[1], publisher) as (bridge, _):
            await asyncio.wait_for(bridge.connected.wait(), PATIENCE_S)
        assert slow.topics[: len(greeting)] == greeting
        assert bridge.counters["connections"] == 1

    run(body)


def test_a_feed_that_the_broker_refuses_is_one_line() -> None:
    async def body() -> None:
        silent = Silent()
        server = await asyncio.start_server(silent.serve, "127.0.0.1", 0)
        relay = parse_link_url("udpout:127.0.0.1:9")
        async with server:
            with pytest.raises(BrokerError, match=r"mqtt://127\.0\.0\.1:\d+: the feed 'sensors/#' is refused"):
                async with a_bridge(server.sockets[0].getsockname()[1], feed_topic="sensors/#", relay=relay):
                    pass
        assert silent.versions == [5, 4], "it was asked to keep long packets back, in words that it does not know"

    run(body)


@pytest.mark.parametrize(
    ("answer", "words", "options"),
    [
        ("20 02 00 04", "Bad user name or password", {}),
        ("20 02 00 05", "Not authorized", {}),
        ("20 03 00 86 00", "Bad user name or password", {"feed_topic": "sensors/#"}),
        ("20 03 00 87 00", "Not authorized", {"feed_topic": "sensors/#"}),
    ],
    ids=["4 of 3.1.1", "5 of 3.1.1", "134 of 5", "135 of 5"],
)
def test_who_is_not_admitted_does_not_try_again(answer: str, words: str, options: dict[str, str]) -> None:
    relay = {"relay": parse_link_url("udpout:127.0.0.1:9")} if options else {}
    connections: list[bytes] = []

    async def refuse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.closing(writer):
            connections.append(await reader.read(1000))
            writer.write(bytes.fromhex(answer))

    async def body() -> None:
        async with await asyncio.start_server(refuse, "127.0.0.1", 0) as server:
            with pytest.raises(BrokerError, match=words):
                async with a_bridge(server.sockets[0].getsockname()[1], **options, **relay):
                    pass
        assert len(connections) == 1

    run(body)


@pytest.mark.usefixtures("impatient")
def test_i7_what_is_refused_of_the_feed_and_of_the_link_shows_among_the_events() -> None:
    async def body() -> None:
        port, relay = free_port(socket.SOCK_STREAM), parse_link_url("udpout:127.0.0.1:9")
        async with (
            a_broker(port),
            a_bridge(port, feed_topic="sensors/+", relay=relay) as (bridge, _),
            aiomqtt.Client("127.0.0.1", port) as client,
        ):
            await client.publish("sensors/a", b"garbage")
            bridge._heard(b"garbage", None)
            while not bridge.feed.counters:
                await turn()
            assert bridge.events() == {"refused": 1, "feed_not_json": 1}

    run(body)


@pytest.mark.usefixtures("impatient")
def test_the_feed_of_another_tool_becomes_remote_id_on_a_link() -> None:
    async def body() -> None:
        port, relayed = free_port(socket.SOCK_STREAM), asyncio.Queue[bytes]()
        air = await open_link("udpin:127.0.0.1:0", lambda data, _: relayed.put_nowait(data))
        relay = parse_link_url(f"udpout:127.0.0.1:{air.local_address[1]}")
        async with (
            a_broker(port),
            a_bridge(port, feed_topic="sensors/+", relay=relay),
            aiomqtt.Client("127.0.0.1", port) as client,
        ):
            await client.publish("sensors/a", b'{"id": "x", "lat": 47.0, "lon": 8.0}')
            sky = Sky()
            while not sky.aircraft:
                for frame in parse_datagram(await relayed.get(), CRC_EXTRAS):
                    assert isinstance(frame, Frame)
                    sky.receive(frame, 0.0)
            assert [one.report.latitude_deg for one in sky.aircraft.values()] == [47.0]
        air.close()

    run(body)


def test_nobody_there_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ridlink.mqtt.bridge.FIRST_CONNECTION_S", 0.0)

    async def body() -> None:
        port = free_port(socket.SOCK_STREAM)
        with pytest.raises(BrokerError, match=rf"mqtt://127\.0\.0\.1:{port}: "):
            async with a_bridge(port):
                pass

    run(body)


def test_a_name_that_no_host_can_have_is_one_line() -> None:
    async def body() -> None:
        bridge = Bridge(BrokerUrl("broker..local", 1883, False), TOPICS, Publisher(PublisherSettings(TOPICS)), SOURCE)
        with pytest.raises(BrokerError, match=r"mqtt://broker\.\.local:1883: .*label empty"):
            await bridge.run(asyncio.Event())

    run(body)


def test_a_bridge_that_is_cancelled_leaves_nothing_behind() -> None:
    async def body() -> None:
        before = asyncio.all_tasks()
        async with asyncio.timeout(PATIENCE_S):
            broker = BrokerUrl("127.0.0.1", free_port(socket.SOCK_STREAM), False)
            told = asyncio.Event()
            bridge = Bridge(
                broker, TOPICS, Publisher(PublisherSettings(TOPICS)), SOURCE, on_event=lambda text: told.set()
            )
            task = asyncio.create_task(bridge.run(asyncio.Event()))
            await told.wait()  # nobody is there, and it will try again
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
        assert asyncio.all_tasks() == before

    run(body)


@pytest.mark.parametrize(
    "topic",
    [
        "ridlink/#",
        "#",
        "+/v1/here/uas/+/state",
        "bad/#/topic",
        "ridlink/v1/here/uas/ALPHA/state",
        "+/+/here/encounter/A~B",
        "$share/all/ridlink/v1/here/uas/ALPHA/#",
    ],
)
def test_our_own_topics_are_no_feed(topic: str) -> None:
    async def body() -> None:
        publisher = Publisher(PublisherSettings(TOPICS))
        with pytest.raises(ConfigError, match="feed topic"):
            Bridge(BrokerUrl("127.0.0.1", 1, False), TOPICS, publisher, SOURCE, feed_topic=topic)

    run(body)
