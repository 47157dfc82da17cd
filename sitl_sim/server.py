"""The fleet on the network: one UDP socket a vehicle, one for the air, and real time.

Everything that decides lies elsewhere and knows neither sockets nor clocks: `World`, `Autopilot`, `Broadcaster`, `Air`.
Here the world is stepped 50 times a second, datagrams are carried to and fro, and whatever fails is counted and logged
without taking the fleet along.

All sockets are on loopback. Vehicle i listens on 14580 + i - 1 and sends its telemetry to 14540 + i - 1, as PX4's own
simulations do; the air is 14650.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from ridlink.errors import LinkError
from ridlink.links import Link, open_link
from ridlink.scenario import Scenario
from sitl_sim.air_socket import Address, AirSocket
from sitl_sim.autopilot import Autopilot, FleetNavigation, Outgoing, Start
from sitl_sim.broadcast import Broadcaster
from sitl_sim.clock import FleetClock
from sitl_sim.display import TrafficDisplay
from sitl_sim.draws import Stream, vehicle_generator
from sitl_sim.fleet_config import HOST, FleetConfig, FleetPorts
from sitl_sim.radio import Air
from sitl_sim.vehicle import TICK_S
from sitl_sim.world import FloatArray, VehicleState, World

MAX_CATCH_UP_S = 0.25
"""Longest time flown in one go after a stall; for what is beyond, the vehicles stood still."""

VEHICLES_AT_ONCE = 40
"""Vehicles served in one go."""

ERROR_LOG_S = 1.0
"""Shortest time between two log lines about failures."""

log = logging.getLogger(__name__)


class PortError(LinkError):
    """One of the fleet's own ports that cannot be had."""


