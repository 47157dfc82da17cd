"""The only module that uses the MQTT library: connects and reconnects, sends queued messages, receives the feed.

A broker that is slow, away or hostile can only lose its own messages: they wait in the `Outbox`, which is bounded.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import random
import socket
import ssl
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable

from ridlink.companions import beside
from ridlink.errors import ConfigError, LinkError, MissingExtraError
from ridlink.links import Link, LinkUrl, Scheme, open_link
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.mavlink.ground_station import HEARTBEAT_EVERY_S, ground_station, heartbeat
from ridlink.mqtt.broker_url import BrokerUrl
from ridlink.mqtt.feed import LONGEST_PAYLOAD, Feed
from ridlink.mqtt.outbox import Outbox, Outgoing
from ridlink.mqtt.publisher import OFFLINE, STEP_S, Publisher
from ridlink.mqtt.topics import Topics

try:
    import aiomqtt
    from aiomqtt import ProtocolVersion
    from paho.mqtt.packettypes import PacketTypes
    from paho.mqtt.properties import Properties
    from paho.mqtt.reasoncodes import ReasonCode
except ImportError as error:
    raise MissingExtraError("mqtt", "publishing on a broker") from error

FIRST_CONNECTION_S = 10.0
"""A broker that does not answer for this long at the start is taken as a mistake of the user."""

BACK_OFF_S = (1.0, 30.0)
ANSWER_S = 10.0
AT_ONCE = 256
"""Messages in flight at the same time; more would only wait in the library, where newer ones do not replace them."""

GREETED_AT_ONCE = 20
"""Messages of a greeting in flight at the same time: as many as the library sends before an answer. More would wait in
the library while `ANSWER_S` runs."""

FAREWELL_S = 1.0
"""Longest time to send the last messages at the end."""

HANG_UP_S = 0.1

AT_ONCE_ON_THE_WIRE = (socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
"""Socket option: no waiting for the acknowledgement of the message before, which the peer delays by 40 ms."""

REFUSED = 128
"""Codes of an answer to a subscription are refusals from here on."""

LOST = "Disconnected during message iteration"
"""Error text of the library when the connection is lost."""

NO_ANSWER = "Operation timed out"
"""Error text of the library when a broker accepts the connection and does not answer."""

UNSUPPORTED_VERSION = 132
"""The answer of a broker that knows only MQTT 3.1.1 to MQTT 5, as a code of MQTT 5."""

NOT_ADMITTED = (134, 135)
"""Answers to a wrong user or password, and to a client that may not connect, as codes of MQTT 5. The library maps the
codes 4 and 5 of MQTT 3.1.1 to them."""

LONGEST_PACKET = 2 * LONGEST_PAYLOAD
"""Longest packet of the feed (payload, topic, properties), requested from the broker with MQTT 5. The library would
collect up to 256 MB before the bridge could refuse it."""

LIBRARY_LOG = logging.getLogger("ridlink.mqtt.library")
"""Silenced log of the library. What a user should know comes as an error, and is reported once."""
LIBRARY_LOG.addHandler(logging.NullHandler())
LIBRARY_LOG.propagate = False


class BrokerError(LinkError):
    """A broker that cannot be used."""


class Bridge:
    """Publishes the traffic of a link on a broker, and sends a feed of the broker to a link.

    Args:
        broker: Address of the broker.
        topics: Our topics.
        publisher: Turns received frames into messages.
        source: Link on which traffic is received.
        password: Password of the broker's user.
        ca_file: Certificates to trust with ``mqtts``, instead of the system's.
        feed_topic: Topic filter of a foreign feed; None for none.
        relay: Link to which the traffic of the feed goes.
        on_event: Called with one line of text that the user should see.

    Attributes:
        connected: Set while the broker is connected and the feed subscribed to.
        counters: ``published``, ``connections``, ``refused`` datagrams.

    Raises:
        ConfigError: If the feed would contain what we publish.
    """

    def __init__(
        self,
        broker: BrokerUrl,
        topics: Topics,
        publisher: Publisher,
        source: LinkUrl,
        *,
        password: str | None = None,
        ca_file: str | None = None,
        feed_topic: str | None = None,
        relay: LinkUrl | None = None,
        on_event: Callable[[str], None] = lambda text: None,
    ) -> None:
        if feed_topic is not None:
            _refuse_own(feed_topic, topics)
        self.counters: Counter[str] = Counter()
        self.outbox = Outbox()
        self.feed = Feed()
        self.connected = asyncio.Event()
        self._broker = broker
        self._topics = topics
        self._publisher = publisher
        self._source = source
        self._password = password
        self._ca_file = ca_file
        self._feed_topic = feed_topic
        self._relay_url = relay
        self._link: Link | None = None
        self._relay: Link | None = None
        self._tell = on_event
        self._waiting = asyncio.Event()
        self._has_been_connected = False
        self._asks_for_short_packets = feed_topic is not None

    async def run(self, stop: asyncio.Event) -> None:
        """Publish until told to stop.

        Raises:
            LinkError: If a link cannot be opened, or the broker cannot be reached at the start.
        """
        self._link = link = await open_link(self._source, self._heard)
        try:
            if self._relay_url is not None:
                self._relay = await open_link(self._relay_url, lambda data, address: None)
            async with beside(self._stay_connected(), self._keep_time(link)):
                await stop.wait()
        finally:
            link.close()
            if self._relay is not None:
                self._relay.close()

    def events(self) -> dict[str, int]:
        """Counts of what was refused or noticed, by cause: by the bridge, by the feed, and by the links."""
        found = {cause: n for cause, n in self.counters.items() if cause not in ("published", "connections")}
        for whose, counters in (("feed", self.feed.counters), ("sky", self._publisher.sky.rejects),
                                ("source_link", self._link and self._link.counters),
                                ("relay_link", self._relay and self._relay.counters)):  # fmt: skip
            found.update({f"{whose}_{cause}": n for cause, n in (counters or {}).items()})
        return found

    def _heard(self, data: bytes, _: object) -> None:
        now_s = time.monotonic()
        for found in parse_datagram(data, CRC_EXTRAS):
            if isinstance(found, Frame):
                self._publisher.receive(found, now_s)
            else:
                self.counters["refused"] += 1

    async def _keep_time(self, link: Link) -> None:
        encoder = ground_station()
        due_s = heartbeat_due_s = time.monotonic()
        while True:
            now_s = time.monotonic()
            if self._source.scheme is Scheme.UDPOUT and now_s >= heartbeat_due_s:
                heartbeat_due_s = now_s + HEARTBEAT_EVERY_S
                link.send(heartbeat(encoder))
            for message in self._publisher.step(now_s, time.time()):
                self.outbox.put(message)
            if len(self.outbox):
                self._waiting.set()
            due_s = max(due_s + STEP_S, now_s)
            await asyncio.sleep(due_s - time.monotonic())

    async def _stay_connected(self) -> None:
        begun_s = time.monotonic()
        wait_s = BACK_OFF_S[0]
        told = ""
        while True:
            try:
                async with _hung_up_at_the_end(self._client()) as client:
                    self.counters["connections"] += 1
                    await self._converse(client)
            except (aiomqtt.MqttError, OSError, UnicodeError) as error:  # UnicodeError for an impossible host name
                reason = _reason(error)
                if self._asks_for_short_packets and not self._has_been_connected and _speaks_older(error):
                    self._asks_for_short_packets = False
                    self._tell(f"{self._broker}: speaks no MQTT 5, and cannot be asked to keep long payloads back")
                    continue
                if not self._has_been_connected and (
                    _is_final(error) or time.monotonic() - begun_s > FIRST_CONNECTION_S
                ):
                    raise BrokerError(f"{self._broker}: {reason}") from error
                if self.connected.is_set():
                    wait_s, told = BACK_OFF_S[0], ""
                self.connected.clear()
                if reason != told:
                    told = reason
                    self._tell(f"{self._broker}: {reason}; trying again")
                await asyncio.sleep(wait_s * random.uniform(0.5, 1.0))
                wait_s = min(2.0 * wait_s, BACK_OFF_S[1])

    def _client(self) -> aiomqtt.Client:
        context = None
        if self._broker.encrypted:
            try:
                context = ssl.create_default_context(cafile=self._ca_file)
            except (OSError, ssl.SSLError) as error:
                raise BrokerError(f"{self._ca_file}: no certificates: {_reason(error)}") from error
        properties = None
        if self._asks_for_short_packets:
            properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
            properties.MaximumPacketSize = LONGEST_PACKET
        return aiomqtt.Client(
            self._broker.host,
            self._broker.port,
            protocol=ProtocolVersion.V311 if properties is None else ProtocolVersion.V5,
            properties=properties,
            username=self._broker.user,
            password=self._password,
            will=aiomqtt.Will(self._topics.availability, OFFLINE, 1, True),
            tls_context=context,
            logger=LIBRARY_LOG,
            timeout=ANSWER_S,
            keepalive=10,
            socket_options=[AT_ONCE_ON_THE_WIRE],
        )

    async def _converse(self, client: aiomqtt.Client) -> None:
        try:
            async with beside(self._hear(client)):  # from the start: it detects a lost connection
                await self._greet_and_send(client)
        finally:  # a clean end; if the farewell cannot be sent, the last will says it
            with contextlib.suppress(TimeoutError, aiomqtt.MqttError):
                async with asyncio.timeout(FAREWELL_S), beside(self._hear(client)):
                    await _publish_together(client, self._publisher.farewell())

    async def _greet_and_send(self, client: aiomqtt.Client) -> None:
        greeting = self._publisher.greeting()
        for begin in range(0, len(greeting), GREETED_AT_ONCE):
            for failure in await _publish_together(client, greeting[begin : begin + GREETED_AT_ONCE]):
                if failure is not None:
                    raise failure
        if self._feed_topic is not None:
            granted = await client.subscribe(self._feed_topic)
            if any(getattr(code, "value", code) >= REFUSED for code in granted):
                raise BrokerError(f"the feed {self._feed_topic!r} is refused")
        self.connected.set()
        self._tell(f"connected to {self._broker}")
        self._has_been_connected = True
        await self._send(client)

    async def _send(self, client: aiomqtt.Client) -> None:
        while True:
            messages = list(itertools.islice(iter(self.outbox.take, None), AT_ONCE))
            if not messages:
                self._waiting.clear()
                await self._waiting.wait()
                continue
            sending = [
                asyncio.ensure_future(client.publish(one.topic, one.payload, one.qos, one.retain)) for one in messages
            ]
            try:
                await asyncio.gather(*sending, return_exceptions=True)
            finally:  # `_hear` detects a lost connection, and this is cancelled while it waits for answers
                failed = [one.cancelled() or one.exception() is not None for one in sending]
                for message, has_failed in reversed(list(zip(messages, failed, strict=True))):
                    if has_failed:
                        self.outbox.put_back(message)
                self.counters["published"] += failed.count(False)
            for one in sending:
                one.result()

    async def _hear(self, client: aiomqtt.Client) -> None:
        async for message in client.messages:  # raises if the connection is lost
            if self._relay is None or not isinstance(message.payload, bytes | bytearray):
                continue
            for frame in self.feed.frames(message.payload, time.time()):
                self._relay.send(frame)


@contextlib.asynccontextmanager
async def _hung_up_at_the_end(client: aiomqtt.Client) -> AsyncIterator[aiomqtt.Client]:
    """As ``async with client``, which leaves the connection open if the broker takes it and does not answer."""
    try:
        async with client:
            yield client
    finally:
        with contextlib.suppress(TimeoutError, aiomqtt.MqttError):
            async with asyncio.timeout(HANG_UP_S):  # it is closed at once, and then waits for nothing
                await client.__aexit__(None, None, None)


async def _publish_together(client: aiomqtt.Client, messages: list[Outgoing]) -> list[BaseException | None]:
    """Publish in order, and wait for all answers. Returns the error of each message, None if it has none."""
    return await asyncio.gather(
        *(client.publish(one.topic, one.payload, one.qos, one.retain) for one in messages), return_exceptions=True
    )


def _refuse_own(feed_topic: str, topics: Topics) -> None:
    try:
        aiomqtt.Wildcard(feed_topic)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"feed topic {feed_topic!r}: is no topic filter, as in 'sensors/drone/+'") from error
    if topics.are_heard_by(feed_topic):
        raise ConfigError(f"feed topic {feed_topic!r}: would hear what this bridge publishes under {topics.root}")


def _is_final(error: Exception) -> bool:
    """Whether trying again cannot help: a wrong certificate or password, or an impossible host name."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, ssl.SSLError | BrokerError | UnicodeError):
            return True
        cause = cause.__cause__ or cause.__context__
    return _code_of(error) in NOT_ADMITTED


def _speaks_older(error: Exception) -> bool:
    """Whether a broker knows no MQTT 5: it says so, or it takes the packet for MQTT 3.1.1 and waits for more bytes."""
    return _code_of(error) == UNSUPPORTED_VERSION or str(error) == NO_ANSWER


def _code_of(error: Exception) -> int | None:
    """The broker's answer as a code of MQTT 5; None if it did not answer."""
    code = error.rc if isinstance(error, aiomqtt.MqttCodeError) else None
    return code.value if isinstance(code, ReasonCode) else code


def _reason(error: BaseException) -> str:
    if isinstance(error, aiomqtt.MqttError) and isinstance(error.__context__, OSError):
        error = error.__context__  # the error that the library turned into text
    if isinstance(error, aiomqtt.MqttError) and str(error) == LOST:
        return "the connection is lost"
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is not trusted: {error.verify_message.rstrip('.')}"
    if isinstance(error, ssl.SSLError) and error.reason == "WRONG_VERSION_NUMBER":
        return "it speaks no TLS"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) or type(error).__name__
