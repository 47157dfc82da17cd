"""The true world of one scenario: true and reported positions, collisions and arrivals.

Units and axes: metres, seconds; north-east-down about home, the ground is down = 0. Index k is system id k + 1.

The truth (``position_ned_m``, ``velocity_ned_mps``) is for the radio, the referee, logs and pages. A vehicle knows only
``reported_position_ned_m``, ``reported_velocity_ned_mps`` and the figures of its receiver; code that steers must not
read anything else.

Physics runs in whole ticks of 20 ms for any step of the caller. So the same commands at the same ticks give the same
flight, in real or in virtual time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt

from ridlink.scenario import Event, Scenario, Wind
from ridlink.words import counted
from sitl_sim.faults import Faults, Machinery
from sitl_sim.gnss import CORRELATION_TIME_S, ErrorModel, GnssReceivers
from sitl_sim.height import HeightEstimators
from sitl_sim.pair_radius import eq8_pair_radius
from sitl_sim.referee import ARRIVAL_RADIUS_M, Referee
from sitl_sim.routes import Routes
from sitl_sim.vehicle import (
    MEASURED,
    TICK_S,
    FleetBattery,
    FleetDynamics,
    FleetWind,
    Ideal,
    VehicleState,
    load_airframe,
    model_for_speed,
)
from sitl_sim.vehicle.state import DESCENT_MPS, FLARE_HEIGHT_M, TOUCHDOWN_MPS
from sitl_sim.verdict import Verdict

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]


class World:
    """One scenario in flight.

    Args:
        scenario: The scenario.
        seed: Seed of all random draws.
        autopilot: "ideal", "px4" or "ardupilot", one for all or one for each vehicle.
        gnss: Error model: "white", "white-radial", "gauss-markov" or "bias".
        sigma_m: Standard deviation for vehicles without one in the scenario.
        airborne: True: all vehicles hover at their starts. False: all are on the ground below their starts until
            ``lift_off``.
        begins: Whether the mission of an airborne fleet begins at once. Otherwise ``begin_mission`` begins it: before,
            nothing is judged, and only injected faults happen.
        arrival: "land": a vehicle that has arrived lands. "leave": it disappears at once, as in the paper.
        gnss_common_share: Share of the variance of position errors that all vehicles have in common.
        gnss_time_constant_s: Correlation time of "gauss-markov".
        airframe: Type of vehicles without one in the scenario; None: the measured type.
        shortest_interval_s: Shortest time between two Remote ID updates of a vehicle that their technology allows.
        pair_radius: Function for uNMAC radii of all pairs, shape (n, n); by default Eq. 8 with true sizes and bounds.

    Raises:
        ValueError: If an autopilot or error model is unknown, or the number of autopilots is wrong.

    Attributes:
        state: A `VehicleState` for each vehicle, shape (n,).
        interval_s: Time between two Remote ID updates of each vehicle, shape (n,).
        receivers: Their receivers, with the figures that these report.
        referee: The judge of this flight.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        seed: int = 1,
        autopilot: str | Sequence[str] = "px4",
        gnss: ErrorModel = "gauss-markov",
        sigma_m: float = 3.5,
        airborne: bool = True,
        begins: bool = True,
        arrival: Literal["land", "leave"] = "land",
        gnss_common_share: float = 0.0,
        gnss_time_constant_s: float = CORRELATION_TIME_S,
        airframe: str | None = None,
        shortest_interval_s: float = 0.0,
        pair_radius: Callable[[World], FloatArray] | None = None,
    ) -> None:
        vehicles = scenario.vehicles
        count = len(vehicles)
        autopilots = [autopilot] * count if isinstance(autopilot, str) else list(autopilot)
        if len(autopilots) != count:
            raise ValueError(f"{counted(len(autopilots), 'autopilot')} for {counted(count, 'vehicle')}")
        position = np.array([vehicle.start_ned_m for vehicle in vehicles]).reshape(count, 3)
        self.is_ghost: BoolArray = np.array([vehicle.ghost for vehicle in vehicles], dtype=np.bool_)
        if not airborne:
            position[~self.is_ghost, 2] = 0.0
        types = [vehicle.airframe or airframe for vehicle in vehicles]
        models = [
            Ideal() if vehicle.ghost else model_for_speed(name, vehicle.speed_mps, kind)
            for name, vehicle, kind in zip(autopilots, vehicles, types, strict=True)
        ]
        sigmas = [sigma_m if vehicle.sigma_m is None else vehicle.sigma_m for vehicle in vehicles]
        self.scenario = scenario
        wanted_s = np.array([vehicle.interval_s or scenario.interval_s for vehicle in vehicles], dtype=np.float64)
        self.interval_s: FloatArray = np.maximum(wanted_s, shortest_interval_s)
        self.time_s = 0.0
        self.receivers = GnssReceivers(
            gnss,
            sigmas,
            seed=seed,
            common_share=gnss_common_share,
            time_constant_s=gnss_time_constant_s,
        )
        self.heights = HeightEstimators(self.receivers.position_error_ned_m[:, 2])
        self.state: IntArray = np.full(
            count, VehicleState.AIRBORNE if airborne else VehicleState.GROUNDED, dtype=np.int64
        )
        self.state[self.is_ghost] = VehicleState.AIRBORNE
        self.battery = FleetBattery(
            [load_airframe(kind or MEASURED[name]).battery for name, kind in zip(autopilots, types, strict=True)]
        )
        self.radio_on: BoolArray = np.ones(count, dtype=np.bool_)
        self.link_on: BoolArray = np.ones(count, dtype=np.bool_)
        self._seed = seed
        self._wind = FleetWind(scenario.wind, count, seed=seed, tick_s=TICK_S)
        self.faults = Faults(
            Machinery(self.receivers, sigmas, self.battery, self.radio_on, self.link_on, self.land, self.set_wind),
            scenario.events,
        )
        self._ghost_rows = np.flatnonzero(self.is_ghost)
        self._ghost_goals = np.array([v.goal_ned_m for v in vehicles if v.ghost]).reshape(-1, 3)
        self._routes = Routes(vehicles)
        self._dynamics = FleetDynamics(
            models, position, wind_ne_mps=scenario.wind.velocity_ne_mps if airborne else (0.0, 0.0)
        )
        self.referee = Referee(scenario, position)
        self._pair_radius = pair_radius or eq8_pair_radius
        self._arrival = arrival
        self._command: FloatArray = np.zeros((count, 3))
        self._ticks = 0
        self._ticks_per_report = max(1, round(scenario.interval_s / TICK_S))
        self._pending_s = 0.0
        self._mission_from_s: float | None = None
        if airborne and begins:
            self.begin_mission()

    # --- truth: for the radio, the referee, logs and observers --------------------------------------------------------

    @property
    def position_ned_m(self) -> FloatArray:
        """True positions, shape (n, 3)."""
        return self._dynamics.position_ned_m

    @property
    def velocity_ned_mps(self) -> FloatArray:
        """True velocities, shape (n, 3)."""
        return self._dynamics.velocity_ned_mps

    @property
    def acceleration_ned_mps2(self) -> FloatArray:
        """True accelerations over the last tick, shape (n, 3); a multirotor's attitude follows from them."""
        return self._dynamics.acceleration_ned_mps2

    @property
    def arrived(self) -> BoolArray:
        """Mask of vehicles that have reached their goals, shape (n,)."""
        return self.referee.arrived

    def verdict(self) -> Verdict:
        """The judgement so far."""
        return self.referee.verdict(self.state == VehicleState.GROUNDED)

    # --- what a vehicle may know of itself ----------------------------------------------------------------------------

    @property
    def reported_position_ned_m(self) -> FloatArray:
        """Reported positions, shape (n, 3): height from the estimators, horizontal position from the receivers."""
        reported = self.position_ned_m + self.receivers.position_error_ned_m
        reported[:, 2] = self.position_ned_m[:, 2] + self.heights.error_down_m
        return reported

    @property
    def receiver_down_m(self) -> FloatArray:
        """Down coordinate of the vehicles by their receivers alone, shape (n,)."""
        return np.asarray(self.position_ned_m[:, 2] + self.receivers.position_error_ned_m[:, 2])

    @property
    def reported_velocity_ned_mps(self) -> FloatArray:
        """Reported velocities, shape (n, 3); exact on the ground, where vehicles know that they stand still."""
        return self.velocity_ned_mps + np.where(self.in_air[:, None], self.receivers.velocity_error_ned_mps, 0.0)

    @property
    def bound_3sigma_m(self) -> FloatArray:
        """Three sigma per horizontal axis, as in RIDLINK_SEPARATION, shape (n,)."""
        return self.receivers.bound_3sigma_m

    # --- state --------------------------------------------------------------------------------------------------------

    @property
    def in_air(self) -> BoolArray:
        """Mask of vehicles that fly or land, shape (n,)."""
        return np.asarray((self.state == VehicleState.AIRBORNE) | (self.state == VehicleState.LANDING))

    @property
    def on_air(self) -> BoolArray:
        """Mask of vehicles that send and receive, shape (n,), for ``Listeners.place_vehicles``: without removed
        vehicles, and without ghosts, which are only false broadcasts."""
        return np.asarray((self.state != VehicleState.GONE) & self.radio_on & ~self.is_ghost)

    @property
    def active(self) -> BoolArray:
        """Mask of vehicles that fly and have not arrived yet, shape (n,)."""
        return np.asarray((self.state == VehicleState.AIRBORNE) & ~self.arrived & ~self.is_ghost)

    @property
    def mission_time_s(self) -> float:
        """Time since the mission began, 0 before."""
        return 0.0 if self._mission_from_s is None else self.time_s - self._mission_from_s

    @property
    def finished(self) -> bool:
        """Whether all vehicles have arrived or collided, or the scenario's time is up."""
        if self._mission_from_s is None:
            return False
        return self.mission_time_s >= self.scenario.duration_s or bool(
            np.all(self.arrived | self.referee.removed | self.is_ghost)
        )

    # --- what the caller does -----------------------------------------------------------------------------------------

    def step(self, dt_s: float) -> None:
        """Let time pass; ticks of 20 ms are flown as they become complete.

        Raises:
            ValueError: If the time is negative or not finite.
        """
        if not (np.isfinite(dt_s) and dt_s >= 0.0):
            raise ValueError(f"dt_s must be finite and not negative, not {dt_s}")
        self._pending_s += dt_s
        while self._pending_s >= TICK_S - 1e-9:
            self._pending_s -= TICK_S
            self._tick()

    def command_velocity(self, index: int, velocity_ned_mps: npt.ArrayLike) -> None:
        """Set the velocity of one vehicle; kept until changed, used while it is AIRBORNE. Its route ends.

        Raises:
            ValueError: If the velocity is not three finite numbers.
        """
        velocity = np.asarray(velocity_ned_mps, dtype=np.float64)
        if velocity.shape != (3,) or not np.all(np.isfinite(velocity)):
            raise ValueError("velocity_ned_mps must be three finite figures")
        self._command[index] = velocity
        self._routes.leave(index)

    def fly_straight(self, index: int) -> None:
        """Send one vehicle straight to its goal at cruise speed, as a vehicle that avoids nobody flies, through the
        points of its route if it has any."""
        self._command[index] = self._routes.set_out(index)

    def lift_off(self, index: int) -> None:
        """Change GROUNDED to AIRBORNE; it climbs when commanded to."""
        if self.state[index] == VehicleState.GROUNDED:
            self._command[index] = 0.0
            self.state[index] = VehicleState.AIRBORNE

    def land(self, index: int) -> None:
        """Change AIRBORNE to LANDING: it stops, descends, and stays where it touches the ground; a ghost does not."""
        if self.state[index] == VehicleState.AIRBORNE and not self.is_ghost[index]:
            self.state[index] = VehicleState.LANDING

    def begin_mission(self) -> None:
        """Start mission time and reset all judgements."""
        self._mission_from_s = self.time_s
        self.referee.begin(self.position_ned_m)
        for index in np.flatnonzero(self.is_ghost).tolist():
            self.fly_straight(index)

    def inject(self, event: Event) -> None:
        """Apply an event now, whatever its time.

        Raises:
            ValueError: If there is no such vehicle.
        """
        self.faults.inject(event)

    def set_wind(self, wind: Wind) -> None:
        """Set the wind from now on."""
        self._wind = FleetWind(wind, len(self.state), seed=self._seed, tick_s=TICK_S)

    # --- one tick -----------------------------------------------------------------------------------------------------

    def _tick(self) -> None:
        in_air = self.in_air
        self.faults.step(self.time_s, None if self._mission_from_s is None else self.mission_time_s)
        flying = self.state == VehicleState.AIRBORNE
        under_way, velocity = self._routes.steer(self.position_ned_m, flying)
        self._command[under_way] = velocity
        self._wind.step()
        self._dynamics.step(self._commands(), TICK_S, in_air, self._wind.velocity_ne_mps)
        self._touch_ground(in_air)
        self.battery.step(self.velocity_ned_mps, in_air, TICK_S)
        for index in np.flatnonzero(self.battery.remaining <= 0.0).tolist():
            self.land(index)
        self.receivers.step(TICK_S)
        self.heights.step(self.receivers.position_error_ned_m[:, 2], TICK_S)
        self._ticks += 1
        self.time_s = self._ticks * TICK_S
        if self._mission_from_s is not None:
            self._judge(in_air)

    def _commands(self) -> FloatArray:
        landing = self.state == VehicleState.LANDING
        command = np.where((self.state == VehicleState.AIRBORNE)[:, None], self._command, 0.0)
        low = -self.position_ned_m[:, 2] < FLARE_HEIGHT_M
        command[:, 2] = np.where(landing, np.where(low, TOUCHDOWN_MPS, DESCENT_MPS), command[:, 2])
        return command

    def _touch_ground(self, in_air: BoolArray) -> None:
        """Stop vehicles at the ground; those that land or descend stay there."""
        below = in_air & (self.position_ned_m[:, 2] >= 0.0)
        if not np.any(below):
            return
        self.position_ned_m[below, 2] = 0.0
        down = (self.state == VehicleState.LANDING) | (self._command[:, 2] > 0.0)
        self.state[below & down] = VehicleState.GROUNDED

    def _judge(self, in_air: BoolArray) -> None:
        self._end_ghosts()
        in_air = in_air & ~self.is_ghost
        active = in_air & self.active
        position, reported = self.position_ned_m, self.reported_position_ned_m
        collided = self.referee.observe(self.mission_time_s, TICK_S, position, reported, in_air=in_air, active=active)
        if self._ticks % self._ticks_per_report == 0 and np.count_nonzero(active) > 1:
            self.referee.observe_reports(
                position,
                reported,
                self._pair_radius(self),
                active=active,
                vertical_error_m=3.0 * self.receivers.v_acc_m,
            )
        self.state[collided] = VehicleState.GONE
        done = self.arrived & (self.state == VehicleState.AIRBORNE)
        self.state[done] = VehicleState.LANDING if self._arrival == "land" else VehicleState.GONE

    def _end_ghosts(self) -> None:
        """End ghosts that have reached their goals."""
        if len(self._ghost_rows):
            gap = self.position_ned_m[self._ghost_rows] - self._ghost_goals
            there = np.hypot(gap[:, 0], gap[:, 1]) <= ARRIVAL_RADIUS_M
            self.state[self._ghost_rows[there]] = VehicleState.GONE
