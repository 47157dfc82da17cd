"""One avoidance daemon a vehicle: in this process, or each in one of its own.

Either way they are the daemon that ``ridlink avoid`` runs, on real sockets, told the same things.
"""

from __future__ import annotations

import asyncio
import json
import signal
import sys
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ridlink.avoidance.types import HalfplaneSettings
from ridlink.daemon.config import DaemonConfig, as_toml
from ridlink.daemon.service import AvoidDaemon
from ridlink.engine import EngineConfig, Goal
from ridlink.errors import LinkError
from ridlink.geodesy import Geodetic, geodetic_from_ned
from ridlink.links import parse_link_url
from ridlink.separation.definitions import Definition
from ridlink.setpoint import VelocityLimits
from sitl_sim.scenario import Scenario
from sitl_sim.server import HOST, FleetConfig, FleetPorts

READY_TIMEOUT_S = 90.0
"""Compiling the kernels for the first time takes its time, twenty-four processes that load them do, too."""

STOP_TIMEOUT_S = 5.0
SPEED_RESERVE = 1.25
"""Limit of setpoints over cruise; only the clamp, not the solver, ever sees it."""

UNLIMITED_MPS2 = 1e4
"""Slew of setpoints for a vehicle that obeys at once."""


@dataclass(frozen=True, slots=True)
class Assignment:
    """The daemon of one vehicle."""

    system_id: int
    config: DaemonConfig


def assignments(scenario: Scenario, definition: Definition, fleet: FleetConfig, ports: FleetPorts) -> list[Assignment]:
    """One daemon for every vehicle that cooperates, with its goal in degrees.

    With the documented ports it listens where the vehicle sends its telemetry, as an offboard program does with PX4.
    Without them it speaks to the vehicle's port, and the vehicle answers there.
    """
    base = EngineConfig().limits
    ideal = fleet.autopilot == "ideal"
    halfplane = HalfplaneSettings()
    if ideal:
        halfplane = replace(halfplane, response_time_s=0.0, smoothing=1.0, arrival_deceleration_mps2=float("inf"))
    obstacles = tuple(_in_degrees(obstacle.polygon_ne_m, fleet.home) for obstacle in scenario.obstacles)
    assigned = []
    for index, vehicle in enumerate(scenario.vehicles):
        if not vehicle.cooperative:
            continue
        latitude, longitude, altitude = geodetic_from_ned(vehicle.goal_ned_m, fleet.home)
        engine = EngineConfig(
            goal=Goal(float(latitude), float(longitude), float(altitude)),
            definition=definition,
            cruise_mps=vehicle.speed_mps,
            airframe_m=vehicle.airframe_m,
            limits=VelocityLimits(
                max(base.horizontal_mps, SPEED_RESERVE * vehicle.speed_mps),
                base.vertical_mps,
                UNLIMITED_MPS2 if ideal else base.acceleration_mps2,
            ),
            halfplane=halfplane,
            obstacles=obstacles,
            vehicle_sysid=index + 1,
        )
        link = (
            f"udpin:{HOST}:{fleet.companion_port + index}"
            if fleet.companion_port
            else f"udpout:{HOST}:{ports.vehicles[index]}"
        )
        config = DaemonConfig(
            vehicle=parse_link_url(link), remote_id=parse_link_url(f"udpout:{HOST}:{ports.air}"), engine=engine
        )
        assigned.append(Assignment(index + 1, config))
    return assigned


def _in_degrees(polygon_ne_m: Sequence[Sequence[float]], home: Geodetic) -> tuple[tuple[float, float], ...]:
    corners = np.array([(north, east, 0.0) for north, east in polygon_ne_m])
    latitude, longitude, _ = geodetic_from_ned(corners, home)
    return tuple(zip(latitude.tolist(), longitude.tolist(), strict=True))


