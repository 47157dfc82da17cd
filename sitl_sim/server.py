"""The fleet on the network: one UDP socket per vehicle, one for the air, and real time.

`Fleet` makes all decisions, without sockets and clocks. This module steps the world 50 times a second and transfers
datagrams. Failures are counted and logged, and do not stop the fleet.

All sockets are on loopback. Vehicle i listens on 14580 + i - 1 and sends its telemetry to 14540 + i - 1, as PX4's own
simulations do; the air is 14650.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import math
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from ridlink.errors import LinkError
from ridlink.links import Link, open_link
from ridlink.scenario import Scenario
from sitl_sim.air_socket import Address, AirSocket
from sitl_sim.autopilot import Outgoing
from sitl_sim.clock import FleetClock
from sitl_sim.fleet import Fleet
from sitl_sim.fleet_config import HOST, FleetConfig, FleetPorts
from sitl_sim.vehicle import TICK_S
from sitl_sim.world import FloatArray, World

MAX_CATCH_UP_S = 0.25
"""Longest time simulated at once after a stall; for the rest of the stall the vehicles stood still."""

VEHICLES_AT_ONCE = 40
"""Vehicles served at once."""

ERROR_LOG_S = 1.0
"""Shortest time between two log lines about failures."""

log = logging.getLogger(__name__)


class PortError(LinkError):
    """One of the fleet's own ports is not available."""


class FleetServer:
    """A fleet in real time on loopback.

    Args:
        scenario: The scenario.
        config: How it is flown.
        utc_clock: Seconds since 1970.
        pair_radius: uNMAC radii whose violations the referee counts; by default those of the world.

    Raises:
        ConfigError: If the scenario cannot be flown with this configuration, or ports overlap.

    Attributes:
        world: The truth, for referees, logs and pages, never for code that steers.
        autopilots: The vehicles' autopilots, in the order of system ids.
        air: The broadcast medium.
        home: Geodetic position of the scenario's origin.
        clock: The fleet's time.
        counters: Events by cause: tick, slipped_ms, error.
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
        self.clock = FleetClock(time.monotonic, utc_clock, config.speedup)
        self._fleet = fleet = Fleet(scenario, config, self.clock.utc_s, pair_radius)
        config.check_ports(len(scenario.vehicles))
        self.world, self.home, self.autopilots, self.air = fleet.world, fleet.home, fleet.autopilots, fleet.air
        self.counters: Counter[str] = Counter()
        self._vehicle_links: list[Link] = []
        self._display_link: Link | None = None
        self._air_socket = AirSocket(
            self.air,
            self.clock,
            buses=len(scenario.vehicles) if config.rid_on_bus else 0,
            relay=lambda index, frames: self.autopilots[index].relay(frames),
            note_failure=self._note_failure,
        )
        self._loop: asyncio.AbstractEventLoop | None = None
        self._tick_handle: asyncio.Handle | None = None
        self._flown_until_s = 0.0
        self._ahead_s = 0.0
        self._expired_s = -math.inf
        self._logged_s = -math.inf
        self._unlogged = 0

    # --- life ---------------------------------------------------------------------------------------------------------

    async def start(self) -> None:
        """Open all sockets.

        Raises:
            PortError: If a port is in use; after any error, ports opened before are released.
            LinkError, ConfigError: If a port cannot be used, or the link to the ground station not be opened.
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
        """Ports as bound, after `start`.

        Raises:
            RuntimeError: If the fleet has not been started.
        """
        air = self._air_socket.port
        if air is None:
            raise RuntimeError("the fleet has not been started")
        return FleetPorts(tuple(link.local_address[1] for link in self._vehicle_links), air)

    async def run(self, stop: asyncio.Event) -> None:
        """Fly in real time until `stop` is set; in lockstep, as `advance` says.

        Raises:
            RuntimeError: If the fleet has not been started.
        """
        if self._loop is None:
            raise RuntimeError("the fleet has not been started")
        self._flown_until_s = self.clock.now_s()
        if self._fleet.begins_by_itself:
            self.begin_mission()
        if not self.clock.is_lockstep:
            self._tick_handle = self._loop.call_soon(self._on_tick)
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

    @property
    def mission_begun(self) -> bool:
        """Whether mission time runs."""
        return self._fleet.mission_begun

    def begin_mission(self) -> None:
        """Start mission time, and send off the vehicles that avoid nobody.

        An airborne fleet begins with `run`. One from the ground begins when all cooperative vehicles obey setpoints in
        the air. A holding one begins when its owner calls this method.
        """
        self._fleet.begin_mission()

    # --- time ---------------------------------------------------------------------------------------------------------

    def _on_tick(self) -> None:
        assert self._loop is not None
        now_s = self.clock.now_s()
        try:
            self._fly(now_s)
            self._fleet.look()
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
            self._tick_handle = self._loop.call_soon(self._serve, after, now_s)
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
                self._fleet.broadcast(index, now_s)
            except Exception:
                self._note_failure(f"vehicle {autopilot.system_id}")

    def advance(self, seconds: float) -> None:
        """In lockstep (`speedup` 0): advance time tick by tick, and send what is due; a rest shorter than a tick of 20
        ms waits for the next call.

        Raises:
            RuntimeError: If not in lockstep.
            ValueError: If the time is negative or not finite.
        """
        if not self.clock.is_lockstep:
            raise RuntimeError("the fleet's time goes on by itself; lockstep is speedup 0")
        if not (math.isfinite(seconds) and seconds >= 0.0):
            raise ValueError(f"seconds must be finite and not negative, not {seconds}")
        self._ahead_s += seconds
        ticks = int(self._ahead_s / TICK_S + 1e-6)
        self._ahead_s -= ticks * TICK_S
        for _ in range(ticks):
            self.clock.advance(TICK_S)
            now_s = self.clock.now_s()
            self._fly(now_s)
            self._fleet.look()
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
        if self._fleet.is_taken_over(now_s):
            self.begin_mission()
        if now_s - self._expired_s >= 1.0:
            self._expired_s = now_s
            self._air_socket.refresh(now_s)
            if self._display_link is not None:
                for frame in self._fleet.display_frames():
                    self._display_link.send(frame)
        self._air_socket.deliver()

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
        """Count a failure of our own code; at most one a second is logged."""
        self.counters["error"] += 1
        self._unlogged += 1
        now_s = time.monotonic()
        if now_s - self._logged_s >= ERROR_LOG_S:
            log.exception("%s: %d failure(s) in the last second, the fleet goes on", where, self._unlogged)
            self._logged_s, self._unlogged = now_s, 0

    def snapshot(self) -> dict[str, Any]:
        """Plain values for JSON: time, and for every vehicle mode, arming, state and true position."""
        return self._fleet.snapshot()


async def _listen(port: int, handler: Callable[[bytes, Address], None]) -> Link:
    try:
        return await open_link(f"udpin:{HOST}:{port}", handler)
    except LinkError as error:
        if not isinstance(error.__cause__, OSError) or error.__cause__.errno != errno.EADDRINUSE:
            raise
        raise PortError(
            f"cannot use UDP port {port}: another simulation may be running (ss -ulpn shows who has it)"
        ) from error
