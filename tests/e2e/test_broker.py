"""The whole programs with a real broker: a fleet, `ridlink mqtt`, and mosquitto, which dies and comes back."""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO

import psutil
import pytest

pytest.importorskip("aiomqtt", reason="needs ridlink[mqtt]")

import aiomqtt

from ridlink.links import parse_link_url
from ridlink.mqtt import Topics
from tests.cli.program import ANY_PORT
from tests.loopback import free_port, turn
from tests.mqtt.brokers import a_bridge, a_listener, run

TOPICS = Topics("field")
VEHICLES = 8
LISTENS = r"version \S+ running"
"""Of mosquitto, which before says that only clients \"running on this machine\" may connect."""
MANY, APART_M = 125, 300.0
WATCHED_S = 20.0
PATIENCE_S = 60.0

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.skipif(shutil.which("mosquitto") is None, reason="needs mosquitto: apt-get install mosquitto"),
]


@contextmanager
def program(*command: str) -> Iterator[subprocess.Popen[str]]:
    """A process that ends with the block."""
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def said(process: subprocess.Popen[str], pattern: str) -> str:
    """Wait until a program says something on standard error; the first group of it, or all."""
    errors: IO[str] | None = process.stderr
    assert errors is not None
    lines = []
    for line in iter(errors.readline, ""):
        lines.append(line)
        if found := re.search(pattern, line):
            return found.group(found.lastindex or 0)
    raise AssertionError(f"{process.args!r} never said {pattern!r}: {''.join(lines)}")


def states(seen: list[tuple[str, bytes]]) -> list[dict[str, object]]:
    return [json.loads(payload) for topic, payload in seen if topic.endswith("/state")]


def everybody(times: int, since_s: float = 0.0) -> Callable[[list[tuple[str, bytes]]], bool]:
    """Whether all vehicles were heard so often, in states that are newer than a time."""

    def heard(seen: list[tuple[str, bytes]]) -> bool:
        newer = [str(state["uas"]) for state in states(seen) if float(str(state["t"])) > since_s]
        counts = Counter(uas for uas in newer if uas.startswith("RDLK"))  # until it has told, a number stands for it
        return len(counts) == VEHICLES and min(counts.values()) >= times

    return heard


def test_what_is_too_long_of_a_feed_never_leaves_the_broker() -> None:
    async def body() -> None:
        port, relay = free_port(socket.SOCK_STREAM), parse_link_url("udpout:127.0.0.1:9")
        with program("mosquitto", "-p", str(port)) as broker:
            said(broker, LISTENS)
            async with (
                a_bridge(port, feed_topic="sensors/+", relay=relay) as (bridge, _),
                aiomqtt.Client("127.0.0.1", port) as client,
            ):
                await client.publish("sensors/a", bytes(8_000_000))
                await client.publish("sensors/a", b'{"id": "x", "lat": 47.0, "lon": 8.0}')
                while not bridge.feed.counters["aircraft"]:
                    await turn()
                assert bridge.feed.counters == {"aircraft": 1}

    run(body)


async def scene(life: ExitStack) -> None:
    port = free_port(socket.SOCK_STREAM)
    mosquitto = ("mosquitto", "-p", str(port))
    broker = life.enter_context(program(*mosquitto))
    said(broker, LISTENS)
    fleet = life.enter_context(program(sys.executable, "-m", "ridlink", "sim", "--airborne", *ANY_PORT))
    air = said(fleet, r"air (\d+)")
    bridge = life.enter_context(
        program(
            *(sys.executable, "-m", "ridlink", "mqtt", "--broker", f"mqtt://127.0.0.1:{port}", "--site", "field"),
            *("--rate", "10", "--source", f"udpout:127.0.0.1:{air}"),
        )
    )
    async with a_listener(port) as heard:
        await heard.until(everybody(20))
        assert (TOPICS.availability, b"online") in heard.messages

    broker.kill()
    await asyncio.to_thread(said, bridge, "trying again")
    began_s = time.time()
    broker = life.enter_context(program(*mosquitto))
    await asyncio.to_thread(said, broker, LISTENS)
    async with a_listener(port) as heard:
        await heard.until(everybody(5, began_s))
        # The newest first: nothing that waited for the broker is older than the way back to it.
        assert float(str(states(heard.messages)[0]["t"])) > began_s - 2.0
        bridge.kill()
        await heard.until(lambda seen: (TOPICS.availability, b"offline") in seen)
    assert fleet.poll() is None


