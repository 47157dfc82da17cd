"""Where the engine flies: to its goal, round neighbours and obstacles, over and under them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from ridlink.avoidance.settings import GradedSettings, RotationSettings
from ridlink.avoidance.types import SolverKind, Status
from ridlink.engine import Engine, EngineConfig, Goal
from ridlink.engine.static_obstacles import StaticObstacles
from ridlink.errors import ConfigError
from ridlink.failsafe import State
from ridlink.geodesy import Geodetic
from ridlink.mavlink.codec import Encoder
from ridlink.remote_id.accuracy import AccuracyConvention
from ridlink.separation import Definition
from tests.avoidance.lots import clock_in, turn_of
from tests.daemon.emulated import GUIDED, HOME, OFFBOARD, Emulated, at
from tests.engine.flight import IDEAL, STEP_S, Flight, config, intruder

pytestmark = pytest.mark.no_cover


def test_flies_to_the_goal_and_keeps_station_there() -> None:
    flight = Flight(settings=config(100.0))
    flight.step(300)
    assert flight.vehicle.position == pytest.approx((100.0, 0.0, -50.0), abs=0.5)
    assert flight.engine.rung.state is State.ENGAGED
    flight.step(50)
    assert flight.vehicle.position == pytest.approx((100.0, 0.0, -50.0), abs=0.5)
    assert len(flight.vehicle.observer.setpoints) == 350


def test_the_first_setpoint_is_zero_and_every_step_has_one() -> None:
    flight = Flight()
    first = flight.step()
    assert first.decision.commanded_ned_mps == (0.0, 0.0, 0.0)
    assert flight.step().decision.commanded_ned_mps[0] == pytest.approx(0.5, abs=1e-4)  # type: ignore[index]
    flight.step(20)
    assert len(flight.vehicle.observer.setpoints) == 22


@pytest.mark.parametrize("now_s", [math.nan, math.inf, -math.inf])
def test_a_time_that_is_none_is_refused_and_changes_nothing(now_s: float) -> None:
    flight, other = Flight(), Flight()
    flight.step(20), other.step(20)
    with pytest.raises(ValueError, match=f"now_s must be finite, got {now_s}"):
        flight.engine.step(now_s)
    assert flight.step().decision == other.step().decision


@pytest.mark.parametrize(("wanted_mps", "flown_mps"), [(4.0, 4.0), (25.0, 10.0), (None, 10.0)])
def test_a_goal_may_be_flown_to_slower_than_at_cruise_speed_and_never_faster(
    wanted_mps: float | None, flown_mps: float
) -> None:
    flight = Flight(settings=EngineConfig(goal=Goal(*at(300.0), speed_mps=wanted_mps)))
    flight.step(60)
    assert flight.vehicle.velocity[0] == pytest.approx(flown_mps, abs=0.01)


def test_altitude_is_held_or_flown_to() -> None:
    level = Flight(settings=EngineConfig(goal=Goal(*at(50.0)[:2])))
    level.step(100)
    assert level.vehicle.position[2] == pytest.approx(-50.0, abs=0.1)
    climb = Flight(settings=EngineConfig(goal=Goal(*at(50.0, up_m=80.0))))
    climb.step(300)
    assert climb.vehicle.position[2] == pytest.approx(-80.0, abs=0.5)
    assert min(message.vz for message in climb.vehicle.observer.setpoints) == pytest.approx(-2.0, abs=1e-3)


def test_two_engines_head_on_pass_right_and_keep_their_discs() -> None:
    first, second = (
        Flight(Emulated(1, ned_m=(-150.0, 0.0, -50.0)), config(150.0)),
        Flight(Emulated(2, ned_m=(150.0, 0.0, -50.0)), config(-150.0)),
    )
    for me, other in ((first, second), (second, first)):
        me.others.append(
            lambda now_s, o=other: o.vehicle.remote_id(now_s, command=o.engine.setpoints.velocity)  # type: ignore[misc]
        )
    least, sides = math.inf, ()
    for _ in range(450):
        first.step()
        second.step()
        apart = first.vehicle.position - second.vehicle.position
        distance = math.hypot(apart[0], apart[1])
        if distance < least:
            least, sides = distance, (first.vehicle.position[1], second.vehicle.position[1])
    needed = 0.6 + 2 * 3.0 + 0.1 * 20.0
    assert least >= needed
    assert sides[0] > 0.0 > sides[1], "each must pass on its own right"
    assert math.dist(first.vehicle.position[:2], (150.0, 0.0)) < 2.0
    assert math.dist(second.vehicle.position[:2], (-150.0, 0.0)) < 2.0


@pytest.mark.parametrize("definition", list(Definition))
def test_an_intruder_that_avoids_nobody_is_kept_out_under_every_definition(definition: Definition) -> None:
    flight = Flight(Emulated(ned_m=(-200.0, 0.0, -50.0)), config(200.0, definition=definition))
    other = intruder(200.0, 0.0, (-10.0, 0.0, 0.0))
    least = [math.inf]

    def fly_on(now_s: float) -> bytes:
        least[0] = min(least[0], math.dist(other.position[:2], flight.vehicle.position[:2]))
        data = other.remote_id(now_s, extended=False, horizontal_accuracy=11)
        other.advance(STEP_S)
        return data

    flight.others.append(fly_on)
    flight.step(650)
    # Nothing but the standard is sent: no airframe, and an error only as a code. 40 m are assumed where it counts.
    needed = {"snmac": 15.0, "odid-accuracy": 0.6 + 6.0}.get(definition, 40.0)
    assert least[0] >= needed
    assert math.dist(flight.vehicle.position[:2], (200.0, 0.0)) < 3.0


@pytest.mark.parametrize(("convention", "coded_m"), [("letter", 12.256), ("one-sigma", 30.0), ("as-is", 10.0)])
def test_what_an_accuracy_code_is_taken_for_is_configured_and_counts_for_both(convention: str, coded_m: float) -> None:
    """A 10 m code: 12.26 m by the letter, 30 m where an autopilot filled in one sigma, 10 m as three sigma. Own 10.5 m
    have that code, too, and are what the neighbour takes them for."""
    settings = config(definition=Definition.ODID_ACCURACY, accuracy_convention=AccuracyConvention(convention))
    flight = Flight(Emulated(error_m=10.5), settings)
    flight.others = [lambda now_s: intruder(90.0, 90.0, (0.0,) * 3).remote_id(now_s, horizontal_accuracy=10)]
    margin_m = flight.step().decision.nearest_margin_m
    assert margin_m == pytest.approx(math.hypot(90.0, 90.0) - (7.5 + 2.0 * coded_m), abs=0.1)


@pytest.mark.parametrize(("up_m", "spoilt", "passes"), [(40.0, {}, True), (40.0, {"speed_vertical_mps": None}, False),
                                                        (10.0, {}, False)])  # fmt: skip
def test_f19_an_intruder_far_above_is_flown_under_if_its_height_is_known(
    up_m: float, spoilt: dict[str, Any], passes: bool
) -> None:
    other = intruder(200.0, 0.0, (-5.0, 0.0, 0.0))
    other.position[2] -= up_m
    flight = Flight(settings=config(200.0))
    flight.others = [lambda now_s: other.remote_id(now_s, **spoilt)]
    aside = 0.0
    for _ in range(250):
        flight.step()
        other.advance(STEP_S)
        aside = max(aside, abs(float(flight.vehicle.position[1])))
    assert (aside < 0.5) == passes


class Pair:
    """Two engines that fly at each other along one line."""

    def __init__(self, **options: Any) -> None:
        self.vehicles = [Emulated(k + 1, ned_m=(150.0 * (2 * k - 1), 0.0, -50.0), error_m=10.5) for k in (0, 1)]
        self.engines = [Engine(config(-vehicle.position[0], **options)) for vehicle in self.vehicles]
        self.heights: list[list[float]] = []
        self.worst_m = math.inf
        """Least horizontal distance while neither was known to be above the other."""
        self.commands: list[Any] = []

    def fly(self, steps: int, spoilt: dict[str, Any] | None = None) -> None:
        """Some steps; who tells nothing but its place and speed is spoilt in both reports."""
        for k in range(steps):
            now_s = k * STEP_S
            reports = [vehicle.remote_id(now_s, **(spoilt or {})) for vehicle in self.vehicles]
            for vehicle, engine, report in zip(self.vehicles, self.engines, reversed(reports), strict=True):
                engine.receive_vehicle(vehicle.telemetry(now_s), now_s, source="autopilot")
                engine.receive_remote_id(report, now_s, source="air")
                output = engine.step(now_s)
                self.commands.append(output.decision.commanded_ned_mps)
                for frame in output.to_vehicle:
                    vehicle.hear(frame)
            for vehicle in self.vehicles:
                vehicle.advance(STEP_S)
            self.heights.append([-float(vehicle.position[2]) for vehicle in self.vehicles])
            gap = self.vehicles[0].position - self.vehicles[1].position
            if abs(gap[2]) < 6.45:  # three metres of error each, and half of 0.6 m and 0.3 m
                self.worst_m = min(self.worst_m, float(np.hypot(*gap[:2])))


def test_vertical_avoidance_leaves_the_height_of_a_conflict_and_returns_within_the_band() -> None:
    pair = Pair(vertical_avoidance=True, vertical_cost=0.1, vertical_band_m=15.0)
    pair.fly(450)
    low, high = np.min(pair.heights), np.max(pair.heights)
    assert high - low > 5.0
    assert low >= 35.0 - 0.3 and high <= 65.0 + 0.3
    assert pair.heights[-1] == pytest.approx([50.0, 50.0], abs=0.5)
    assert pair.worst_m > 0.6 + 2 * 10.5 + 2.0


def test_vertical_avoidance_is_off_unless_asked_for_and_stays_level_where_heights_are_unknown() -> None:
    plain, unknown = Pair(), Pair(vertical_avoidance=True, vertical_cost=0.1)
    plain.fly(300)
    unknown.fly(300, spoilt={"speed_vertical_mps": None})
    for pair in (plain, unknown):
        assert np.ptp(pair.heights) < 0.1
    # Without a cylinder to leave the plane decides as it does alone.
    one, other = ([command[:2] for command in pair.commands] for pair in (unknown, plain))
    assert np.array(one) == pytest.approx(np.array(other), abs=1e-3)


def test_f18_beyond_85_degrees_nothing_is_flown() -> None:
    with pytest.raises(ConfigError, match="latitude"):
        EngineConfig(goal=Goal(85.5, 0.0))
    flight = Flight(settings=EngineConfig(goal=Goal(84.9999, 8.5456)))
    place = flight.vehicle.encoder.encode("GLOBAL_POSITION_INT", lat=851_000_000, lon=85_456_000, alt=550_000)
    for _ in range(10):
        flight.engine.receive_vehicle(flight.vehicle.heartbeat() + place, flight.now_s)
        assert flight.engine.step(flight.now_s).decision.state is State.STANDBY
        flight.now_s += STEP_S


def test_f18_across_the_antimeridian_the_goal_and_the_traffic_are_near() -> None:
    flight = Flight(settings=EngineConfig(goal=Goal(10.0, -179.999)))
    flight.telling = False
    autopilot, other = Encoder(1, 1), Emulated(9)
    for tick in range(20):
        now_s = tick * STEP_S
        place = {"lat": 100_000_000, "lon": 1_799_990_000, "alt": 550_000}
        own = autopilot.encode("GPS_RAW_INT", fix_type=3, h_acc=1000, **place)
        own += autopilot.encode("GLOBAL_POSITION_INT", time_boot_ms=tick * 100, **place)
        flight.engine.receive_vehicle(flight.vehicle.heartbeat() + own, now_s, source="autopilot")
        traffic = other.remote_id(now_s, latitude_deg=10.0, longitude_deg=-179.9995, altitude_geodetic_m=None)
        flight.engine.receive_remote_id(traffic, now_s, source="air")
        flight.step()
    record = flight.outputs[-1].decision
    assert record.goal_distance_m == pytest.approx(219.2, abs=0.5)  # two thousandths of a degree
    assert record.nearest_margin_m == pytest.approx(164.4 - 6.6, abs=1.0)
    assert flight.vehicle.observer.setpoints[-1].vy > 2.0


def square(north_m: float, half_m: float) -> tuple[tuple[float, float], ...]:
    corners = ((-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m))
    return tuple(at(north_m + north, east)[:2] for north, east in corners)


@pytest.mark.parametrize("solver", list(SolverKind))
def test_a_static_obstacle_is_flown_round(solver: SolverKind) -> None:
    flight = Flight(
        settings=config(
            200.0,
            obstacles=(square(100.0, 30.0),),
            solver=solver,
            halfplane=IDEAL,
            graded=GradedSettings(response_time_s=0.0, smoothing=1.0),
            rotation=RotationSettings(smoothing=1.0),
        )
    )
    nearest = math.inf
    for _ in range(500):
        flight.step()
        north, east, _ = flight.vehicle.position
        outside = np.maximum(np.abs([north - 100.0, east]) - 30.0, 0.0)
        nearest = min(nearest, float(np.hypot(*outside)))
    assert nearest >= 0.3
    assert math.dist(flight.vehicle.position[:2], (200.0, 0.0)) < 2.0


def test_the_way_leads_out_of_a_bay_and_round_gaps_that_are_too_narrow() -> None:
    """Between the arms of a U, with the goal behind it, beside a block that leaves too little room."""
    bay = ((60.0, -60.0), (60.0, 60.0), (-40.0, 60.0), (-40.0, 50.0), (50.0, 50.0), (50.0, -60.0))
    block = ((-40.0, 65.0), (60.0, 65.0), (60.0, 100.0), (-40.0, 100.0))
    polygons = tuple(tuple(at(north, east)[:2] for north, east in polygon) for polygon in (bay, block))
    flight = Flight(settings=config(200.0, obstacles=polygons, halfplane=IDEAL))
    ring, nearest = np.array(bay), math.inf
    for _ in range(900):
        flight.step()
        here = np.array(flight.vehicle.position[:2])
        edge = np.roll(ring, -1, axis=0) - ring
        along = np.clip(((here - ring) * edge).sum(axis=1) / (edge**2).sum(axis=1), 0.0, 1.0)
        nearest = min(nearest, float(np.linalg.norm(ring + along[:, None] * edge - here, axis=1).min()))
    assert nearest >= 0.3
    assert math.dist(flight.vehicle.position[:2], (200.0, 0.0)) < 2.0


def test_static_obstacles_lie_where_they_are_wherever_we_are() -> None:
    obstacles = StaticObstacles((square(0.0, 10.0), square(2000.0, 10.0)))
    for north in (0.0, 500.0, 2000.0):
        here = Geodetic(*at(north))
        about = obstacles.about(here)
        assert about is not None
        centre = about.piece_vertex_ne_m[:4].mean(axis=0)
        assert centre == pytest.approx((-north, 0.0), abs=0.05)
    assert StaticObstacles(()).about(HOME) is None


def test_equal_input_gives_equal_output() -> None:
    def log() -> list[bytes]:
        flight = Flight(Emulated(ned_m=(-100.0, 0.0, -50.0)), config(200.0))
        other = intruder(60.0, 3.0, (-10.0, 0.0, 0.0))
        flight.others.append(lambda now_s: other.remote_id(now_s) + (other.advance(STEP_S) or b""))
        flight.step(120)
        return [frame for output in flight.outputs for frame in (*output.to_vehicle, *output.to_air)]

    assert log() == log()


def test_the_record_says_what_was_decided() -> None:
    flight = Flight()
    flight.step(30)
    record = flight.outputs[-1].decision
    assert record.status is Status.FREE
    assert record.goal_distance_m == pytest.approx(200.0 - flight.vehicle.position[0], abs=3.0)
    assert record.preferred_ned_mps is not None and record.preferred_ned_mps[0] == pytest.approx(10.0, abs=0.1)
    assert math.isinf(record.nearest_margin_m) and math.isinf(record.time_to_violation_s)
    assert flight.engine.summary().state == "engaged"
    assert flight.engine.summary().setpoints == 30
    assert flight.vehicle.mode in (OFFBOARD, GUIDED)


def test_where_nobody_gets_anywhere_the_system_id_that_drew_the_least_lot_goes_first() -> None:
    """One that avoids hovers at the goal: own-ship makes way for it where it is first in this turn of the clock."""
    distance_m = {}
    for own_sysid in (1, 3):
        flight = Flight(Emulated(own_sysid, ned_m=(-60.0, 0.0, -50.0)), config(0.0))
        flight.utc_s = clock_in(turn_of(1, 2) if own_sysid == 1 else turn_of(2, 3))
        hovering = Emulated(2, ned_m=(0.0, 0.0, -50.0))
        hovering.airframe_m = 25.0
        flight.others.append(hovering.remote_id)
        distance_m[own_sysid] = []
        for _ in range(2):
            flight.step(150)
            distance_m[own_sysid].append(math.hypot(*flight.vehicle.position[:2]))
    disc_m = (25.0 + 0.6) / 2.0 + 2.0 * 3.0
    assert disc_m < distance_m[1][1] < 1.2 * disc_m
    assert distance_m[3][0] < 1.2 * disc_m and distance_m[3][1] > 1.3 * disc_m
