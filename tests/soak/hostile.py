"""A daemon under load and attack, measured from outside: ``python -m tests.soak.hostile [WHAT...]``.

    traffic   1,000 tracks at 10 Hz (10,000 datagrams a second): loss, share of a core, decisions
    poison    ten bytes without a checksum before every good datagram: how many of the good ones are decoded
    flood     10,000 fresh ids in 60 s and a real head-on intruder: memory, decisions, separation
    fuzz      1,000,000 datagrams, half of them with a good checksum, and head-on intruders: stalls, memory, separation
    restart   kill -9 in flight, start again: time to the first setpoint
    stop      SIGTERM in flight: time to the end

The daemon is a process of its own and all datagrams are real. Shares of a core are CPU time, so they hold on a busy
machine; times are the wall's, so they do not. Ends with 1 where a figure is missed.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import multiprocessing
import os
import random
import signal
import socket
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ridlink.mavlink.codec import CRC_EXTRAS, MESSAGES, Encoder
from ridlink.mavlink.frames import encode_frame
from tests.daemon.emulated import HOME, Emulated, LoopbackVehicle, at
from tests.loopback import free_port

FAR_M = 40_000.0
MAC_RADIUS_M = 0.6
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass
class Flight:
    """A daemon that flies, and what is seen of it from outside."""

    process: asyncio.subprocess.Process
    vehicle: LoopbackVehicle
    air_port: int
    lines: list[dict[str, Any]] = field(default_factory=list)
    final: asyncio.Event = field(default_factory=asyncio.Event)
    begun_s: float = 0.0
    begun_cpu_s: float = 0.0
    begun_mb: float = 0.0

    def cpu_s(self) -> float:
        parts = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(parts[11]) + int(parts[12])) / TICKS_PER_S

    def resident_mb(self) -> float:
        for line in Path(f"/proc/{self.process.pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) / 1024.0
        return 0.0

    def begin(self) -> None:
        self.begun_s, self.begun_cpu_s, self.begun_mb = time.monotonic(), self.cpu_s(), self.resident_mb()

    def share_of_a_core(self) -> float:
        return (self.cpu_s() - self.begun_cpu_s) / (time.monotonic() - self.begun_s)

    def grown_mb(self) -> float:
        return self.resident_mb() - self.begun_mb

    async def read(self) -> None:
        assert self.process.stdout is not None
        async for line in self.process.stdout:
            self.lines.append(json.loads(line))
            if self.lines[-1]["event"] == "final":
                self.final.set()

    async def end(self) -> dict[str, Any]:
        self.process.send_signal(signal.SIGTERM)
        async with asyncio.timeout(20.0):
            await self.process.wait()
            await self.final.wait()
        return self.lines[-1]


async def start(vehicle_port: int, air_port: int) -> asyncio.subprocess.Process:
    goal = at(FAR_M)
    return await asyncio.create_subprocess_exec(
        sys.executable, "-m", "ridlink", "avoid", "--vehicle", f"udpin:127.0.0.1:{vehicle_port}",
        "--rid", f"udpin:127.0.0.1:{air_port}", "--goal", f"{goal[0]:.7f},{goal[1]:.7f}", "--json",
        stdout=asyncio.subprocess.PIPE, stderr=None,
    )  # fmt: skip


@asynccontextmanager
async def flying() -> AsyncIterator[Flight]:
    vehicle_port, air_port = free_port(), free_port()
    process = await start(vehicle_port, air_port)
    try:
        async with LoopbackVehicle(Emulated(), vehicle_port) as vehicle:
            flight = Flight(process, vehicle, air_port)
            reader = asyncio.create_task(flight.read())
            async with asyncio.timeout(60.0):
                while not vehicle.setpoints() or vehicle.setpoints()[-1].vx < 5.0:
                    await vehicle.changed()
            flight.begin()
            yield flight
            reader.cancel()
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()


# --- senders, in processes of their own -------------------------------------------------------------------------------


def paced(port: int, rate_hz: float, datagrams: Any, sent: Any) -> None:
    """Send at a rate, on the grid of the clock; count what was sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.connect(("127.0.0.1", port))
        begun, count = time.monotonic(), 0
        for datagram, counts in datagrams:
            try:
                sock.send(datagram)
            except ConnectionRefusedError:
                continue
            sent.value += counts
            count += 1
            ahead = count / rate_hz - (time.monotonic() - begun)
            if ahead > 0.002:
                time.sleep(ahead)


