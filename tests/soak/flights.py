"""Flights in virtual time: an emulated fleet in lockstep and one engine a vehicle, over real UDP sockets on loopback.

    python -m tests.soak.flights broadcast [--flights 20]
        head-on and crossing, PX4, ArduPilot, and two of each in one fleet; nobody broadcasts but the engines
        (`sim --no-rid`, `avoid --broadcast`)
    python -m tests.soak.flights lossy [--flights 50]
        head-on, crossing and circle8 behind `ridlink impair`'s model: 30 % loss, one by one and in bursts of five

The fleet's time goes on when everybody has had his turn, so that a slow machine changes nothing. Flights are of each
cell of that table. Ends with 1 if two vehicles collided, or a flight had an internal error.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import socket
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Self

from ridlink.avoidance.solver import warm_up
from ridlink.avoidance.types import SolverKind
from ridlink.campaign.statistics import clopper_pearson
from ridlink.engine import Engine
from ridlink.impair.model import Impairer, Impairment
from ridlink.links import Address
from ridlink.scenario import Point3, Scenario, resolve_scenario
from ridlink.separation.definitions import Definition
from sitl_sim.autopilot import Start
from sitl_sim.demo.daemons import assignments
from sitl_sim.fleet_config import HOST, FleetConfig
from sitl_sim.server import FleetServer
from sitl_sim.vehicle import TICK_S

TICKS_PER_STEP = round(0.1 / TICK_S)
PATIENCE_S = 10.0
"""For what was sent over loopback."""

MIXED = "two px4 and two ardupilot"
LANE_M = 60.0
"""Between the two pairs of a mixed fleet: they are in each other's way."""


@dataclass(frozen=True)
class Cell:
    """What is flown again and again with other seeds."""

    scenario: str
    autopilot: str
    broadcast: bool = False
    loss: float = 0.0
    burst: float | None = None

    def __str__(self) -> str:
        words = [self.scenario, self.autopilot]
        if self.broadcast:
            words.append("own broadcasts")
        if self.loss:
            words.append(f"loss {self.loss:.0%}" + (f" in bursts of {self.burst:g}" if self.burst else ""))
        return ", ".join(words)


CELLS = {
    "broadcast": [Cell(s, a, broadcast=True) for s in ("head-on", "crossing") for a in ("px4", "ardupilot", MIXED)],
    "lossy": [
        Cell(s, a, loss=0.3, burst=burst)
        for s in ("head-on", "crossing", "circle8")
        for a in ("px4", "ardupilot")
        for burst in (None, 5.0)
    ],
}
FLIGHTS = {"broadcast": 20, "lossy": 50}


@dataclass(frozen=True)
class Flown:
    """What a flight came to."""

    arrived: int
    vehicles: int
    macs: int
    nearest_m: float
    median_s: float
    errors: int

    def __str__(self) -> str:
        return (
            f"arrived {self.arrived}/{self.vehicles}, MACs {self.macs}, "
            f"nearest {self.nearest_m:.1f} m, median {self.median_s:.1f} s"
        )

    @classmethod
    def of(cls, verdict: dict[str, Any], errors: int) -> Self:
        """What the referee's verdict says."""
        return cls(
            verdict["arrived"],
            verdict["vehicles"],
            verdict["macs"],
            verdict["min_separation_m"] or 0.0,
            verdict["mission_time_s"]["median"] or 0.0,
            errors,
        )


def mixed(pair: Scenario) -> Scenario:
    """Both vehicles of a pair twice, beside each other; in every encounter one is a PX4 and one an ArduPilot."""
    vehicles = []
    for lane, autopilots in enumerate((("px4", "ardupilot"), ("ardupilot", "px4"))):
        for vehicle, autopilot in zip(pair.vehicles, autopilots, strict=True):
            north, east = (vehicle.goal_ned_m[axis] - vehicle.start_ned_m[axis] for axis in (0, 1))
            beside = lane * LANE_M / math.hypot(north, east)
            aside = (abs(east) * beside, abs(north) * beside, 0.0)
            vehicles.append(
                replace(
                    vehicle,
                    autopilot=autopilot,
                    start_ned_m=_moved(vehicle.start_ned_m, aside),
                    goal_ned_m=_moved(vehicle.goal_ned_m, aside),
                )
            )
    return replace(pair, vehicles=tuple(vehicles))


def _moved(point: Point3, by: Point3) -> Point3:
    return point[0] + by[0], point[1] + by[1], point[2] + by[2]


class Fleet(FleetServer):
    """A fleet in lockstep that says when it has begun, and when it has read what was sent to it."""

    def __init__(self, scenario: Scenario, config: FleetConfig) -> None:
        super().__init__(scenario, config)
        self.begun = asyncio.Event()
        self._read = 0
        self._more = asyncio.Event()

    def begin_mission(self) -> None:
        super().begin_mission()
        self.begun.set()

    def _vehicle_handler(self, index: int) -> Callable[[bytes, Address], None]:
        take = super()._vehicle_handler(index)

        def counted(datagram: bytes, address: Address) -> None:
            take(datagram, address)
            self._count()

        return counted

    def _on_air_datagram(self, datagram: bytes, address: Address) -> None:
        super()._on_air_datagram(datagram, address)
        self._count()

    def _count(self) -> None:
        self._read += 1
        self._more.set()

    async def has_read(self, datagrams: int) -> None:
        """Wait until it has read so many since its beginning."""
        async with asyncio.timeout(PATIENCE_S):
            while self._read < datagrams:
                self._more.clear()
                await self._more.wait()


