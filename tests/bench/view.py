"""What the live page costs its server: CPU time and memory of ``ridlink view`` while vehicles report.

Each sends LOCATION and RIDLINK_SEPARATION at 10 Hz and BASIC_ID once a second; every page follows, with a vehicle
selected.
"""

from __future__ import annotations

import asyncio
import itertools
import os
import re
import socket
import sys
from pathlib import Path
from typing import Any

import numpy as np
from websockets.asyncio.client import connect

from ridlink.separation.definitions import Definition
from tests.loopback import free_port
from tests.observer.flights import Flyer, frames

SECONDS = 20.0
CASES = ((8, 1, 1), (250, 1, 1), (250, 8, 1), (250, 2, 2), (250, 6, 6), (1000, 1, 1), (2000, 1, 1))
"""Vehicles, pages, definitions that these look at."""

REPEATED_S = 2.0
ADDRESS = re.compile(rb"http(://127\.0\.0\.1:\d+/)")
BASIC_ID = 12900
TOGETHER = 3


def report() -> dict[str, list[dict[str, Any]]]:
    """Print the table."""
    print(f"\nserver of the live page, {SECONDS:g} s each: vehicles that report at 10 Hz, pages that follow")
    print(f"{'vehicles':>9}{'pages':>7}{'definitions':>13}{'CPU':>8}{'memory':>9}{'instants/s and page':>21}{'of':>9}")
    rows = []
    for vehicles, pages, definitions in CASES:
        row = asyncio.run(measure(vehicles, pages, definitions))
        rows.append(row)
        print(
            f"{vehicles:>9}{pages:>7}{definitions:>13}{row['cpu']:>8.1%}{row['memory_mb']:>6.0f} MB"
            f"{row['instants_per_s']:>21.1f}{row['instant_bytes'] / 1e3:>6.1f} kB"
        )
    return {"view": rows}


async def measure(vehicles: int, pages: int, definitions: int) -> dict[str, Any]:
    """One server."""
    said = spoken(vehicles)
    port = free_port()
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "ridlink", "view", "--source", f"udpin:127.0.0.1:{port}", "--port", "0",
        stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    try:
        assert process.stderr is not None
        found = ADDRESS.search(await process.stderr.readline())
        assert found is not None
        address = f"ws{found[1].decode()}ws/v1"
        speaking = asyncio.create_task(speak(said, port))
        counts = [0, 0]
        looked_at = sorted(Definition, key=lambda one: one != Definition.CANDIDATE2)  # what the server begins with
        watched = [looked_at[page % definitions] for page in range(pages)]
        watching = [asyncio.create_task(watch(address, definition, counts)) for definition in watched]
        await asyncio.wait([speaking, *watching], timeout=10.0)  # until its kernels are loaded
        used, counts[0] = cpu_s(process.pid), 0
        await asyncio.wait([speaking, *watching], timeout=SECONDS)
        used = cpu_s(process.pid) - used
        for task in (speaking, *watching):
            task.cancel()
        resident = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")
    finally:
        process.terminate()
        await process.wait()
    return {
        "vehicles": vehicles,
        "pages": pages,
        "definitions": definitions,
        "cpu": used / SECONDS,
        "memory_mb": resident / 1e6,
        "instants_per_s": counts[0] / SECONDS / pages,
        "instant_bytes": counts[1],
    }


def spoken(vehicles: int) -> list[list[bytes]]:
    """Datagrams of each tenth of a second, over and over."""
    generator = np.random.default_rng(1)
    half_m = 1000.0 * max(1.0, (vehicles / 250) ** 0.5)  # more than 250 are no more crowded
    place, velocity = generator.uniform(-half_m, half_m, (vehicles, 2)), generator.uniform(-10.0, 10.0, (vehicles, 2))
    flyers = [
        Flyer(k % 250 + 1, tuple(place[k].tolist()), tuple(velocity[k].tolist()), b"ID%04d" % k, compid=k // 250 + 1)
        for k in range(vehicles)
    ]
    steps: list[list[bytes]] = [[] for _ in range(round(10 * REPEATED_S))]
    for time_s, frame in frames(flyers, REPEATED_S):
        if frame.msgid != BASIC_ID or round(10 * time_s) % 10 == 0:
            steps[round(10 * time_s)].append(frame.raw)
    return [[b"".join(step[k : k + TOGETHER]) for k in range(0, len(step), TOGETHER)] for step in steps]


async def speak(said: list[list[bytes]], port: int) -> None:
    """Say all of it in its rhythm, over and over, until cancelled."""
    loop, due = asyncio.get_running_loop(), asyncio.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        begun_s = loop.time()
        for step in itertools.count():
            for datagram in said[step % len(said)]:
                sender.sendto(datagram, ("127.0.0.1", port))
            loop.call_at(begun_s + (step + 1) / 10.0, due.set)
            await due.wait()
            due.clear()


async def watch(address: str, definition: Definition, counts: list[int]) -> None:
    async with connect(address, compression=None, max_size=None) as page:
        await page.send(f'{{"definition":"{definition}","select":"ID0001"}}')
        async for message in page:
            if message.startswith('{"type":"instant"'):  # type: ignore[arg-type]
                counts[0] += 1
                counts[1] = len(message)


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    report()
