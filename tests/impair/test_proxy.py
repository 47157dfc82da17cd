"""The proxy on loopback: real sockets at both ends, each speaker with its own answers."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from ridlink.errors import ConfigError, LinkError
from ridlink.impair import Impairment, Proxy, open_proxy
from ridlink.links import Address, Link, open_link, parse_link_url

NEAR = parse_link_url("udpin:127.0.0.1:0")


class Echo:
    """Answers every datagram with its own sender's name in front, and keeps what it heard."""

    link: Link

    def __init__(self) -> None:
        self.heard: list[bytes] = []

    def receive(self, data: bytes, address: Address) -> None:
        self.heard.append(data)
        self.link.send(b"re:" + data, address)


async def through(
    talk: Callable[[Proxy, Echo], Awaitable[None]], there: Impairment | None = None, back: Impairment | None = None
) -> None:
    echo = Echo()
    echo.link = await open_link("udpin:127.0.0.1:0", echo.receive)
    far = parse_link_url(f"udpout:127.0.0.1:{echo.link.local_address[1]}")
    proxy = await open_proxy(NEAR, far, there=there or Impairment(), back=back or Impairment(), seed=4)
    try:
        await asyncio.wait_for(talk(proxy, echo), 20.0)
    finally:
        proxy.close()
        echo.link.close()


async def speaker(proxy: Proxy) -> tuple[Link, asyncio.Queue[bytes]]:
    answers: asyncio.Queue[bytes] = asyncio.Queue()
    link = await open_link(f"udpout:127.0.0.1:{proxy.near.local_address[1]}", lambda data, _: answers.put_nowait(data))
    return link, answers


def test_each_speaker_gets_its_own_answers() -> None:
    async def talk(proxy: Proxy, echo: Echo) -> None:
        one, answers_one = await speaker(proxy)
        two, answers_two = await speaker(proxy)
        for number in range(20):
            one.send(b"one %d" % number)
            two.send(b"two %d" % number)
        assert [await answers_one.get() for _ in range(20)] == [b"re:one %d" % n for n in range(20)]
        assert [await answers_two.get() for _ in range(20)] == [b"re:two %d" % n for n in range(20)]
        assert proxy.speakers == 2
        assert len(echo.heard) == 40
        one.close()
        two.close()

    asyncio.run(through(talk))


def test_delayed_datagrams_arrive_all_and_late_ones_are_overtaken() -> None:
    async def talk(proxy: Proxy, _: Echo) -> None:
        link, answers = await speaker(proxy)
        for number in range(100):
            link.send(b"%03d" % number)
        arrived = [await answers.get() for _ in range(100)]
        assert sorted(arrived) == [b"re:%03d" % n for n in range(100)]
        assert arrived != sorted(arrived)
        link.close()

    asyncio.run(through(talk, there=Impairment(delay_s=0.02, reorder=0.2)))


def test_each_way_has_its_own_faults() -> None:
    async def talk(proxy: Proxy, echo: Echo) -> None:
        link, answers = await speaker(proxy)
        for number in range(200):
            link.send(b"%03d" % number)
        while len(echo.heard) < 200:
            await answers.get()
        there, back = proxy.totals()
        assert there == {"received": 200, "passed": 200}
        while proxy.totals()[1]["received"] < 200:
            await answers.get()
        back = proxy.totals()[1]
        assert 0 < back["lost"] < 200
        assert back["lost"] + back["passed"] == 200
        link.close()

    asyncio.run(through(talk, back=Impairment(loss=0.3)))


def test_what_came_for_a_far_end_whose_name_has_gone_is_counted() -> None:
    async def scenario() -> None:
        proxy = await open_proxy(NEAR, parse_link_url("udpout:127.0.0.1:9"))
        proxy._far = parse_link_url("udpout:no..host:9")
        for _ in range(5):
            proxy.receive(b"lost", ("127.0.0.1", 9))
        await asyncio.wait(proxy._opening, timeout=10.0)
        assert proxy.speakers == 0 and proxy.counters == {"unroutable": 5}
        assert proxy.totals()[0] == {"received": 5, "passed": 5}
        proxy.close()

    asyncio.run(scenario())


def test_a_port_in_use_and_other_schemes_are_refused() -> None:
    async def talk(proxy: Proxy, _: Echo) -> None:
        taken = f"udpin:127.0.0.1:{proxy.near.local_address[1]}"
        far = parse_link_url("udpout:127.0.0.1:9")
        with pytest.raises(LinkError, match="in use"):
            await open_proxy(parse_link_url(taken), far)
        with pytest.raises(ConfigError, match="write udpin"):
            await open_proxy(far, far)
        with pytest.raises(ConfigError, match="write udpout"):
            await open_proxy(NEAR, NEAR)

    asyncio.run(through(talk))