class Daemons(ABC):
    """All daemons of one flight.

    Attributes:
        status: Each daemon's last word on what it does, by system id.
    """

    def __init__(self, assigned: Sequence[Assignment]) -> None:
        self.assigned = assigned
        self.status: dict[int, str] = {}

    @abstractmethod
    async def start(self) -> None:
        """Start them, and wait until each has its links open.

        Raises:
            LinkError: If one does not come up.
        """

    @abstractmethod
    async def stop(self) -> list[dict[str, Any]]:
        """Stop them gently; their summaries."""

    def _note(self, system_id: int, facts: dict[str, Any]) -> None:
        words = [str(facts[key]) for key in ("state", "status") if facts.get(key)]
        if facts.get("conflicts"):
            words.append(f"{facts['conflicts']} in conflict")
        self.status[system_id] = ", ".join(words)


class DaemonsHere(Daemons):
    """As tasks of this process, beside the fleet."""

    def __init__(self, assigned: Sequence[Assignment]) -> None:
        super().__init__(assigned)
        self._stop = asyncio.Event()
        self._tasks: list[asyncio.Task[Any]] = []

    async def start(self) -> None:
        daemons = [
            AvoidDaemon(each.config, on_event=lambda facts, k=each.system_id: self._note(k, facts))  # type: ignore[misc]
            for each in self.assigned
        ]
        self._tasks = [asyncio.create_task(daemon.run(self._stop)) for daemon in daemons]
        ready = asyncio.gather(*(daemon.ready.wait() for daemon in daemons))
        done, _ = await asyncio.wait(
            [*self._tasks, asyncio.ensure_future(ready)], timeout=READY_TIMEOUT_S, return_when=asyncio.FIRST_COMPLETED
        )
        if not ready.done():
            ready.cancel()
            for task in done:
                await task  # raises what ended it
            raise LinkError(f"the daemons did not come up within {READY_TIMEOUT_S:g} s")

    async def stop(self) -> list[dict[str, Any]]:
        self._stop.set()
        ended = await asyncio.gather(*self._tasks, return_exceptions=True)
        return [summary.as_dict() for summary in ended if not isinstance(summary, BaseException)]


class DaemonProcesses(Daemons):
    """As ``ridlink avoid``, each a process of its own."""

    def __init__(self, assigned: Sequence[Assignment]) -> None:
        super().__init__(assigned)
        self._folder = tempfile.TemporaryDirectory(prefix="ridlink-demo-")
        self._processes: list[asyncio.subprocess.Process] = []
        self._readers: list[asyncio.Task[dict[str, Any]]] = []
        self._up: list[asyncio.Event] = []

    async def start(self) -> None:
        for each in self.assigned:
            config = Path(self._folder.name) / f"vehicle-{each.system_id}.toml"
            config.write_text(as_toml(each.config))
            process = await asyncio.create_subprocess_exec(
                sys.executable, "-m", "ridlink", "avoid", "--config", str(config), "--json",
                stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE,
            )  # fmt: skip
            self._processes.append(process)
            up = asyncio.Event()
            self._up.append(up)
            self._readers.append(asyncio.create_task(self._read(each.system_id, process, up)))
        try:
            await asyncio.wait_for(asyncio.gather(*(up.wait() for up in self._up)), READY_TIMEOUT_S)
        except TimeoutError:
            raise LinkError(f"the daemons did not come up within {READY_TIMEOUT_S:g} s") from None
        ended = [
            each.system_id
            for each, process in zip(self.assigned, self._processes, strict=True)
            if process.returncode is not None
        ]
        if ended:
            raise LinkError(f"the daemon of vehicle {ended[0]} ended at once: its line above says why")

    async def _read(self, system_id: int, process: asyncio.subprocess.Process, up: asyncio.Event) -> dict[str, Any]:
        assert process.stdout is not None
        last: dict[str, Any] = {}
        async for line in process.stdout:
            up.set()
            facts = json.loads(line)
            if facts["event"] == "final":
                last = facts
            elif facts["event"] == "summary":
                self._note(system_id, facts)
        await process.wait()
        up.set()
        return last

    async def stop(self) -> list[dict[str, Any]]:
        for process in self._processes:
            if process.returncode is None:
                process.send_signal(signal.SIGTERM)
        _, late = await asyncio.wait(self._readers, timeout=STOP_TIMEOUT_S) if self._readers else (set(), set())
        for process in self._processes if late else ():
            if process.returncode is None:
                process.kill()
        summaries = await asyncio.gather(*self._readers)
        self._folder.cleanup()
        return [summary for summary in summaries if summary]
