"""A fleet without sockets and clocks: the truth, the vehicles, and the air.

The caller steps `world` in ticks of 20 ms, then calls `look`, then ticks the autopilots and calls `broadcast`. Times
are the caller's, in seconds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ridlink.scenario import Scenario
from sitl_sim.autopilot import Autopilot, FleetNavigation, Start
from sitl_sim.broadcast import Broadcaster
from sitl_sim.display import TrafficDisplay
from sitl_sim.draws import Stream, vehicle_generator
from sitl_sim.fleet_config import HOST, FleetConfig
from sitl_sim.radio import Air
from sitl_sim.vehicle import VehicleState
from sitl_sim.world import FloatArray, World


class Fleet:
    """A scenario in flight.

    Args:
        scenario: The scenario.
        config: How it is flown.
        utc_clock: Seconds since 1970.
        pair_radius: uNMAC radii whose violations the referee counts; by default those of the world.

    Raises:
        ConfigError: If the scenario cannot be flown with this configuration.

    Attributes:
        world: The truth, for referees, logs and pages, never for code that steers.
        home: Geodetic position of the scenario's origin.
        autopilots: The vehicles' autopilots, in the order of system ids.
        air: The broadcast medium.
        mission_begun: Whether mission time runs.
    """

    def __init__(
        self,
        scenario: Scenario,
        config: FleetConfig,
        utc_clock: Callable[[], float],
        pair_radius: Callable[[World], FloatArray] | None = None,
    ) -> None:
        self._scenario, self._config = scenario, config
        autopilots = config.autopilots_of(scenario)
        self.home = config.home_of(scenario)
        self.air = Air(config.technology, range_m=config.range_m, loss=config.loss, seed=config.seed, home=self.home)
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
            shortest_interval_s=self.air.technology.period_s,
            pair_radius=pair_radius,
        )
        self._navigation = FleetNavigation(self.world, self.home)
        self.autopilots = [
            Autopilot(
                self.world,
                index,
                self._navigation,
                flavour=flavour,
                utc_clock=utc_clock,
                start=config.start,
                companion=(HOST, config.companion_port + index) if config.companion_port else None,
            )
            for index, flavour in enumerate(autopilots)
        ]
        self._broadcasters = [self._broadcaster(autopilot, utc_clock) for autopilot in self.autopilots]
        self._display = TrafficDisplay()
        self.mission_begun = False

    def _broadcaster(self, autopilot: Autopilot, utc_clock: Callable[[], float]) -> Broadcaster:
        index = autopilot.system_id - 1
        spec = self._scenario.vehicles[index]
        return Broadcaster(
            autopilot.system_id,
            spec,
            autopilot.telemetry.home,
            interval_s=float(self.world.interval_s[index]),
            utc_clock=utc_clock,
            phase=float(vehicle_generator(self._config.seed, Stream.PHASE, index).random()),
        )

    # --- the mission --------------------------------------------------------------------------------------------------

    @property
    def begins_by_itself(self) -> bool:
        """Whether the mission begins at once: all vehicles are in the air and obey, or none waits for setpoints."""
        return self._config.start is Start.AIRBORNE or not any(v.cooperative for v in self._scenario.vehicles)

    def is_taken_over(self, now_s: float) -> bool:
        """Whether all cooperative vehicles of a fleet from the ground are airborne and obey setpoints."""
        if self.mission_begun or self._config.start is not Start.GROUND:
            return False
        cooperative = [a for a, v in zip(self.autopilots, self._scenario.vehicles, strict=True) if v.cooperative]
        return bool(cooperative) and all(autopilot.pilot.is_steered(now_s) for autopilot in cooperative)

    def begin_mission(self) -> None:
        """Start mission time, and send off the vehicles that avoid nobody."""
        self.mission_begun = True
        self.world.begin_mission()
        for autopilot in self.autopilots:
            autopilot.begin_mission()

    # --- one tick -----------------------------------------------------------------------------------------------------

    def look(self) -> None:
        """Copy the present world to the vehicles' navigation and to the radio."""
        self._navigation.refresh()
        self.air.listeners.place_vehicles(self.world.position_ned_m, self.world.on_air)

    def broadcast(self, index: int, now_s: float) -> None:
        """Broadcast the Remote ID of a vehicle, if it is due."""
        spec, autopilot = self._scenario.vehicles[index], self.autopilots[index]
        if not self._config.remote_id or spec.silent or not self.world.radio_on[index]:
            return
        # a ghost does not exist: its signal comes from the place of its transmitter
        sent_from = (spec.transmitter_ned_m or self.world.position_ned_m[index]) if spec.ghost else None
        command = autopilot.pilot.command_ned_mps if autopilot.is_avoiding else None
        self._broadcasters[index].home = autopilot.telemetry.home
        for datagram in self._broadcasters[index].tick(self._navigation[index], command, now_s):
            self.air.broadcast(autopilot.system_id, sent_from, datagram, now_s)

    # --- what is to be seen -------------------------------------------------------------------------------------------

    def display_frames(self) -> list[bytes]:
        """The traffic around vehicle 1 for a ground station; due once a second."""
        return self._display.frames([self._navigation[index] for index in range(len(self.autopilots))])

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
                    "mode": autopilot.mode_name,
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
