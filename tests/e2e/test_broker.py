"""The whole programs with a real broker: a fleet, `ridlink mqtt`, and mosquitto, which dies and comes back."""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import IO

import pytest

from ridlink.mqtt import Topics
from tests.cli.test_sim import ANY_PORT
from tests.mqtt.test_bridge import a_listener, free_port

TOPICS = Topics("field")
VEHICLES = 8
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


async def scene(life: ExitStack) -> None:
    port = free_port()
    mosquitto = ("mosquitto", "-p", str(port))
    broker = life.enter_context(program(*mosquitto))
    said(broker, "running")
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
    await asyncio.to_thread(said, broker, "running")
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