class FleetServer:
    """A fleet in real time on loopback.

    Args:
        scenario: What is flown.
        config: How.
        utc_clock: Seconds since 1970.
        pair_radius: uNMAC radii that the referee counts violations of; the world's default unless given.

    Attributes:
        world: The truth; for referees, logs and pages, never for anything that steers.
        autopilots: The vehicles' MAVLink faces, in the order of system ids.
        air: The broadcast medium.
        counters: Events by cause: tick, slipped_ms, error.
        mission_begun: Whether mission time counts.
    """

    def __init__(
        self,
        scenario: Scenario,
        config: FleetConfig | None = None,
        *,
        utc_clock: Callable[[], float] = time.time,
        pair_radius: Callable[[World], FloatArray] | None = None,
    ) -> None:
        self.config = config = config or FleetConfig()
        self.scenario = scenario
        autopilots = config.autopilots_of(scenario)
        config.check_ports(len(scenario.vehicles))
        self.world = World(
            scenario,
            seed=config.seed,
            autopilot=autopilots,
            gnss=config.gnss,
            sigma_m=config.sigma_m,
            airborne=config.start is not Start.GROUND,
            begins=config.start is Start.AIRBORNE,
            arrival="leave" if config.autopilot == "ideal" else "land",
            gnss_common_share=config.gnss_common_share,
            gnss_time_constant_s=config.gnss_time_constant_s,
            airframe=config.airframe,
            pair_radius=pair_radius,
        )
        self.home = config.home_of(scenario)
        self.clock = FleetClock(time.monotonic, utc_clock, config.speedup)
        utc_clock = self.clock.utc_s
        self._display = TrafficDisplay()
        self._display_link: Link | None = None
        self.air = Air(config.technology, range_m=config.range_m, loss=config.loss, seed=config.seed, home=self.home)
        self._navigation = FleetNavigation(self.world, self.home)
        self.autopilots = [
            Autopilot(
                self.world,
                index,
                self._navigation,
                flavour=autopilots[index],
                utc_clock=utc_clock,
                start=config.start,
                companion=(HOST, config.companion_port + index) if config.companion_port else None,
            )
            for index in range(len(scenario.vehicles))
        ]
        self._broadcasters = [self._broadcaster(autopilot, utc_clock) for autopilot in self.autopilots]
        self.counters: Counter[str] = Counter()
        self.mission_begun = False
        self._vehicle_links: list[Link] = []
        self._air_socket = AirSocket(
            self.air,
            self.clock,
            buses=len(scenario.vehicles) if config.rid_on_bus else 0,
            relay=lambda index, frames: self.autopilots[index].relay(frames),
            note_failure=self._note_failure,
        )
        self._loop: asyncio.AbstractEventLoop | None = None
        self._tick_handle: asyncio.TimerHandle | None = None
        self._flown_until_s = 0.0
        self._expired_s = 0.0
        self._logged_s = -math.inf
        self._unlogged = 0

    def _broadcaster(self, autopilot: Autopilot, utc_clock: Callable[[], float]) -> Broadcaster:
        generator = vehicle_generator(self.config.seed, Stream.PHASE, autopilot.system_id - 1)
        spec = self.scenario.vehicles[autopilot.system_id - 1]
        return Broadcaster(
            autopilot.system_id,
            spec,
            autopilot.telemetry.home,
            interval_s=max(spec.interval_s or self.scenario.interval_s, self.air.technology.period_s),
            utc_clock=utc_clock,
            phase=float(generator.random()),
        )

    # --- life ---------------------------------------------------------------------------------------------------------

    async def start(self) -> None:
        """Open all sockets.

        Raises:
            PortError: If a port is in use; whatever is wrong, those opened before are released.
            LinkError, ConfigError: If there can be no link to the ground station.
        """
        self._loop = asyncio.get_running_loop()
        config = self.config
        try:
            for index in range(len(self.autopilots)):
                port = config.vehicle_port + index if config.vehicle_port else 0
                self._vehicle_links.append(await _listen(port, self._vehicle_handler(index)))
            self._air_socket.attach(await _listen(config.air_port, self._on_air_datagram))
            if config.ground_station is not None:
                self._display_link = await open_link(config.ground_station, lambda _, __: None)
        except BaseException:
            await self.close()
            raise

    @property
    def ports(self) -> FleetPorts:
        """Ports as bound, after `start`."""
        air = self._air_socket.port
        if air is None:
            raise RuntimeError("the fleet has not been started")
        return FleetPorts(tuple(link.local_address[1] for link in self._vehicle_links), air)

    async def run(self, stop: asyncio.Event) -> None:
        """Fly in real time until `stop` is set."""
        if self._loop is None:
            raise RuntimeError("the fleet has not been started")
        self._flown_until_s = self.clock.now_s()
        if self.config.start is Start.AIRBORNE or not any(v.cooperative for v in self.scenario.vehicles):
            self.begin_mission()
        if not self.clock.is_lockstep:
            self._tick_handle = self._loop.call_soon(self._on_tick)  # type: ignore[assignment]
            self._air_socket.run()
        try:
            await stop.wait()
        finally:
            if self._tick_handle is not None:
                self._tick_handle.cancel()
            self._tick_handle = None
            self._air_socket.rest()

    async def close(self) -> None:
        """Release all ports."""
        for link in self._vehicle_links:
            link.close()
        self._air_socket.close()
        if self._display_link is not None:
            self._display_link.close()

    def begin_mission(self) -> None:
        """Mission time counts from now, and those who avoid nobody set out.

        An airborne fleet begins with `run`. One from the ground begins when all cooperative vehicles obey setpoints in
        the air. A holding one begins when its owner says so.
        """
        self.mission_begun = True
        self.world.begin_mission()
        for autopilot in self.autopilots:
            autopilot.pilot.begin_mission()

    # --- time ---------------------------------------------------------------------------------------------------------

    def _on_tick(self) -> None:
        assert self._loop is not None
        now_s = self.clock.now_s()
        try:
            self._fly(now_s)
            self._navigation.refresh()
            self.air.listeners.place_vehicles(self.world.position_ned_m, self.world.on_air)
        except Exception:
            self._note_failure("tick")
        self._serve(0, now_s)

    def _serve(self, first: int, now_s: float) -> None:
        """Let some vehicles say what is due, then let the loop breathe before the next ones: datagrams that have come
        meanwhile do not wait for a whole fleet."""
        assert self._loop is not None
        after = first + VEHICLES_AT_ONCE
        self._serve_some(range(first, min(after, len(self.autopilots))), now_s)
        if after < len(self.autopilots):
            self._tick_handle = self._loop.call_soon(self._serve, after, now_s)  # type: ignore[assignment]
            return
        try:
            self._end_tick(now_s)
        except Exception:
            self._note_failure("tick")
        if not self.clock.is_lockstep:
            next_s = self.clock.real_of(self._flown_until_s + TICK_S)
            self._tick_handle = self._loop.call_at(next_s, self._on_tick)

    def _serve_some(self, rows: range, now_s: float) -> None:
        for index in rows:
            autopilot = self.autopilots[index]
            try:
                self._send(index, autopilot.tick(now_s))
                if self.config.remote_id:
                    self._broadcast(index, autopilot, now_s)
            except Exception:
                self._note_failure(f"vehicle {autopilot.system_id}")

    def advance(self, seconds: float) -> None:
        """In lockstep (`speedup` 0): let time go on by so much, tick by tick, and send what is due.

        Raises:
            RuntimeError: If time goes on by itself.
        """
        if not self.clock.is_lockstep:
            raise RuntimeError("the fleet's time goes on by itself; lockstep is speedup 0")
        for _ in range(round(seconds / TICK_S)):
            self.clock.advance(TICK_S)
            now_s = self.clock.now_s()
            self._fly(now_s)
            self._navigation.refresh()
            self.air.listeners.place_vehicles(self.world.position_ned_m, self.world.on_air)
            self._serve_some(range(len(self.autopilots)), now_s)
            self._end_tick(now_s)

    def _fly(self, now_s: float) -> None:
        """Step the world up to now, in whole ticks."""
        behind_s = now_s - self._flown_until_s
        if behind_s > MAX_CATCH_UP_S:
            self.counters["slipped_ms"] += round((behind_s - MAX_CATCH_UP_S) * 1e3)
            self._flown_until_s = now_s - MAX_CATCH_UP_S
            behind_s = MAX_CATCH_UP_S
        ticks = int(behind_s / TICK_S + 1e-6)
        for _ in range(ticks):
            self._flown_until_s += TICK_S
            self.counters["tick"] += 1
            self.world.step(TICK_S)

    def _end_tick(self, now_s: float) -> None:
        if not self.mission_begun and self.config.start is Start.GROUND:
            self._watch_for_mission(now_s)
        if now_s - self._expired_s >= 1.0:
            self._expired_s = now_s
            self._air_socket.refresh(now_s)
            if self._display_link is not None:
                for frame in self._display.frames([self._navigation[k] for k in range(len(self.autopilots))]):
                    self._display_link.send(frame)
        self._air_socket.deliver()

    def _broadcast(self, index: int, autopilot: Autopilot, now_s: float) -> None:
        spec = self.scenario.vehicles[index]
        if spec.silent or not self.world.radio_on[index]:
            return
        # a ghost is not there: its signal comes from wherever its transmitter is
        sent_from = (spec.transmitter_ned_m or self.world.position_ned_m[index]) if spec.ghost else None
        command = autopilot.pilot.command_ned_mps if autopilot.is_avoiding else None
        for datagram in self._broadcasters[index].tick(self._navigation[index], command, now_s):
            self.air.broadcast(autopilot.system_id, sent_from, datagram, now_s)

    def _watch_for_mission(self, now_s: float) -> None:
        cooperative = [a for a, v in zip(self.autopilots, self.scenario.vehicles, strict=True) if v.cooperative]
        if cooperative and all(autopilot.pilot.is_steered(now_s) for autopilot in cooperative):
            self.begin_mission()

    # --- bytes --------------------------------------------------------------------------------------------------------

    def _send(self, index: int, outgoing: Outgoing) -> None:
        for datagram, address in outgoing:
            self._vehicle_links[index].send(datagram, address)

    def _vehicle_handler(self, index: int) -> Callable[[bytes, Address], None]:
        autopilot = self.autopilots[index]

        def take(datagram: bytes, address: Address) -> None:
            assert self._loop is not None
            try:
                self._send(index, autopilot.receive(datagram, address, self.clock.now_s()))
            except Exception:
                self._note_failure(f"vehicle {autopilot.system_id}")

        return take

    def _on_air_datagram(self, datagram: bytes, address: Address) -> None:
        self._air_socket.receive(datagram, address)

    # --- what went wrong, and what is to be seen ----------------------------------------------------------------------

    def _note_failure(self, where: str) -> None:
        """Count a failure of our own code; the log gets one of them a second."""
        self.counters["error"] += 1
        self._unlogged += 1
        now_s = time.monotonic()
        if now_s - self._logged_s >= ERROR_LOG_S:
            log.exception("%s: %d failure(s) in the last second, the fleet goes on", where, self._unlogged)
            self._logged_s, self._unlogged = now_s, 0

    def snapshot(self) -> dict[str, Any]:
        """Plain values for JSON: time, and for every vehicle mode, arming, state and true position."""
        states = self.world.state.tolist()
        positions = (np.round(self.world.position_ned_m, 2) + 0.0).tolist()  # no "-0.0"
        velocities = (np.round(self.world.velocity_ned_mps, 2) + 0.0).tolist()
        return {
            "time_s": round(self.world.time_s, 2),
            "mission_time_s": round(self.world.mission_time_s, 2) if self.mission_begun else None,
            "vehicles": [
                {
                    "system_id": autopilot.system_id,
                    "mode": str(autopilot.pilot.mode),
                    "armed": autopilot.pilot.armed,
                    "state": VehicleState(state).name.lower(),
                    "avoiding": autopilot.is_avoiding,
                    "position_ned_m": position,
                    "velocity_ned_mps": velocity,
                }
                for autopilot, state, position, velocity in zip(
                    self.autopilots, states, positions, velocities, strict=True
                )
            ],
        }


async def _listen(port: int, handler: Callable[[bytes, Address], None]) -> Link:
    try:
        return await open_link(f"udpin:{HOST}:{port}", handler)
    except LinkError as error:
        raise PortError(
            f"cannot use UDP port {port}: another simulation may be running (ss -ulpn shows who has it)"
        ) from error
