"""One avoidance daemon per vehicle: all in one process, or each in its own, never in that of the fleet.

Either way they are the daemon that ``ridlink avoid`` runs, on real sockets, with the same configuration.
"""

from __future__ import annotations

import asyncio
import json
import signal
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ridlink.avoidance.settings import GradedSettings, HalfplaneSettings, RotationSettings
from ridlink.avoidance.types import SolverKind
from ridlink.daemon.config import DaemonConfig, as_toml
from ridlink.engine import EngineConfig, Goal
from ridlink.errors import ConfigError, LinkError
from ridlink.geodesy import Geodetic, geodetic_from_ned
from ridlink.links import parse_link_url
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention
from ridlink.scenario import Scenario
from ridlink.separation.chance import DEFAULT_ETA
from ridlink.separation.definitions import Definition
from ridlink.setpoint import SPEED_RANGE, VelocityLimits
from sitl_sim.demo.apart import end_with_parent
from sitl_sim.fleet_config import HOST, FleetConfig, FleetPorts

READY_TIMEOUT_S = 90.0
"""Time for the daemons to start: compiling the kernels for the first time is slow, and so is loading them in
twenty-four processes."""

STOP_TIMEOUT_S = 5.0
SPEED_RESERVE = 1.25
"""Speed limit of setpoints divided by cruise speed; only the clamp uses it, not the solver."""

UNLIMITED_MPS2 = 1e4
"""Acceleration limit of setpoints for a vehicle that obeys at once."""


@dataclass(frozen=True, slots=True)
class Assignment:
    """The daemon of one vehicle."""

    system_id: int
    config: DaemonConfig


def assignments(
    scenario: Scenario,
    definition: Definition,
    fleet: FleetConfig,
    ports: FleetPorts,
    eta: float = DEFAULT_ETA,
    solver: SolverKind = SolverKind.HALFPLANE,
    *,
    vertical: bool = False,
    accuracy_convention: AccuracyConvention = DEFAULT_CONVENTION,
) -> list[Assignment]:
    """One daemon for every cooperative vehicle, with its goal in degrees.

    With the documented ports it listens where the vehicle sends its telemetry, as an offboard program does with PX4.
    With other ports it sends to the vehicle's port, and the vehicle answers.

    Raises:
        ConfigError: If a daemon cannot fly a vehicle, for example one as fast as only vehicles without daemons may be.
    """
    base = EngineConfig().limits
    ideal = fleet.autopilot == "ideal"
    halfplane, graded, rotation = HalfplaneSettings(), GradedSettings(), RotationSettings()
    if ideal:
        graded, rotation = GradedSettings.g2(), RotationSettings.paper()
        halfplane = replace(halfplane, response_time_s=0.0, smoothing=1.0, arrival_deceleration_mps2=float("inf"))
    home = fleet.home_of(scenario)
    obstacles = tuple(_in_degrees(obstacle.polygon_ne_m, home) for obstacle in scenario.obstacles)
    assigned = []
    for index, vehicle in enumerate(scenario.vehicles):
        if not vehicle.cooperative:
            continue
        latitude, longitude, altitude = geodetic_from_ned(vehicle.goal_ned_m, home)
        try:
            engine = EngineConfig(
                goal=Goal(float(latitude), float(longitude), float(altitude)),
                definition=definition,
                eta=eta,
                accuracy_convention=accuracy_convention,
                cruise_mps=vehicle.speed_mps,
                airframe_m=vehicle.airframe_m,
                airframe_height_m=vehicle.airframe_height_m,
                limits=VelocityLimits(
                    min(max(base.horizontal_mps, SPEED_RESERVE * vehicle.speed_mps), SPEED_RANGE.most),
                    base.vertical_mps,
                    UNLIMITED_MPS2 if ideal else base.acceleration_mps2,
                ),
                solver=solver,
                halfplane=halfplane,
                graded=graded,
                rotation=rotation,
                obstacles=obstacles,
                vehicle_sysid=index + 1,
                vertical_avoidance=vertical,
            )
        except ConfigError as error:
            raise ConfigError(f"{scenario.name}: vehicle {index + 1} cannot have a daemon: {error}") from error
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


def daemon_toml(scenario: Scenario, fleet: FleetConfig, system_id: int) -> str:
    """The configuration file of the daemon of one vehicle: goal and obstacles in degrees, links, speed and airframe.

    Raises:
        ConfigError: If there is no such vehicle, it has no daemon, a daemon cannot fly one of the scenario, or the
            kernel is to choose the ports.
    """
    if not 1 <= system_id <= len(scenario.vehicles):
        raise ConfigError(f"{scenario.name} has no vehicle {system_id}: it has {len(scenario.vehicles)}")
    if not (fleet.companion_port and fleet.air_port):
        raise ConfigError(
            "ports that the kernel chooses are not known yet: no --companion-port 0 or --air-port 0, and no --any-ports"
        )
    ports = FleetPorts((), fleet.air_port)
    for assigned in assignments(scenario, EngineConfig().definition, fleet, ports):
        if assigned.system_id == system_id:
            return as_toml(assigned.config)
    raise ConfigError(f"vehicle {system_id} of {scenario.name} avoids nobody (cooperative = false), and has no daemon")


