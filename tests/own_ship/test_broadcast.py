"""The own Remote ID, made of what an autopilot reports: never more certain than it can be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.engine import Engine, EngineConfig, Goal
from ridlink.engine.intake import VEHICLE_IDS, Intake
from ridlink.errors import ConfigError
from ridlink.mavlink.codec import Encoder, Message
from ridlink.own_ship import OwnShipTelemetry
from ridlink.own_ship.broadcast import Broadcast, BroadcastSettings, Form
from ridlink.own_ship.telemetry import MULTIROTORS
from ridlink.remote_id.assembler import ReportAssembler
from ridlink.remote_id.bridge import messages_of
from ridlink.remote_id.messages import BasicId, Location, Separation, System
from ridlink.remote_id.report import RemoteIdReport
from ridlink.separation.reference import UNKNOWN_ERROR_BOUND_M
from tests.daemon.emulated import GEOID_M, HOME, Emulated, at
from tests.daemon.invariants import messages

UTC_S = 1_700_000_000.25
STATIC = {"OPEN_DRONE_ID_BASIC_ID", "OPEN_DRONE_ID_SYSTEM"}


class Aircraft:
    """A vehicle, its telemetry as it is heard, and its transmitter."""

    def __init__(self, vehicle: Emulated | None = None, **settings: Any) -> None:
        self.vehicle = vehicle or Emulated(7)
        self.telemetry = OwnShipTelemetry()
        self.broadcast = Broadcast(BroadcastSettings(**({"airframe_m": 0.8, "airframe_height_m": 0.3} | settings)))
        self.encoder = Encoder(7, 196)
        self.intake = Intake()

    def hear(self, data: bytes, now_s: float) -> None:
        for frame, message in self.intake.messages(data, VEHICLE_IDS):
            self.telemetry.receive(frame.sysid, frame.compid, message, now_s, "autopilot")

    def say(self, now_s: float, **facts: Any) -> list[Message]:
        said = self.broadcast.datagrams(
            self.encoder, self.telemetry, now_s=now_s, utc_s=facts.pop("utc_s", UTC_S + now_s), **facts
        )
        return [message for datagram in said for message in messages(datagram)]

    def report(self, now_s: float, **facts: Any) -> RemoteIdReport:
        """What a receiver makes of it."""
        assembler, found = ReportAssembler(), None
        for message in self.say(now_s, **facts):
            for part in messages_of(message):
                found = assembler.receive((7, 196), part, now_s) or found
        assert found is not None
        return found


def test_location_and_separation_go_in_step_and_static_messages_every_three_seconds() -> None:
    aircraft = Aircraft()
    names: list[list[str]] = []
    for k in range(61):
        aircraft.hear(aircraft.vehicle.telemetry(0.1 * k), 0.1 * k)
        said = aircraft.say(0.1 * k)
        names.append([message.name for message in said])
        location, separation = said[:2]
        assert location.timestamp == separation.timestamp == pytest.approx((UTC_S + 0.1 * k) % 3600.0, abs=1e-3)
        assert separation.update_interval == 100
    assert all(each[:2] == ["OPEN_DRONE_ID_LOCATION", "RIDLINK_SEPARATION"] for each in names)
    assert [k for k, each in enumerate(names) if set(each) >= STATIC] == [0, 30, 60]


def test_steps_that_come_a_little_late_now_and_then_leave_out_no_location() -> None:
    """The steps of a loop come on a grid, each so late as the machine wakes it: more than the one before, or less."""
    aircraft = Aircraft()
    late_s = np.random.default_rng(1).exponential(0.004, 600)
    said = 0
    for k, late in enumerate(np.minimum(late_s, 0.04)):
        now_s = 0.1 * k + float(late)
        aircraft.hear(aircraft.vehicle.telemetry(now_s), now_s)
        said += "OPEN_DRONE_ID_LOCATION" in {message.name for message in aircraft.say(now_s)}
    assert said == 600


def test_static_messages_go_at_their_own_time() -> None:
    aircraft = Aircraft()
    aircraft.hear(aircraft.vehicle.telemetry(0.0), 0.0)
    aircraft.say(0.0)
    aircraft.say(2.98)
    assert {message.name for message in aircraft.say(3.0)} == STATIC, "LOCATION is not due again before 3.03 s"


def test_what_is_said_is_what_the_autopilot_says() -> None:
    vehicle = Emulated(7, ned_m=(30.0, -20.0, -60.0), error_m=2.4)
    vehicle.velocity = np.array([3.0, 4.0, -1.0])
    aircraft = Aircraft(vehicle)
    aircraft.hear(vehicle.telemetry(0.0), 0.0)
    report = aircraft.report(0.0, commanded=(1.0, -2.0, 0.5), avoiding=True)
    latitude, longitude, altitude = at(30.0, -20.0, 60.0)
    assert (report.latitude_deg, report.longitude_deg) == pytest.approx((latitude, longitude), abs=2e-7)
    assert report.altitude_geodetic_m == pytest.approx(altitude + GEOID_M, abs=0.01)
    assert report.height_m == pytest.approx(60.0, abs=0.01)
    assert report.velocity_ned_mps == pytest.approx((3.0, 4.0, -1.0), abs=0.02)
    assert report.commanded_ned_mps == (1.0, -2.0, 0.5)
    assert report.avoiding and report.status == 2
    assert report.horizontal_error_m == pytest.approx(2.4, abs=0.011)
    assert report.accuracy_bound_m is not None and report.accuracy_bound_m >= 2.4
    assert report.vertical_error_m == 3.0  # v_acc 1000 mm
    assert (report.airframe_size_m, report.airframe_height_m) == (0.8, 0.3)


@given(
    h_acc_mm=st.integers(0, 2**32 - 1),
    estimator_m=st.floats(0.0, 1e4, width=32),
    fix_type=st.integers(0, 8),
    flags=st.integers(0, 2047),
    age_s=st.floats(0.0, 9.9),
    speed_mps=st.floats(0.0, 30.0),
)
def test_an_error_is_never_understated(
    h_acc_mm: int, estimator_m: float, fix_type: int, flags: int, age_s: float, speed_mps: float
) -> None:
    aircraft = Aircraft()
    vehicle, encode = aircraft.vehicle, aircraft.vehicle.encoder.encode
    vehicle.velocity = np.array([speed_mps, 0.0, 0.0])
    aircraft.hear(vehicle.telemetry(0.0), 0.0)  # a position is known before anything goes wrong
    place = {"lat": round(HOME.latitude_deg * 1e7), "lon": round(HOME.longitude_deg * 1e7), "alt": 550_000}
    aircraft.hear(encode("GPS_RAW_INT", fix_type=fix_type, h_acc=h_acc_mm, **place), 0.0)
    aircraft.hear(encode("ESTIMATOR_STATUS", flags=flags, pos_horiz_accuracy=estimator_m), 0.0)
    separation = next(m for m in aircraft.say(age_s) if m.name == "RIDLINK_SEPARATION")
    believed_m = separation.horizontal_error / 100.0 if separation.horizontal_error else UNKNOWN_ERROR_BOUND_M
    trusted = fix_type >= 3 and flags & 16
    fresh = age_s <= 5.0
    least = 3.0 * max(h_acc_mm / 1e3 if h_acc_mm != 2**32 - 1 else 0.0, estimator_m if fresh else 0.0)
    if not trusted and fresh:
        least = max(least, UNKNOWN_ERROR_BOUND_M)
    if fresh:
        assert believed_m >= min(least, 185.0) - 0.011
    assert believed_m >= min(speed_mps * age_s if age_s > 0.3 else 0.0, 185.0)
    if least >= 185.0 and fresh:
        assert separation.horizontal_error == 65535


def test_a_silent_receiver_is_the_worst_case_of_an_unknown_error() -> None:
    aircraft = Aircraft()
    for k in range(61):
        now_s = 0.1 * k
        telemetry = aircraft.vehicle.telemetry(now_s)
        if k:  # positions go on, the receiver says no more
            telemetry = b"".join(f.raw for f, m in aircraft.intake.messages(telemetry, VEHICLE_IDS) if m.msgid != 24)
        aircraft.hear(telemetry, now_s)
        report = aircraft.report(now_s)
    assert report.horizontal_error_m == UNKNOWN_ERROR_BOUND_M
    assert report.vertical_error_m is None


@pytest.mark.parametrize("autopilot", [3, 12])
def test_after_the_loss_of_the_fix_the_accuracy_figure_is_not_believed(autopilot: int) -> None:
    aircraft = Aircraft(Emulated(7, autopilot=autopilot, error_m=0.9))
    aircraft.vehicle.velocity = np.array([5.0, 0.0, 0.0])
    aircraft.hear(aircraft.vehicle.telemetry(0.0), 0.0)
    aircraft.vehicle.fix_type = 1  # ArduPilot goes on telling 300 mm
    errors: list[float | None] = []
    statuses: list[int] = []
    for k in range(1, 121):
        aircraft.hear(aircraft.vehicle.telemetry(0.1 * k), 0.1 * k)
        report = aircraft.report(0.1 * k)
        errors.append(report.horizontal_error_m)
        statuses.append(report.status)
        assert not report.extended or report.horizontal_error_m != 0.9
    assert errors[0] == UNKNOWN_ERROR_BOUND_M
    assert errors[50] is not None and errors[50] > 60.0
    assert statuses[-1] == 4 and report.latitude_deg is None  # after ten seconds nobody knows where it is
    assert errors[-1] is None


def test_standing_on_the_ground_is_said_only_where_it_is_known() -> None:
    def status(armed: bool, landed: int | None, now_s: float = 0.0) -> int:
        vehicle = Emulated(7)
        vehicle.armed, vehicle.landed_state = armed, landed
        aircraft = Aircraft(vehicle)
        aircraft.hear(vehicle.telemetry(0.0), 0.0)
        return aircraft.report(now_s).status

    assert status(armed=False, landed=None) == 1
    assert status(armed=True, landed=None) == 2
    assert status(armed=True, landed=1) == 1
    assert [status(armed=True, landed=landed) for landed in (2, 3, 4)] == [2, 2, 2]
    assert status(armed=True, landed=1, now_s=4.0) == 0  # not heard for so long: undeclared


@pytest.mark.parametrize(("armed", "status"), [(True, 2), (False, 1)])
def test_who_told_long_ago_that_it_stands_may_fly(armed: bool, status: int) -> None:
    """An autopilot that has restarted sends what was asked of it no more, but what a ground station asks anew."""
    vehicle = Emulated(7)
    vehicle.landed_state = 1
    aircraft = Aircraft(vehicle)
    aircraft.hear(vehicle.telemetry(0.0), 0.0)
    assert aircraft.report(0.0).status == 1
    vehicle.landed_state, vehicle.armed = None, armed
    aircraft.hear(vehicle.telemetry(5.1), 5.1)
    assert aircraft.report(5.1).status == status, "what stands on the ground is no traffic to others"


@pytest.mark.parametrize("mav_type", sorted(MULTIROTORS - {0}))
def test_whoever_is_flown_as_a_multirotor_is_declared_as_one(mav_type: int) -> None:
    vehicle = Emulated(7)
    vehicle.mav_type = mav_type
    aircraft = Aircraft(vehicle)
    aircraft.hear(vehicle.telemetry(0.0), 0.0)
    (basic,) = (m for m in aircraft.say(0.0) if m.name == "OPEN_DRONE_ID_BASIC_ID")
    assert basic.ua_type == 2


def test_identity_type_and_place_of_take_off() -> None:
    aircraft = Aircraft()
    aircraft.hear(aircraft.vehicle.telemetry(0.0), 0.0)
    basic, system = (m for m in aircraft.say(0.0) if m.name in STATIC)
    assert messages_of(basic) == [BasicId(0, 2, b"")]  # nobody's, and says so
    assert (system.operator_latitude, system.operator_longitude) == (0, 0)
    home = {"latitude": 473_977_000, "longitude": 85_456_000, "altitude": 500_000}
    aircraft.hear(aircraft.vehicle.encoder.encode("HOME_POSITION", **home), 3.0)
    aircraft.hear(aircraft.vehicle.telemetry(3.0), 3.0)
    basic, system = (m for m in aircraft.say(3.0, uas_id=b"SERIAL-1") if m.name in STATIC)
    assert messages_of(basic) == [BasicId(1, 2, b"SERIAL-1")]
    configured = Aircraft(uas_id=b"SERIAL-2")
    configured.hear(configured.vehicle.telemetry(0.0), 0.0)
    first, _ = (m for m in configured.say(0.0, uas_id=b"REGISTRATION", id_type=2) if m.name in STATIC)
    assert messages_of(first) == [BasicId(1, 2, b"SERIAL-2")]
    (read,) = messages_of(system)
    assert isinstance(read, System)
    assert read.operator_latitude_deg == pytest.approx(47.3977)
    assert read.operator_altitude_geo_m == pytest.approx(500.0 + GEOID_M)
    assert read.timestamp_s == pytest.approx(UTC_S + 3.0 - 1546300800.0, abs=1.0)


def test_a_module_gets_every_message_that_it_waits_for_and_our_extension_as_authentication() -> None:
    aircraft = Aircraft(form=Form.MODULE, operator_id=b"OP-1")
    seconds: list[set[str]] = []
    for k in range(21):
        aircraft.hear(aircraft.vehicle.telemetry(0.1 * k), 0.1 * k)
        said = aircraft.say(0.1 * k)
        seconds.append({message.name.removeprefix("OPEN_DRONE_ID_") for message in said})
        location, separation = (messages_of(message)[0] for message in said[:2])
        assert isinstance(location, Location) and isinstance(separation, Separation)
        assert separation.horizontal_error_m == pytest.approx(3.0)
        assert separation.timestamp_s == math.floor((UTC_S + 0.1 * k) % 3600.0)
    whole = {"LOCATION", "AUTHENTICATION", "BASIC_ID", "SYSTEM", "OPERATOR_ID", "SELF_ID"}
    assert [k for k, names in enumerate(seconds) if names == whole] == [0, 10, 20]


def test_relayed_it_bears_the_address_of_the_transmitter() -> None:
    aircraft = Aircraft(relayed_as=b"\x02RID\x00\x01")
    aircraft.hear(aircraft.vehicle.telemetry(0.0), 0.0)
    said = aircraft.say(0.0)
    assert len(said) == 4 and all(m.id_or_mac == b"\x02RID\x00\x01".ljust(20, b"\x00") for m in said)
    assert aircraft.report(0.1).id_or_mac == b"\x02RID\x00\x01".ljust(20, b"\x00")


def test_nothing_is_said_before_it_is_known_whose_it_is_and_no_time_that_is_not_known() -> None:
    aircraft = Aircraft()
    assert aircraft.say(0.0) == []
    aircraft.hear(aircraft.vehicle.telemetry(0.1), 0.1)
    assert aircraft.report(0.1, utc_s=None).timestamp_s is None


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"airframe_m": 0.0}, "airframe must lie between"),
        ({"airframe_m": 30.1}, "airframe must lie between"),
        ({"airframe_height_m": math.nan}, "airframe-height must lie between 0.01 and 30 m"),
        ({"uas_id": b"x" * 21}, "uas-id must have at most 20 bytes"),
        ({"uas_id": b""}, "uas-id must have at least one byte"),
        ({"operator_id": b"x" * 21}, "operator-id"),
        ({"relayed_as": bytes(6)}, "relay-as"),
    ],
)
def test_what_cannot_be_said_is_refused(wrong: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        BroadcastSettings(**({"airframe_m": 0.8, "airframe_height_m": 0.3} | wrong))


@pytest.mark.no_cover
@pytest.mark.parametrize("east_m", [0.0, 150.0])
def test_two_vehicles_that_hear_only_each_others_daemons_keep_clear(east_m: float) -> None:
    """Head-on, and crossing: `--broadcast` on both, and no transmitter but that."""
    starts = [(-150.0, 0.0, -50.0), (0.0, east_m, -50.0) if east_m else (150.0, 0.0, -50.0)]
    goals = [at(150.0), at(0.0, -east_m) if east_m else at(-150.0)]
    vehicles = [Emulated(k + 1, ned_m=start) for k, start in enumerate(starts)]
    engines = [Engine(EngineConfig(goal=Goal(*goal), broadcast=True)) for goal in goals]
    on_air: list[list[bytes]] = [[], []]
    nearest_m, halves = math.inf, 0
    for k in range(600):
        now_s = 0.1 * k
        for me, (vehicle, engine) in enumerate(zip(vehicles, engines, strict=True)):
            engine.receive_vehicle(vehicle.telemetry(now_s), now_s, source="autopilot")
            for datagram in on_air[1 - me]:
                engine.receive_remote_id(datagram, now_s, source="air", utc_s=UTC_S + now_s)
        for me, (vehicle, engine) in enumerate(zip(vehicles, engines, strict=True)):
            output = engine.step(now_s, utc_s=UTC_S + now_s)
            on_air[me] = output.broadcasts
            for frame in output.to_vehicle:
                if not any(m.name == "COMMAND_LONG" for m in messages(frame)):
                    vehicle.hear(frame)
            vehicle.advance(0.1)
            halves += sum(track.report.avoiding for track in engine.picture.tracks.values())
        nearest_m = min(nearest_m, float(np.linalg.norm(vehicles[0].position - vehicles[1].position)))
    assert nearest_m > 6.0  # two discs of three metres of error, and more: a MAC is 0.6 m
    assert halves > 500
    for vehicle, goal in zip(vehicles, goals, strict=True):
        assert vehicle._place()[:2] == pytest.approx(goal[:2], abs=5e-5)