class Pilot:
    """One engine on two real sockets, stepped in virtual time.

    Args:
        engine: The engine.
        vehicle_port: Where its vehicle listens.
        air_port: Where the air is.
        impairer: What becomes of the datagrams that it hears on the air.
    """

    def __init__(self, engine: Engine, vehicle_port: int, air_port: int, impairer: Impairer) -> None:
        self.engine = engine
        self.sent = 0
        self._impairer = impairer
        self._vehicle, self._air = _connected(vehicle_port), _connected(air_port)
        self._waiting: list[tuple[float, bytes]] = []

    def close(self) -> None:
        self._vehicle.close()
        self._air.close()

    def hear(self, now_s: float, utc_s: float) -> None:
        for data in _drained(self._vehicle):
            self.engine.receive_vehicle(data, now_s, source="vehicle", utc_s=utc_s)
        for data in _drained(self._air):
            self._waiting += self._impairer.take(data, now_s)
        ready = [each for each in self._waiting if each[0] <= now_s]
        self._waiting = [each for each in self._waiting if each[0] > now_s]
        for _, data in sorted(ready, key=lambda each: each[0]):
            self.engine.receive_remote_id(data, now_s, source="air", utc_s=utc_s)

    def step(self, now_s: float, utc_s: float) -> None:
        output = self.engine.step(now_s, utc_s=utc_s)
        for frame in output.to_vehicle:
            self._vehicle.send(frame)
            self.sent += 1
        for frame in (*output.to_air, *output.broadcasts):
            self._air.send(frame)
            self.sent += 1


def _connected(port: int) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setblocking(False)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 * 2**20)
    sock.connect((HOST, port))
    return sock


def _drained(sock: socket.socket) -> Iterator[bytes]:
    while True:
        try:
            yield sock.recv(65535)
        except BlockingIOError:
            return


async def fly(cell: Cell, seed: int) -> Flown:
    """One flight, from the first socket to the verdict."""
    config = FleetConfig(
        seed=seed,
        autopilot="px4" if cell.autopilot == MIXED else cell.autopilot,
        start=Start.AIRBORNE,
        remote_id=not cell.broadcast,
        speedup=0.0,
        vehicle_port=0,
        companion_port=0,
        air_port=0,
    )
    scenario = resolve_scenario(cell.scenario, None)
    if cell.autopilot == MIXED:
        scenario = mixed(scenario)
    server, landed = Fleet(scenario, config), asyncio.Event()
    await server.start()
    pilots: list[Pilot] = []
    flying = asyncio.create_task(server.run(landed))
    try:
        for each in assignments(scenario, Definition.CANDIDATE2, config, server.ports):
            engine = Engine(replace(each.config.engine, broadcast=cell.broadcast))
            index = each.system_id - 1
            bad = Impairer(Impairment(loss=cell.loss, burst=cell.burst), (seed, index))
            pilots.append(Pilot(engine, server.ports.vehicles[index], server.ports.air, bad))
        tick = 0
        await server.begun.wait()
        while not server.world.finished:
            now_s, utc_s = server.clock.now_s(), server.clock.utc_s()
            for index, pilot in enumerate(pilots):
                pilot.hear(now_s, utc_s)
                if tick % TICKS_PER_STEP == index % TICKS_PER_STEP:  # daemons do not step all at once
                    pilot.step(now_s, utc_s)
            await server.has_read(sum(pilot.sent for pilot in pilots))
            server.advance(TICK_S)
            tick += 1
    finally:
        landed.set()
        await flying
        await server.close()
        for pilot in pilots:
            pilot.close()
    return Flown.of(server.world.verdict().as_dict(), server.counters["error"])


def fly_all(cells: list[Cell], flights: int, first_seed: int) -> dict[Cell, list[Flown]]:
    """All cells; a line for each flight."""
    flown: dict[Cell, list[Flown]] = {cell: [] for cell in cells}
    for seed in range(first_seed, first_seed + flights):
        for cell in cells:
            result = asyncio.run(fly(cell, seed))
            flown[cell].append(result)
            print(f"{cell}, seed {seed}: {result}", flush=True)
    return flown


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", choices=list(CELLS))
    parser.add_argument("--flights", type=int, help="flights of each cell")
    parser.add_argument("--only", default="", help="cells whose name contains this")
    parser.add_argument("--seed", type=int, default=1, help="of the first flight")
    asked = parser.parse_args()
    cells = [cell for cell in CELLS[asked.table] if asked.only in str(cell)]
    warm_up(SolverKind.HALFPLANE)
    return concluded(fly_all(cells, asked.flights or FLIGHTS[asked.table], asked.seed))


def concluded(flown: dict[Cell, list[Flown]]) -> int:
    """Print a line for each cell; the exit code."""
    failed = False
    for cell, results in flown.items():
        collided = sum(result.macs > 0 for result in results)
        _, most = clopper_pearson(collided, len(results))
        print(
            f"{cell}: {len(results)} flights, {collided} with a MAC (at most {most:.1%} with 95 % confidence), "
            f"{sum(result.arrived == result.vehicles for result in results)} with all arrived, "
            f"nearest {min((result.nearest_m for result in results), default=0.0):.1f} m"
        )
        failed = failed or collided > 0 or any(result.errors for result in results)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