class Daemons:
    """All daemons of one flight, in processes separate from the fleet, so that they know only what they receive.

    Args:
        assigned: One daemon per vehicle.
        each_its_own: Whether each has its own process, as ``ridlink avoid``; otherwise all share one.

    Attributes:
        status: Last reported status of each daemon, by system id.
    """

    def __init__(self, assigned: Sequence[Assignment], *, each_its_own: bool) -> None:
        self.assigned = assigned
        self.status: dict[int, str] = {}
        self._each_its_own = each_its_own
        self._folder = tempfile.TemporaryDirectory(prefix="ridlink-demo-")
        self._processes: list[asyncio.subprocess.Process] = []
        self._vehicles: dict[int, list[int]] = {}
        self._readers: list[asyncio.Task[None]] = []
        self._heard: set[int] = set()
        self._changed = asyncio.Event()
        self._summaries: dict[int, dict[str, Any]] = {}

    async def start(self) -> None:
        """Start the daemons, and wait until each has its links open.

        Raises:
            LinkError: If one does not start.
        """
        configs = {each.system_id: Path(self._folder.name) / f"vehicle-{each.system_id}.toml" for each in self.assigned}
        for each in self.assigned:
            configs[each.system_id].write_text(as_toml(each.config))
        if self._each_its_own:
            for system_id, path in configs.items():
                await self._launch(system_id, "ridlink", "avoid", "--config", str(path), "--json")
        elif configs:
            await self._launch(None, "sitl_sim.demo.crew", *map(str, configs.values()))
        try:
            async with asyncio.timeout(READY_TIMEOUT_S):
                await self._all_heard()
        except TimeoutError:
            raise LinkError(f"the daemons did not come up within {READY_TIMEOUT_S:g} s") from None

    def check(self) -> None:
        """Check that all daemons still run: vehicles without their daemons would hover until the time is up.

        Raises:
            LinkError: If one has ended.
        """
        for reader, process in zip(self._readers, self._processes, strict=True):
            if reader.done():
                reader.result()
                vehicles = ", ".join(map(str, sorted(self._vehicles[process.pid])))
                code = process.returncode or 0
                how = f"signal {-code}" if code < 0 else f"exit code {code}"
                raise LinkError(f"the daemon of vehicle {vehicles} ended in flight ({how})")

    async def stop(self) -> list[dict[str, Any]]:
        """Stop the daemons gently; returns their summaries. May be called twice, and before they have started."""
        for process in self._processes:
            if process.returncode is None:
                process.send_signal(signal.SIGTERM)
        if self._readers:
            await asyncio.wait(self._readers, timeout=STOP_TIMEOUT_S)
        for process in self._processes:
            if process.returncode is None:
                process.kill()
        await asyncio.gather(*self._readers)
        self._folder.cleanup()
        return list(self._summaries.values())

    async def _launch(self, system_id: int | None, module: str, *arguments: str) -> None:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", module, *arguments,
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, preexec_fn=end_with_parent,
        )  # fmt: skip
        self._processes.append(process)
        self._vehicles[process.pid] = [each.system_id for each in self.assigned if system_id in (None, each.system_id)]
        reader = asyncio.create_task(self._read(process, system_id))
        reader.add_done_callback(lambda _: self._changed.set())
        self._readers.append(reader)

    async def _all_heard(self) -> None:
        wanted = {each.system_id for each in self.assigned}
        while not wanted <= self._heard:
            for reader in self._readers:
                if reader.done():
                    reader.result()
            if any(process.returncode is not None for process in self._processes):
                missing = ", ".join(map(str, sorted(wanted - self._heard)))
                raise LinkError(f"the daemon of vehicle {missing} ended at once: its line above says why")
            self._changed.clear()
            await self._changed.wait()

    async def _read(self, process: asyncio.subprocess.Process, system_id: int | None) -> None:
        assert process.stdout is not None
        async for line in process.stdout:
            facts = json.loads(line)
            vehicle = facts.pop("vehicle", system_id)
            self._heard.add(vehicle)
            self._changed.set()
            if facts["event"] == "final":
                self._summaries[vehicle] = facts
            elif facts["event"] == "summary":
                self._note(vehicle, facts)
        await process.wait()

    def _note(self, system_id: int, facts: dict[str, Any]) -> None:
        words = [str(facts[key]) for key in ("state", "status") if facts.get(key)]
        if facts.get("conflicts"):
            words.append(f"{facts['conflicts']} in conflict")
        self.status[system_id] = ", ".join(words)