def crowd(port: int, seconds: float, sent: Any) -> None:
    """1,000 vehicles within two kilometres, each telling where it is ten times a second, in the order of a grid."""
    rng = random.Random(1)
    others = [
        Emulated(2 + k % 250, ned_m=(rng.uniform(-2000, 2000), rng.choice((-1, 1)) * rng.uniform(300, 2000), -50.0))
        for k in range(1000)
    ]
    for k, other in enumerate(others):
        other.velocity[:2] = rng.uniform(-8, 8), rng.uniform(-8, 8)
        other.mac = b"%08d" % k  # type: ignore[attr-defined]

    def datagrams() -> Any:
        for _ in range(round(10 * seconds)):
            now_s = time.time() % 3600.0
            for other in others:
                other.advance(0.1)
                yield other.remote_id(now_s, extended=False, id_or_mac=other.mac), 1  # type: ignore[attr-defined]

    paced(port, 10_000.0, datagrams(), sent)


def poisoned(port: int, seconds: float, sent: Any) -> None:
    other = Emulated(9, ned_m=(0.0, 900.0, -50.0))
    poison = b"\xfd\xff\x00\x00\x00\x09\x01\x65\x32\x00"

    def datagrams() -> Any:
        for k in range(round(1000 * seconds)):
            yield poison, 0
            yield other.remote_id(k / 1000.0, extended=False), 1

    paced(port, 2000.0, datagrams(), sent)


def fresh(port: int, seconds: float, sent: Any) -> None:
    """10,000 ids in 60 s, each heard once, all within 300 m of home."""
    rng = random.Random(2)

    def datagrams() -> Any:
        for k in range(round(10_000 * seconds / 60.0)):
            ghost = Emulated(100, ned_m=(rng.uniform(0, 600), rng.uniform(40, 300), -50.0))
            yield ghost.remote_id(time.time() % 3600.0, extended=False, id_or_mac=b"ghost%d" % k), 1

    paced(port, 10_000 / 60.0, datagrams(), sent)


def fuzz_datagram(rng: random.Random, encoders: list[Encoder]) -> bytes:
    """Half of them with a good checksum: any message with any payload, or a true LOCATION with wild fields."""
    kind = rng.random()
    if kind < 0.25:
        msgid = rng.choice(
            (12900, 12901, 12902, 12903, 12904, 12905, 12915, 61400, 0, 33, 76, rng.choice(list(MESSAGES)))
        )
        payload = rng.randbytes(rng.randint(1, MESSAGES[msgid].size))
        return encode_frame(
            msgid, payload, CRC_EXTRAS[msgid], seq=0, sysid=rng.randrange(256), compid=rng.randrange(256)
        )
    if kind < 0.5:
        place = [round((value + rng.gauss(0, 0.003)) * 1e7) for value in (HOME.latitude_deg, HOME.longitude_deg)]
        return rng.choice(encoders).encode(
            "OPEN_DRONE_ID_LOCATION", status=rng.randrange(256), latitude=place[0], longitude=place[1],
            direction=rng.randrange(65536), speed_horizontal=rng.randrange(65536),
            horizontal_accuracy=rng.randrange(256),
            altitude_geodetic=rng.choice((math.nan, math.inf, -1000.0, 0.0, 597.0, 1e30)),
            timestamp=rng.choice((65535.0, math.nan, rng.uniform(-10, 4000))),
            id_or_mac=b"f%d" % rng.randrange(3000) if rng.random() < 0.7 else b"",
        )  # fmt: skip
    data = bytearray(rng.choice(encoders).encode("OPEN_DRONE_ID_LOCATION", status=2, latitude=rng.randrange(2**31)))
    for _ in range(rng.randint(1, 6)):
        match rng.randrange(4):
            case 0:
                data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            case 1:
                data[rng.randrange(len(data)) :] = rng.randbytes(rng.randrange(40))
            case 2:
                data += rng.randbytes(rng.randrange(300))
            case 3:
                data[:0] = rng.choice((b"\xfd", b"\xfe", b"\x00")) * rng.randrange(200)
        data = data or bytearray(b"\xfd")
    return bytes(data)