def test_eight_vehicles_on_mosquitto_which_dies_and_comes_back_and_a_bridge_that_does_not() -> None:
    with ExitStack() as life:
        asyncio.run(asyncio.wait_for(scene(life), 2 * PATIENCE_S))


def a_large_fleet(folder: Path) -> Path:
    """A scenario of many vehicles that do not meet."""
    places = [(APART_M * (number // 12), APART_M * (number % 12)) for number in range(MANY)]
    vehicles = "".join(
        f"[[vehicle]]\nstart_ned_m = [{n}, {e}, -30]\ngoal_ned_m = [{n + 50}, {e}, -30]\n" for n, e in places
    )
    file = folder / "many.toml"
    file.write_text(f'name = "many"\nduration_s = 600\n{vehicles}')
    return file


async def states_of_many(life: ExitStack, folder: Path) -> tuple[float, float, int, float]:
    """States that a subscriber received a second, what one cost the bridge [us], by how much that grew [bytes].

    And by how many cores nobody used meanwhile.
    """
    port = free_port(socket.SOCK_STREAM)
    said(life.enter_context(program("mosquitto", "-p", str(port))), LISTENS)
    fleet = life.enter_context(
        program(
            *(sys.executable, "-m", "ridlink", "sim", "--scenario", str(a_large_fleet(folder)), "--airborne"), *ANY_PORT
        )
    )
    air = said(fleet, r"air (\d+)")
    bridge = life.enter_context(
        program(
            *(sys.executable, "-m", "ridlink", "mqtt", "--broker", f"mqtt://127.0.0.1:{port}", "--site", "field"),
            *("--rate", "10", "--source", f"udpout:127.0.0.1:{air}"),
        )
    )
    used = psutil.Process(bridge.pid)
    async with aiomqtt.Client("127.0.0.1", port) as client:
        await client.subscribe(TOPICS.state("x").replace("/x/", "/+/"))
        messages = client.messages
        heard: set[str] = set()
        async for message in messages:
            heard.add(str(message.topic))
            if len(heard) == MANY:
                break
        idle_s = psutil.cpu_times().idle
        begun_s, cpu_s, memory = time.monotonic(), sum(used.cpu_times()[:2]), used.memory_info().rss
        received = 0
        async for _ in messages:
            received += 1
            lasted_s = time.monotonic() - begun_s
            if lasted_s >= WATCHED_S:
                break
    cost_us = 1e6 * (sum(used.cpu_times()[:2]) - cpu_s) / received
    idle = (psutil.cpu_times().idle - idle_s) / lasted_s
    return received / lasted_s, cost_us, used.memory_info().rss - memory, idle


def test_a_thousand_states_a_second_reach_a_subscriber(tmp_path: Path) -> None:
    with ExitStack() as life:
        rate_hz, cost_us, grown, idle = asyncio.run(asyncio.wait_for(states_of_many(life, tmp_path), 2 * PATIENCE_S))
    print(f"{rate_hz:.0f} states/s received of {10 * MANY}, {cost_us:.0f} us of CPU each, {grown / 1e6:+.1f} MB")
    assert grown < 5e6 and cost_us < 500.0
    if rate_hz < 1000.0 and idle < 0.1:
        pytest.skip(f"no core is left on this machine, others use them: {rate_hz:.0f} states/s")
    assert rate_hz >= 1000.0
