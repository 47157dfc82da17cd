"""The engine in virtual time: real MAVLink bytes in both directions, no socket, no clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.avoidance.settings import GradedSettings, RotationSettings
from ridlink.avoidance.types import HalfplaneSettings, SolverKind, Status
from ridlink.engine import Engine, EngineConfig, Goal, StepOutput
from ridlink.engine.static_obstacles import StaticObstacles
from ridlink.errors import ConfigError
from ridlink.failsafe import State
from ridlink.geodesy import Geodetic
from ridlink.mavlink.codec import Encoder, Message
from ridlink.periodic import Periodic
from ridlink.remote_id.accuracy import AccuracyConvention
from ridlink.remote_id.bridge import pack_to_mavlink
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import BasicId, Location, Separation
from ridlink.separation import Definition
from ridlink.setpoint import VelocityLimits
from tests.daemon.emulated import GUIDED, HOME, LOITER, OFFBOARD, POSITION_MODE, Emulated, at
from tests.daemon.invariants import messages

STEP_S = 0.1
IDEAL = HalfplaneSettings(response_time_s=0.0, smoothing=1.0)


def config(north_m: float = 200.0, **options: Any) -> EngineConfig:
    return EngineConfig(goal=Goal(*at(north_m)), **options)


class Flight:
    """One engine and one vehicle in virtual time, with others that may be heard."""

    def __init__(self, vehicle: Emulated | None = None, settings: EngineConfig | None = None) -> None:
        self.vehicle = vehicle or Emulated()
        self.engine = Engine(settings or config())
        self.others: list[Callable[[float], bytes]] = []
        self.telling = True
        self.now_s = 0.0
        self.outputs: list[StepOutput] = []

    def step(self, count: int = 1) -> StepOutput:
        for _ in range(count):
            if self.telling:
                self.engine.receive_vehicle(self.vehicle.telemetry(self.now_s), self.now_s, source="autopilot")
            for other in self.others:
                self.engine.receive_remote_id(other(self.now_s), "air", self.now_s)
            output = self.engine.step(self.now_s)
            for frame in output.to_vehicle:
                self.vehicle.hear(frame)
            self.vehicle.advance(STEP_S)
            self.outputs.append(output)
            self.now_s += STEP_S
        return self.outputs[-1]

    def heard(self, name: str) -> list[Message]:
        return [message for message in self.vehicle.heard if message.name == name]

    def command(self, name: str, source: object = "autopilot", **fields: Any) -> int | None:
        """Result of a command to the engine; None if it is not answered."""
        sender = Encoder(255, 190)
        frame = sender.encode(name, **({"target_system": 1, "target_component": 196} | fields))
        self.engine.receive_vehicle(frame, self.now_s, source=source)
        replies = self.step().replies
        if not replies:
            return None
        ((ack, to),) = replies
        assert to == source
        (message,) = messages(ack)
        assert message.name == "COMMAND_ACK" and message.command == fields["command"]
        assert (message.target_system, message.target_component) == (255, 190)
        return int(message.result)


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


def intruder(north_m: float, east_m: float, velocity: tuple[float, float, float]) -> Emulated:
    made = Emulated(9, ned_m=(north_m, east_m, -50.0))
    made.velocity = np.array(velocity)
    return made


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


def test_what_an_accuracy_code_is_taken_for_is_configured() -> None:
    """A 10 m code: 12.26 m by the letter, 30 m where an autopilot filled in one sigma, 10 m as three sigma."""
    margins = {}
    for convention in AccuracyConvention:
        flight = Flight(settings=config(definition=Definition.ODID_ACCURACY, accuracy_convention=convention))
        flight.others = [lambda now_s: intruder(90.0, 90.0, (0.0,) * 3).remote_id(now_s, horizontal_accuracy=10)]
        margins[convention] = flight.step(5).decision.nearest_margin_m
    letter = margins[AccuracyConvention.LETTER]
    assert letter - margins[AccuracyConvention.ONE_SIGMA] == pytest.approx(30.0 - 12.256, abs=0.1)
    assert letter - margins[AccuracyConvention.AS_IS] == pytest.approx(10.0 - 12.256, abs=0.1)


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
                engine.receive_remote_id(report, "air", now_s)
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


class Stubborn(Emulated):
    """Flies on as it does, whatever it is told: its conflicts last."""

    def hear(self, data: bytes) -> list[Message]:
        found = self.observer.watch(data)
        self.heard += found
        return found


def test_conflicts_are_announced_once_a_second_and_status_tells_the_rest() -> None:
    flight = Flight(Stubborn(ned_m=(-100.0, 0.0, -50.0)), config(200.0))
    flight.vehicle.velocity = np.array((5.0, 0.0, 0.0))
    other = intruder(-20.0, 0.0, (-10.0, 0.0, 0.0))
    flight.others.append(lambda now_s: other.remote_id(now_s) + (other.advance(STEP_S) or b""))
    flight.step(60)
    collisions = flight.heard("COLLISION")
    assert 2 <= len(collisions) <= 6
    assert {message.id for message in collisions} == {9}
    assert {message.src for message in collisions} == {1}
    assert all(message.horizontal_minimum_delta < 60.0 for message in collisions)
    statuses = flight.heard("RIDLINK_STATUS")
    assert len(statuses) == 6
    assert {message.tracks for message in statuses[1:]} == {1}
    assert any(message.conflicts == 1 for message in statuses)
    assert any(message.binding_systems[0] == 9 for message in statuses)
    assert all(message.state == State.ENGAGED for message in statuses[1:])
    assert any(message.nearest_margin < 10_000 for message in statuses)


def test_relayed_traffic_in_conflict_is_named_by_a_checksum_of_its_id() -> None:
    flight = Flight(Emulated(ned_m=(-100.0, 0.0, -50.0)), config(200.0))
    other = intruder(-40.0, 0.0, (-10.0, 0.0, 0.0))
    receiver = Encoder(1, 236)

    def relay(now_s: float) -> bytes:
        other.encoder = receiver
        flight.engine.receive_vehicle(other.remote_id(now_s, id_or_mac=b"FA-07"), now_s, source="autopilot")
        return b""

    flight.others.append(relay)
    flight.step(10)
    assert len(flight.engine.picture) == 1
    assert flight.heard("COLLISION")[0].id > 255


def test_heartbeats_go_to_the_vehicle_and_to_the_air() -> None:
    flight = Flight(Emulated(7))
    flight.step(30)
    (beat, *_) = beats = flight.heard("HEARTBEAT")
    assert len(beats) == 3
    assert (beat.type, beat.autopilot) == (18, 8)
    to_air = [frame for output in flight.outputs for frame in output.to_air]
    assert len(to_air) == 3
    assert (to_air[-1][5], to_air[-1][6]) == (7, 196)


def test_before_an_autopilot_is_heard_the_air_is_left_alone() -> None:
    engine = Engine(config())
    output = engine.step(0.0)
    assert output.to_air == []
    assert [message.name for message in messages(b"".join(output.to_vehicle))] == ["HEARTBEAT"]
    pinned = Engine(config(vehicle_sysid=12))
    assert len(pinned.step(0.0).to_air) == 1


def test_messages_are_requested_from_an_ardupilot_that_sends_none() -> None:
    flight = Flight(Emulated(autopilot=3))
    flight.telling = False
    for _ in range(25):
        flight.engine.receive_vehicle(flight.vehicle.heartbeat(), flight.now_s, source="autopilot")
        flight.step()
    requests = flight.heard("COMMAND_LONG")
    assert [message.param1 for message in requests] == [33, 24, 85, 193, 245] * 3
    assert {(message.command, message.target_system, message.target_component) for message in requests} == {(511, 1, 1)}
    flight.telling = True
    flight.vehicle.heard.clear()
    flight.step(20)
    assert flight.heard("COMMAND_LONG") == []
    assert flight.engine.rung.state is State.ENGAGED


@pytest.mark.parametrize(("autopilot", "other_mode"), [(12, POSITION_MODE), (3, LOITER)])
def test_a_pilots_mode_change_ends_the_stream_and_its_return_does_not_renew_it(autopilot: int, other_mode: int) -> None:
    flight = Flight(Emulated(autopilot=autopilot))
    own_mode = flight.vehicle.mode
    flight.step(20)
    flight.vehicle.mode = other_mode
    before = len(flight.vehicle.observer.setpoints)
    flight.step(10)
    flight.vehicle.mode = own_mode
    flight.step(20)
    assert len(flight.vehicle.observer.setpoints) == before
    assert flight.engine.rung.state is State.STANDBY
    latitude, longitude, altitude = at(80.0)
    result = flight.command(
        "COMMAND_INT", command=192, frame=5, x=round(latitude * 1e7), y=round(longitude * 1e7), z=altitude
    )
    assert result == 0
    assert flight.engine.rung.state is State.ENGAGED
    assert flight.vehicle.observer.setpoints[-1].vx == 0.0
    flight.step(200)
    assert flight.vehicle.position[0] == pytest.approx(80.0, abs=1.0)


def test_px4_is_prepared_for_offboard_with_zero_velocity() -> None:
    flight = Flight()
    flight.vehicle.mode = POSITION_MODE
    flight.step(10)
    assert len(flight.vehicle.observer.setpoints) == 10
    assert {message.vx for message in flight.vehicle.observer.setpoints} == {0.0}
    flight.vehicle.armed = False
    flight.step(10)
    assert len(flight.vehicle.observer.setpoints) == 10
    waiting = Flight(Emulated(autopilot=3))
    waiting.vehicle.mode = LOITER
    waiting.step(10)
    assert waiting.vehicle.observer.setpoints == []


def test_an_automatic_take_off_is_not_disturbed() -> None:
    flight = Flight(Emulated(autopilot=3))
    flight.vehicle.landed_state = 3
    flight.step(20)
    assert flight.vehicle.observer.setpoints == []
    flight.vehicle.landed_state = 2
    assert flight.step().decision.state is State.ENGAGED


def test_f14_stale_own_state_holds_and_then_stops_on_purpose() -> None:
    flight = Flight()
    flight.step(20)
    flight.telling = False
    states = []
    for _ in range(70):
        flight.engine.receive_vehicle(flight.vehicle.heartbeat(), flight.now_s, source="autopilot")
        states.append(flight.step().decision.state)
    assert states[:9] == [State.ENGAGED] * 9
    assert set(states[11:48]) == {State.HOLD}
    assert set(states[52:]) == {State.STOPPED}
    held = flight.vehicle.observer.setpoints[32:]
    assert {(message.vx, message.vy, message.vz) for message in held} == {(0.0, 0.0, 0.0)}
    assert 65 <= len(flight.vehicle.observer.setpoints) <= 72
    flight.telling = True
    flight.step(10)
    assert flight.engine.rung.state is State.STOPPED


def test_a_lost_fix_holds_although_positions_keep_coming() -> None:
    flight = Flight()
    flight.step(20)
    flight.vehicle.fix_type = 1
    flight.step(15)
    assert flight.engine.rung.state is State.HOLD
    flight.vehicle.fix_type = 3
    flight.step(2)
    assert flight.engine.rung.state is State.ENGAGED


def test_f15_a_silent_autopilot_ends_the_engagement() -> None:
    flight = Flight()
    flight.step(20)
    flight.telling = False
    flight.step(32)
    assert flight.engine.rung.state is State.STANDBY
    flight.telling = True
    flight.step(5)
    assert flight.engine.rung.state is State.STANDBY


@pytest.mark.parametrize("paused_s", [2.0, 5.0, 12.0])
def test_f17_a_pause_of_the_loop_holds_first_and_sends_no_burst(paused_s: float) -> None:
    flight = Flight()
    flight.step(20)
    before = len(flight.vehicle.observer.setpoints)
    flight.now_s += paused_s
    flight.telling = False  # the clock wakes a stopped process before its sockets are read
    output = flight.step()
    assert output.decision.state is State.HOLD and output.decision.commanded_ned_mps == (0.0, 0.0, 0.0)
    assert len(flight.vehicle.observer.setpoints) == before + 1
    flight.telling = True
    assert flight.step().decision.state is State.ENGAGED


def test_f15_an_autopilot_that_restarts_ends_the_engagement() -> None:
    flight = Flight()
    flight.step(30)
    restarted = flight.vehicle.position_messages(0.1)
    flight.engine.receive_vehicle(restarted, flight.now_s, source="autopilot")
    flight.step()
    assert flight.engine.rung.state is State.STANDBY
    assert "restarted" in flight.engine.rung.reason


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
        flight.engine.receive_remote_id(traffic, "air", now_s)
        flight.step()
    record = flight.outputs[-1].decision
    assert record.goal_distance_m == pytest.approx(219.2, abs=0.5)  # two thousandths of a degree
    assert record.nearest_margin_m == pytest.approx(164.4 - 6.6, abs=1.0)
    assert flight.vehicle.observer.setpoints[-1].vy > 2.0


def test_f28_stop_is_three_zero_setpoints_and_only_while_streaming() -> None:
    flight = Flight()
    assert flight.engine.stop(0.0) == []
    flight.step(20)
    frames = flight.engine.stop(flight.now_s)
    assert len(frames) == 3
    for frame in frames:
        (message,) = flight.vehicle.hear(frame)
        assert (message.vx, message.vy, message.vz) == (0.0, 0.0, 0.0)
    assert flight.engine.stop(flight.now_s) == []


# --- commands -----------------------------------------------------------------------------------------------------


def reposition(**fields: Any) -> dict[str, Any]:
    latitude, longitude, altitude = at(30.0)
    given = {"command": 192, "frame": 5, "x": round(latitude * 1e7), "y": round(longitude * 1e7), "z": altitude}
    return given | fields


def test_standby_waits_for_a_goal() -> None:
    flight = Flight(settings=EngineConfig(standby=True))
    flight.step(10)
    assert flight.vehicle.observer.setpoints == []
    assert flight.command("COMMAND_INT", **reposition()) == 0
    flight.step(100)
    assert flight.vehicle.position == pytest.approx((30.0, 0.0, -50.0), abs=0.5)


def test_a_goal_given_with_standby_is_not_flown_to_unasked() -> None:
    flight = Flight(settings=config(standby=True))
    flight.step(10)
    assert flight.vehicle.observer.setpoints == []


@pytest.mark.parametrize(
    ("name", "fields", "result"),
    [
        ("COMMAND_INT", {"z": math.nan}, 0),
        ("COMMAND_INT", {"frame": 6, "z": 60.0}, 0),
        ("COMMAND_INT", {"frame": 3, "z": math.nan}, 0),
        ("COMMAND_INT", {"frame": 1}, 2),
        ("COMMAND_INT", {"x": 0, "y": 0}, 2),
        ("COMMAND_INT", {"x": 0x7FFFFFFF}, 2),
        ("COMMAND_INT", {"x": 860_000_000}, 2),
        ("COMMAND_INT", {"y": 1_900_000_000}, 2),
        ("COMMAND_INT", {"z": math.inf}, 2),
        ("COMMAND_INT", {"command": 176}, 3),
        ("COMMAND_INT", {"target_component": 1}, None),
        ("COMMAND_INT", {"target_component": 0}, None),
        ("COMMAND_INT", {"target_system": 2}, None),
        ("COMMAND_INT", {"source": "elsewhere"}, None),
    ],
)
def test_answers_to_commands(name: str, fields: dict[str, Any], result: int | None) -> None:
    flight = Flight(settings=EngineConfig(standby=True))
    flight.step()
    assert flight.command(name, **reposition(**fields)) == result
    assert flight.engine.rung.requested is (result == 0)
    if fields.get("frame") == 6:
        assert flight.engine.goal is not None
        assert flight.engine.goal.altitude_m == pytest.approx(560.0, abs=0.01)


def test_command_long_names_a_goal_too() -> None:
    flight = Flight(settings=EngineConfig(standby=True))
    flight.step()
    latitude, longitude, altitude = at(30.0)
    fields = {"command": 192, "param5": latitude, "param6": longitude, "param7": altitude}
    assert flight.command("COMMAND_LONG", **fields) == 0
    assert flight.engine.goal is not None
    assert flight.engine.goal.latitude_deg == pytest.approx(latitude, abs=1e-5)


def test_a_relative_altitude_needs_a_home() -> None:
    flight = Flight(settings=EngineConfig(standby=True))
    flight.telling = False
    flight.engine.receive_vehicle(flight.vehicle.heartbeat(), 0.0, source="autopilot")
    assert flight.command("COMMAND_INT", **reposition(frame=6, z=60.0)) == 2


def test_commands_from_the_host_of_the_autopilot_are_taken_and_answered_where_they_came_from() -> None:
    engine = Engine(EngineConfig(standby=True))
    vehicle = Emulated()
    engine.receive_vehicle(vehicle.telemetry(0.0), 0.0, source=("127.0.0.1", 14580))
    frame = Encoder(255, 190).encode("COMMAND_INT", target_system=1, target_component=196, **reposition())
    engine.receive_vehicle(frame, 0.0, source=("127.0.0.1", 40000))
    engine.receive_vehicle(frame, 0.0, source=("192.0.2.1", 40000))
    assert [address for _, address in engine.step(0.0).replies] == [("127.0.0.1", 40000)]
    assert engine.counters["foreign_command"] == 1


def test_a_flood_of_commands_is_answered_in_part() -> None:
    flight = Flight(settings=EngineConfig(standby=True))
    flight.step()
    frame = Encoder(255, 190).encode("COMMAND_INT", target_system=1, target_component=196, **reposition())
    for _ in range(10):
        flight.engine.receive_vehicle(frame * 10, flight.now_s, source="autopilot")
    assert len(flight.step().replies) == 16
    assert flight.engine.counters["command_refused"] == 84
    assert flight.command("COMMAND_INT", **reposition()) == 0


# --- Remote ID can do nothing but make tracks ---------------------------------------------------------------------


def test_i5_nothing_on_the_remote_id_link_changes_own_state_goal_or_request() -> None:
    flight = Flight(settings=EngineConfig(standby=True))
    flight.step()
    before = flight.engine.telemetry.state(0.05)
    hostile = Emulated(1, ned_m=(500.0, 0.0, -50.0))
    hostile.armed = False
    command = Encoder(255, 190).encode("COMMAND_INT", target_system=1, target_component=196, **reposition())
    flight.engine.receive_remote_id(hostile.telemetry(0.05) + command, "air", 0.05)
    assert flight.engine.telemetry.state(0.05) == before
    assert flight.engine.telemetry.armed
    assert flight.engine.goal is None and not flight.engine.rung.requested
    assert flight.engine.step(0.1).replies == []


def test_own_remote_id_on_the_own_bus_is_no_traffic_and_tells_our_identity() -> None:
    flight = Flight()
    flight.step(2)
    name, fields = to_mavlink(BasicId(1, 2, b"OWN-ID"))
    own = flight.vehicle.encoder.encode(name, **fields) + flight.vehicle.remote_id(flight.now_s)
    flight.engine.receive_vehicle(own, flight.now_s, source="autopilot")
    assert len(flight.engine.picture) == 0
    relayed = Emulated(3, ned_m=(1.0, 0.0, -50.0)).remote_id(flight.now_s, id_or_mac=b"OWN-ID")
    flight.engine.receive_remote_id(relayed, "air", flight.now_s)
    assert len(flight.engine.picture) == 0
    assert flight.engine.counters["own_echo"] >= 1


def test_own_remote_id_that_comes_before_the_first_heartbeat_is_no_neighbour() -> None:
    flight = Flight()
    own = flight.vehicle.remote_id(0.0, extended=False)
    flight.engine.receive_vehicle(own, 0.0, source="autopilot")
    flight.engine.receive_remote_id(own, "air", 0.0)
    flight.step(10)
    assert len(flight.engine.picture) == 0
    assert flight.engine.counters["heard_before_the_vehicle"] == 2


def test_another_vehicle_on_the_link_does_not_inherit_the_name_of_the_last_one() -> None:
    flight = Flight()
    flight.step(2)
    name, fields = to_mavlink(BasicId(1, 2, b"FIRST"))
    first = flight.vehicle.encoder.encode(name, **fields)
    flight.engine.receive_vehicle(first, flight.now_s, source="autopilot")
    flight.now_s += 4.0
    flight.vehicle = Emulated(2)
    flight.step(2)
    assert flight.engine.telemetry.lock is not None and flight.engine.telemetry.lock.sysid == 2
    near = Emulated(1, ned_m=(10.0, 0.0, -50.0)).remote_id(flight.now_s)
    flight.engine.receive_remote_id(first + near, "air", flight.now_s)
    assert len(flight.engine.picture) == 1, "taken for an echo of ourselves it would be flown into"


def test_a_stranger_on_the_vehicle_link_cannot_lend_us_the_identity_of_an_intruder() -> None:
    flight = Flight()
    flight.step(2)
    name, fields = to_mavlink(BasicId(1, 2, b"INTRUDER"))
    lie = flight.vehicle.encoder.encode(name, **fields)
    flight.engine.receive_vehicle(lie, flight.now_s, source="stranger")
    near = Emulated(3, ned_m=(10.0, 0.0, -50.0)).remote_id(flight.now_s, id_or_mac=b"INTRUDER")
    flight.engine.receive_remote_id(near, "air", flight.now_s)
    assert len(flight.engine.picture) == 1, "taken for an echo of ourselves it would be flown into"


def test_foreign_remote_id_forwarded_on_the_vehicle_link_is_traffic() -> None:
    flight = Flight()
    flight.step(2)
    flight.engine.receive_vehicle(Emulated(42, ned_m=(99.0, 0.0, -50.0)).remote_id(0.2), 0.2, source="autopilot")
    assert len(flight.engine.picture) == 1


def test_a_message_pack_that_a_receiver_relays_is_traffic_whole() -> None:
    flight = Flight()
    flight.step(2)
    latitude, longitude, altitude = at(99.0, up_m=50.0)
    pack = [
        BasicId(1, 2, b"OTHER"),
        Location(2, latitude_deg=latitude, longitude_deg=longitude, altitude_geodetic_m=altitude, timestamp_s=0.2),
        Separation(horizontal_error_m=4.0, airframe_size_m=0.5),
    ]
    name, fields = pack_to_mavlink(pack, id_or_mac=b"\x84\xcc\xa8\x60\x43\x24")
    fields["messages"] = fields["messages"][:75] + b"\x62" + bytes(149)
    frame = Encoder(1, 236).encode(name, **(fields | {"msg_pack_size": 4}))
    flight.engine.receive_vehicle(frame, 0.2, source="autopilot")
    (track,) = flight.engine.picture.tracks.values()
    assert track.report.uas_id == b"OTHER" and track.report.horizontal_error_m == 4.0
    assert flight.engine.counters["OPEN_DRONE_ID_MESSAGE_PACK.unknown_message_type"] == 1


def test_bad_bytes_are_counted_by_cause_and_the_good_ones_beside_them_count() -> None:
    flight = Flight()
    flight.step()
    other = Emulated(9, ned_m=(100.0, 0.0, -50.0))
    good = other.remote_id(0.0, extended=False)
    flipped = good[:20] + bytes([good[20] ^ 1]) + good[21:]
    version_1 = bytes.fromhex("fe09004301000000000002030403031b68")
    flight.engine.receive_remote_id(b"junk" + flipped + good, "air", 0.0)
    flight.engine.receive_remote_id(b"", "air", 0.0)
    flight.engine.receive_remote_id(version_1, "air", 0.0)
    counters = flight.engine.counters
    assert len(flight.engine.picture) == 1
    assert counters["garbage"] >= 1 and counters["bad_checksum"] >= 1
    assert flight.engine.summary().reports_received == 1


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(max_size=300), max_size=8), st.integers(0, 2**32 - 1))
def test_any_bytes_on_either_link_leave_a_valid_stream(datagrams: list[bytes], seed: int) -> None:
    random = np.random.default_rng(seed)
    flight = Flight()
    flight.step(2)
    whole = Emulated(9, ned_m=(60.0, 1.0, -50.0)).remote_id(0.2) + flight.vehicle.position_messages(0.2)
    for data in datagrams:
        mixed = bytearray(whole)
        for index in random.integers(0, len(mixed), 3):
            mixed[index] = int(random.integers(0, 256))
        flight.engine.receive_remote_id(data + bytes(mixed), "air", flight.now_s)
        flight.engine.receive_vehicle(data, flight.now_s, source="autopilot")
        flight.engine.receive_vehicle(bytes(mixed), flight.now_s, source="stranger")
    flight.step(3)
    assert flight.engine.rung.state is State.ENGAGED
    assert flight.engine.counters["decision_failed"] == 0


# --- failing decisions, obstacles, configuration ------------------------------------------------------------------


def test_f25_decisions_that_fail_become_zero_velocity_and_then_a_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight()
    flight.step(20)

    def broken(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("no")

    monkeypatch.setattr(flight.engine.steering.decider.solver, "solve", broken)
    assert flight.step().decision.commanded_ned_mps == (0.0, 0.0, 0.0)
    assert not flight.engine.fatal
    flight.step(2)
    assert flight.engine.fatal
    assert flight.step().decision.state is State.HOLD
    assert flight.engine.last_error == "ZeroDivisionError: no"
    assert flight.engine.counters["decision_failed"] == 3


def test_rare_failures_are_not_fatal(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight()
    flight.step(2)
    right = flight.engine.steering.decider.solver.solve
    for _ in range(4):
        monkeypatch.setattr(flight.engine.steering.decider.solver, "solve", lambda *_, **__: 1 / 0)
        flight.step()
        monkeypatch.setattr(flight.engine.steering.decider.solver, "solve", right)
        flight.step(10)
    assert flight.engine.counters["decision_failed"] == 4
    assert not flight.engine.fatal


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


def test_static_obstacles_lie_where_they_are_wherever_we_are() -> None:
    obstacles = StaticObstacles((square(0.0, 10.0), square(2000.0, 10.0)))
    for north in (0.0, 500.0, 2000.0):
        here = Geodetic(*at(north))
        about = obstacles.about(here)
        assert about is not None
        centre = about.hull_vertex_ne_m[:4].mean(axis=0)
        assert centre == pytest.approx((-north, 0.0), abs=0.05)
    assert StaticObstacles(()).about(HOME) is None


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"cruise_mps": 16.0}, "v-max"),
        ({"cruise_mps": 0.0}, "cruise"),
        ({"cruise_mps": math.nan}, "cruise"),
        ({"airframe_m": 0.0}, "airframe"),
        ({"airframe_m": math.inf}, "airframe"),
        ({"airframe_height_m": 0.0}, "airframe-height"),
        ({"vertical_band_m": 0.0}, "vertical-band"),
        ({"vertical_cost": math.nan}, "vertical-cost"),
        ({"min_height_m": 120.0}, "max-height"),
        ({"vehicle_sysid": 0}, "vehicle-sysid"),
        ({"goal": Goal(math.nan, 0.0)}, "finite"),
        ({"goal": Goal(10.0, 181.0)}, "longitude"),
        ({"goal": Goal(10.0, 8.0, 30_000.0)}, "altitude"),
        ({"uas_id": "123456789012345678901"}, "uas-id"),
        ({"uas_id": ""}, "uas-id"),
        ({"obstacles": (((47.0, 8.0), (47.1, 8.0), (47.0, 8.0)),)}, "distinct"),
        ({"obstacles": (((95.0, 8.0), (47.1, 8.0), (47.0, 8.1)),)}, "95, 8 is no latitude"),
        ({"obstacles": ((),)}, "without vertices"),
    ],
)
def test_configuration_is_refused_in_words(options: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        EngineConfig(**options)


def test_cruise_above_the_default_limit_is_possible_with_a_higher_limit() -> None:
    assert EngineConfig(cruise_mps=20.0, limits=VelocityLimits(horizontal_mps=20.0)).cruise_mps == 20.0


def neighbours_ahead(flight: Flight, sysids: tuple[int, ...], distance_m: float, north_mps: float) -> None:
    """Let others be heard from now on, from a distance ahead on both sides of the way."""
    north = float(flight.vehicle.position[0]) + distance_m
    for k, sysid in enumerate(sysids):
        other = Emulated(sysid, ned_m=(north, 10.0 * (k - 1), -50.0))
        other.velocity = np.array([north_mps, 0.0, 0.0])
        flight.others.append(lambda now_s, other=other: other.remote_id(now_s) + (other.advance(STEP_S) or b""))  # type: ignore[misc]


@pytest.mark.parametrize(("heard_from_m", "north_mps", "short"), [(30.0, 10.0, True), (400.0, -10.0, False)])
def test_an_air_that_gives_too_little_is_said_once(heard_from_m: float, north_mps: float, short: bool) -> None:
    flight = Flight(settings=config(2000.0))
    flight.step(150)
    before = flight.outputs[-1].decision.detection
    assert before is not None and before.given_m is None and before.needed_m > 350.0  # whoever says nothing of itself
    neighbours_ahead(flight, (5, 6, 7), heard_from_m, north_mps)
    flight.step(200)
    detection = flight.outputs[-1].decision.detection
    assert detection is not None and detection.given_m is not None
    assert (detection.given_m < detection.needed_m) == detection.short == short
    texts = [text for output in flight.outputs for text in output.warnings]
    assert [message.text.rstrip(b"\0").decode() for message in flight.heard("STATUSTEXT")] == texts
    assert len(texts) == short


@pytest.mark.parametrize(("distance_m", "north_mps"), [(1e7, 0.0), (2000.0, -50.0), (800.0, 0.0)])
def test_ghosts_that_are_told_of_from_far_away_do_not_silence_that_others_are_heard_late(
    distance_m: float, north_mps: float
) -> None:
    flight = Flight(settings=config(2000.0))
    flight.step(150)
    for first in range(20, 29, 3):
        neighbours_ahead(flight, (first, first + 1, first + 2), distance_m, north_mps)
    flight.step(20)
    neighbours_ahead(flight, (5, 6, 7), 30.0, 10.0)
    flight.step(20)
    detection = flight.outputs[-1].decision.detection
    assert detection is not None and detection.short and detection.given_m is not None and detection.given_m < 100.0


def test_periodic_keeps_its_grid_and_makes_up_for_nothing() -> None:
    every = Periodic(1.0)
    due = [t / 10 for t in range(50) if every.due(t / 10)]
    assert due == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert every.due(20.3) and not every.due(20.4) and every.due(21.3)


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


def test_where_nobody_gets_anywhere_the_lesser_system_id_goes_first() -> None:
    """One that avoids hovers at the goal: whoever is the greater of the two makes way, for a while."""
    distance_m = {}
    for own_sysid in (1, 3):
        flight = Flight(Emulated(own_sysid, ned_m=(-60.0, 0.0, -50.0)), config(0.0))
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