def fuzzed(port: int, count: float, sent: Any) -> None:
    rng = random.Random(3)
    encoders = [Encoder(k, 1) for k in range(2, 60)]
    paced(port, 6000.0, ((fuzz_datagram(rng, encoders), 1) for _ in range(round(count))), sent)


class Intruders:
    """One after the other, head-on from 250 m ahead, each under an id of its own; the least distance to all of them."""

    def __init__(self, flight: Flight) -> None:
        self.nearest_m, self.met = math.inf, 0
        self._flight = flight

    async def fly(self) -> None:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.connect(("127.0.0.1", self._flight.air_port))
        own = self._flight.vehicle.vehicle
        while True:
            ahead = own.position[0] + 250.0
            intruder = Emulated(200, ned_m=(ahead, own.position[1], -50.0))
            intruder.velocity[0] = -8.0
            identity, then_s = b"real%d" % self.met, time.monotonic()
            while intruder.position[0] > own.position[0] - 60.0:
                now_s = time.monotonic()
                intruder.advance(now_s - then_s)
                then_s = now_s
                self.nearest_m = min(self.nearest_m, math.dist(intruder.position[:2], own.position[:2]))
                sock.send(intruder.remote_id(time.time() % 3600.0, id_or_mac=identity))
                await asyncio.sleep(0.1)
            self.met += 1


async def sending(target: Callable[..., None], flight: Flight, amount: float) -> int:
    context = multiprocessing.get_context("spawn")
    sent = context.Value("q", 0, lock=False)
    process = context.Process(target=target, args=(flight.air_port, amount, sent), daemon=True)
    process.start()
    done, ended = asyncio.create_task(asyncio.to_thread(process.join)), asyncio.create_task(flight.process.wait())
    await asyncio.wait((done, ended), return_when=asyncio.FIRST_COMPLETED)
    if ended.done():
        process.terminate()
        raise SystemExit(f"the daemon ended with {flight.process.returncode}")
    ended.cancel()
    return int(sent.value)


# --- what is measured -------------------------------------------------------------------------------------------------


def judged(what: str, figures: dict[str, float], limits: dict[str, tuple[str, float]]) -> bool:
    good = True
    for name, value in figures.items():
        verdict = ""
        if name in limits:
            sign, limit = limits[name]
            met = value <= limit if sign == "<=" else value >= limit
            good &= met
            verdict = f"  ({sign} {limit:g}: {'met' if met else 'MISSED'})"
        print(f"{what:8s} {name:32s} {value:12.4g}{verdict}", flush=True)
    return good


def regular(final: dict[str, Any]) -> dict[str, float]:
    decision, gap, cpu = final["decision_ms"], final["setpoint_gap_ms"], final["decision_cpu_ms"]
    return {"decision p99 [CPU ms]": cpu["p99"], "decision max [CPU ms]": cpu["max"],
            "decision p99 [ms]": decision["p99"], "decision max [ms]": decision["max"], "gap p99 [ms]": gap["p99"],
            "gap max [ms]": gap["max"]}  # fmt: skip


