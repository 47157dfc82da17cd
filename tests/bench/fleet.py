"""What an emulated fleet costs: CPU, memory and lateness of one process that flies it in real time.

Vehicles stream their usual telemetry to a companion port where nobody listens and broadcast Remote ID at 10 Hz; one
observer hears everything. CPU time is what counts on a shared machine; lateness is noisy there. A turn is the CPU time
from one look at the sockets to the next: what the fleet itself makes others wait, whoever shares the machine.
"""

from __future__ import annotations

import asyncio
import resource
import selectors
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ridlink.links import open_link
from ridlink.mavlink.codec import Encoder
from ridlink.scenario import Scenario, VehicleSpec
from sitl_sim.autopilot import Start
from sitl_sim.fleet_config import HOST, FleetConfig
from sitl_sim.server import FleetServer

SECONDS = 10.0
COUNTS = (1, 8, 50, 250)
COMPANION_PORT = 24540
PROBE_S = 0.007
"""Time between two looks at how late the loop is; no divisor of a tick."""


def report() -> dict[str, list[dict[str, Any]]]:
    """Print the table; each fleet has a process of its own."""
    print(f"\nemulated fleets in real time, {SECONDS:g} s each: telemetry of every vehicle, Remote ID at 10 Hz")
    headings = ("CPU", 8), ("CPU each", 10), ("memory", 9), ("each", 8), ("late p50", 10), ("late p99", 10)
    turns = ("turn p99", 10), ("longest", 10)
    print(f"{'vehicles':>9}" + "".join(f"{text:>{width}}" for text, width in (*headings, *turns)))
    rows = []
    for count in COUNTS:
        done = subprocess.run([sys.executable, "-m", __name__, str(count)], capture_output=True, check=True)
        row: dict[str, Any] = msgspec.json.decode(done.stdout)
        each_kb = (row["memory_mb"] - rows[0]["memory_mb"]) * 1e3 / (count - 1) if rows else 0.0
        rows.append(row | {"memory_each_kb": each_kb})
        print(
            f"{count:>9}{row['cpu']:>8.1%}{row['cpu'] / count:>10.2%}{row['memory_mb']:>6.0f} MB{each_kb:>5.0f} kB"
            f"{row['late_p50_ms']:>7.1f} ms{row['late_p99_ms']:>7.1f} ms"
            f"{row['turn_p99_ms']:>7.1f} ms{row['turn_max_ms']:>7.1f} ms"
        )
    return {"fleet": rows}


class Turns(selectors.DefaultSelector):
    """Counts the CPU time between two looks at the sockets [s]."""

    def __init__(self) -> None:
        super().__init__()
        self.busy_s: list[float] = []
        self._begun_s = time.thread_time()

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        self.busy_s.append(time.thread_time() - self._begun_s)
        ready = super().select(timeout)
        self._begun_s = time.thread_time()
        return ready


def measure(count: int, seconds: float = SECONDS) -> dict[str, Any]:
    """One fleet in an event loop of its own."""
    turns = Turns()
    with asyncio.Runner(loop_factory=lambda: asyncio.SelectorEventLoop(turns)) as runner:
        return runner.run(fly(count, turns, seconds))


async def fly(count: int, turns: Turns, seconds: float) -> dict[str, Any]:
    """One fleet, measured after a second."""
    side = 30.0
    specs = [
        VehicleSpec((side * (k % 16), side * (k // 16), -50.0), (side * (k % 16), 900.0, -50.0)) for k in range(count)
    ]
    config = FleetConfig(start=Start.AIRBORNE, vehicle_port=0, companion_port=COMPANION_PORT, air_port=0)
    server = FleetServer(Scenario("scale", 600.0, tuple(specs)), config)
    await server.start()
    heard = [0]

    def hear(datagram: bytes, _: Any) -> None:
        heard[0] += len(datagram)

    observer = await open_link(f"udpout:{HOST}:{server.ports.air}", hear)
    observer.send(Encoder(255, 190).encode("HEARTBEAT", type=6, autopilot=8, mavlink_version=3))
    stop = asyncio.Event()
    flying = asyncio.create_task(server.run(stop))
    loop = asyncio.get_running_loop()
    late: list[float] = []

    def probe(due_s: float) -> None:
        late.append(loop.time() - due_s)
        if not stop.is_set():
            next_s = loop.time() + PROBE_S
            loop.call_at(next_s, probe, next_s)

    await _fly_for(1.0, flying)
    late.clear()
    turns.busy_s.clear()
    begun, used = time.monotonic(), time.process_time()
    probe(loop.time())
    await _fly_for(seconds, flying)
    used, taken = time.process_time() - used, time.monotonic() - begun
    busy_ms = np.array(turns.busy_s) * 1e3
    resident_mb = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6
    stop.set()
    await flying
    await server.close()
    observer.close()
    assert server.counters["error"] == 0 and heard[0] > 0
    return {
        "vehicles": count,
        "cpu": used / taken,
        "memory_mb": resident_mb,
        "late_p50_ms": float(np.percentile(late, 50)) * 1e3,
        "late_p99_ms": float(np.percentile(late, 99)) * 1e3,
        "turn_p99_ms": float(np.percentile(busy_ms, 99)),
        "turn_max_ms": float(busy_ms.max()),
        "slipped_ms": server.counters["slipped_ms"],
    }


async def _fly_for(seconds: float, flying: asyncio.Task[None]) -> None:
    """Let the fleet fly; what ends it early is raised here, and not measured."""
    await asyncio.wait([flying], timeout=seconds)
    if flying.done():
        flying.result()
        raise RuntimeError("the fleet stopped while it was measured")


if __name__ == "__main__":
    sys.stdout.buffer.write(msgspec.json.encode(measure(int(sys.argv[1]))) + b"\n")