async def traffic(seconds: float) -> bool:
    async with flying() as flight:
        sent = await sending(crowd, flight, seconds)
        share, grown = flight.share_of_a_core(), flight.grown_mb()
        rate = sent / (time.monotonic() - flight.begun_s)
        final = await flight.end()
    lost = 1.0 - final["reports_received"] / sent
    figures = {"sent": sent, "rate with start [1/s]": rate, "lost [%]": 100.0 * lost}
    figures |= {"share of a core [%]": 100.0 * share, "tracks": final["tracks"], "memory growth [MB]": grown}
    limits = {"lost [%]": ("<=", 0.1), "share of a core [%]": ("<=", 60.0), "decision p99 [CPU ms]": ("<=", 10.0)}
    return judged("traffic", figures | regular(final), limits)


async def poison(seconds: float) -> bool:
    async with flying() as flight:
        sent = await sending(poisoned, flight, seconds)
        final = await flight.end()
    figures = {"good sent": sent, "good decoded [%]": 100.0 * final["reports_received"] / sent} | regular(final)
    return judged("poison", figures, {"good decoded [%]": (">=", 99.0)})


async def attacked(what: str, sender: Callable[..., None], amount: float, limits: dict[str, tuple[str, float]]) -> bool:
    async with flying() as flight:
        intruders = Intruders(flight)
        task = asyncio.create_task(intruders.fly())
        sent = await sending(sender, flight, amount)
        task.cancel()
        grown, resident = flight.grown_mb(), flight.resident_mb()
        final = await flight.end()
    figures = {"sent": sent, "intruders met": intruders.met, "nearest intruder [m]": intruders.nearest_m,
               "memory growth [MB]": grown, "memory [MB]": resident, "tracks": final["tracks"]}  # fmt: skip
    figures |= regular(final)
    return judged(what, figures, {"nearest intruder [m]": (">=", MAC_RADIUS_M)} | limits)


async def flood(seconds: float) -> bool:
    return await attacked(
        "flood", fresh, seconds, {"memory growth [MB]": ("<=", 50.0), "decision p99 [CPU ms]": ("<=", 20.0)}
    )


async def fuzz(count: float) -> bool:
    return await attacked("fuzz", fuzzed, count, {"gap max [ms]": ("<=", 300.0), "memory growth [MB]": ("<=", 50.0)})


async def restart(times: float) -> bool:
    took: list[float] = []
    for _ in range(round(times)):
        async with flying() as flight:
            vehicle = flight.vehicle
            flight.process.kill()
            await flight.process.wait()
            vehicle.vehicle.observer = type(vehicle.vehicle.observer)()
            begun = time.monotonic()
            flight.process = await start(vehicle.port, flight.air_port)
            try:
                while not vehicle.setpoints():
                    await vehicle.changed()
                took.append(time.monotonic() - begun)
                assert vehicle.setpoints()[0].vx == 0.0
            finally:
                flight.process.kill()
                await flight.process.wait()
    return judged(
        "restart", {"median [s]": sorted(took)[len(took) // 2], "best [s]": min(took)}, {"best [s]": ("<=", 1.0)}
    )


async def stop(times: float) -> bool:
    took: list[float] = []
    for _ in range(round(times)):
        async with flying() as flight:
            begun = time.monotonic()
            flight.process.send_signal(signal.SIGTERM)
            assert await flight.process.wait() == 0
            took.append(time.monotonic() - begun)
    return judged(
        "stop", {"median [s]": sorted(took)[len(took) // 2], "worst [s]": max(took)}, {"worst [s]": ("<=", 2.0)}
    )


WHAT = {
    "traffic": (traffic, 600.0), "poison": (poison, 20.0), "flood": (flood, 60.0), "fuzz": (fuzz, 1e6),
    "restart": (restart, 5.0), "stop": (stop, 3.0),
}  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.soak.hostile", description="A daemon under attack.")
    parser.add_argument("what", nargs="*", help="of " + ", ".join(f"{name}[=AMOUNT]" for name in WHAT))
    good = True
    for item in parser.parse_args().what or list(WHAT):
        name, _, amount = item.partition("=")
        if name not in WHAT:
            parser.error(f"{name!r} is none of {', '.join(WHAT)}")
        measure, default = WHAT[name]
        good &= asyncio.run(measure(float(amount) if amount else default))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
