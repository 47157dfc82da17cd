"""An autopilot and the air, looked at over loopback; the vehicle here speaks through pymavlink."""

from __future__ import annotations

import asyncio
import math
import os
import struct
from collections.abc import Iterable
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common

from ridlink.doctor import Finding, Verdict, examine_air, examine_vehicle
from ridlink.doctor.parameters import parameter_value
from ridlink.links import Address, Link, open_link, parse_link_url
from ridlink.mavlink.codec import Encoder
from ridlink.own_ship import ARDUPILOT, PX4
from tests.links.cable import plugged

INT32, REAL32 = 6, 9
ARDUPILOTS = ("GUID_TIMEOUT", "GUID_OPTIONS", "WPNAV_SPEED", "AVOID_ENABLE")
LISTEN_S = 5.0


def px4_integer(value: int) -> float:
    return struct.unpack("<f", struct.pack("<i", value))[0]  # type: ignore[no-any-return]


class Vehicle:
    """Answers as PX4 or ArduPilot does when asked for a parameter."""

    link: Link

    def __init__(self, autopilot: int, parameters: dict[str, tuple[float, int]]) -> None:
        self.autopilot = autopilot
        self.parameters = parameters
        self.asked: list[str] = []
        self.speaks_1 = False
        self._mavlink = common.MAVLink(None, srcSystem=7, srcComponent=1)

    def receive(self, data: bytes, address: Address) -> None:
        for message in self._mavlink.parse_buffer(data) or ():
            if message.get_type() == "HEARTBEAT":
                self._send(common.MAVLink_heartbeat_message(2, self.autopilot, 0, 0, 4, 3), address)
                self._send(common.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 0, 0, 0, 0, 12, h_acc=900), address)
                self._send(common.MAVLink_global_position_int_message(0, 1, 1, 0, 0, 0, 0, 0, 0), address)
            elif message.get_type() == "PARAM_REQUEST_READ":
                assert (message.target_system, message.target_component) == (7, 1)
                self.asked.append(message.param_id)
                if message.param_id in self.parameters:
                    value, kind = self.parameters[message.param_id]
                    name = message.param_id.encode()
                    self._send(common.MAVLink_param_value_message(name, value, kind, 1, 0), address)

    def _send(self, message: common.MAVLink_message, address: Address) -> None:
        self.link.send(message.pack(self._mavlink, force_mavlink1=self.speaks_1), address)


def examined(vehicle: Vehicle, for_s: float = LISTEN_S) -> dict[str, Finding]:
    async def run() -> Iterable[Finding]:
        vehicle.link = await open_link("udpin:127.0.0.1:0", vehicle.receive)
        try:
            return await examine_vehicle(
                parse_link_url(f"udpout:127.0.0.1:{vehicle.link.local_address[1]}"), for_s=for_s
            )
        finally:
            vehicle.link.close()

    return {finding.name: finding for finding in asyncio.run(run())}


def test_px4_whose_offboard_would_return_home_is_warned_of() -> None:
    found = examined(
        Vehicle(
            PX4,
            {
                "COM_OF_LOSS_T": (1.0, REAL32),
                "COM_OBL_RC_ACT": (px4_integer(0), INT32),
                "MPC_XY_VEL_MAX": (12.0, REAL32),
                "MPC_Z_VEL_MAX_DN": (1.5, REAL32),
            },
        )
    )
    assert found["autopilot"].text == "PX4, system id 7"
    assert found["GNSS"].verdict is Verdict.OK and "h_acc 0.9 m" in found["GNSS"].text
    assert found["own position"].verdict is Verdict.OK
    assert found["COM_OF_LOSS_T"].verdict is Verdict.OK
    assert found["COM_OF_LOSS_T"].text == "1 s without a setpoint until OFFBOARD fails over"
    assert found["COM_OBL_RC_ACT"].text.startswith("0 (what OFFBOARD fails over to: ")
    assert found["COM_OBL_RC_ACT"].verdict is Verdict.WARNING and "5 (hold)" in found["COM_OBL_RC_ACT"].remedy


def test_ardupilot_that_flies_blind_for_long_is_warned_of() -> None:
    found = examined(
        Vehicle(
            ARDUPILOT,
            {
                "GUID_TIMEOUT": (30.0, REAL32),
                "GUID_OPTIONS": (0.0, INT32),
                "WPNAV_SPEED": (1000.0, REAL32),
                "AVOID_ENABLE": (3.0, INT32),
            },
        )
    )
    assert found["GUID_TIMEOUT"].verdict is Verdict.WARNING
    assert {found[name].verdict for name in ARDUPILOTS[1:]} == {Verdict.OK}


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_parameter_that_is_no_number_is_warned_of(value: float) -> None:
    found = examined(Vehicle(ARDUPILOT, dict.fromkeys(ARDUPILOTS, (value, REAL32))))
    assert {found[name].verdict for name in ARDUPILOTS} == {Verdict.WARNING}


def test_a_vehicle_that_keeps_to_mavlink_1_is_warned_of_because_the_daemon_does_not_take_it() -> None:
    vehicle = Vehicle(ARDUPILOT, {})
    vehicle.speaks_1 = True
    found = examined(vehicle, for_s=1.0)["MAVLink"]
    assert found.verdict is Verdict.WARNING and "version 1" in found.text and "--allow-v1" in found.remedy
    assert "MAVLink" not in examined(Vehicle(ARDUPILOT, {}), for_s=1.0)


def test_a_parameter_that_is_never_answered_is_said_so() -> None:
    vehicle = Vehicle(ARDUPILOT, {})
    found = examined(vehicle, for_s=1.0)
    assert vehicle.asked.count("GUID_TIMEOUT") > 1, "a datagram may be lost: it asks again"
    assert found["GUID_TIMEOUT"].text == "not answered"


def test_nobody_at_the_end_of_the_link_is_a_failure() -> None:
    found = asyncio.run(examine_vehicle(parse_link_url("udpin:127.0.0.1:0"), for_s=0.1))
    assert [(finding.name, finding.verdict) for finding in found] == [("autopilot", Verdict.FAILURE)]
    assert "within 0.1 s" in found[0].text and found[0].remedy


def test_a_serial_device_at_the_wrong_rate_is_told_by_its_noise(tmp_path: Path) -> None:
    async def run() -> list[Finding]:
        with plugged(tmp_path / "ttyUSB0") as device:
            held = os.open(device.name, os.O_RDWR | os.O_NOCTTY)
            examining = asyncio.create_task(examine_vehicle(parse_link_url(f"serial:{device.name}:57600"), for_s=0.5))
            assert await device.count(1)  # its HEARTBEAT: it listens
            os.write(device.end, b"\xfd" + 279 * b"\x55")
            found = await examining
            os.close(held)
            return found

    (finding,) = asyncio.run(run())
    assert "2 damaged" in finding.text, "what would be a frame, and the rest of it"
    assert "MAVLink at 57600 baud" in finding.remedy


def test_the_neighbours_on_the_air_are_counted() -> None:
    async def run() -> list[Finding]:
        air: Link

        def answer(data: bytes, address: Address) -> None:
            for sysid in (1, 2, 3):
                encoder = Encoder(sysid, 1)
                air.send(encoder.encode("OPEN_DRONE_ID_LOCATION", latitude=1, longitude=1), address)
            air.send(encoder.encode("RIDLINK_SEPARATION"), address)

        air = await open_link("udpin:127.0.0.1:0", answer)
        try:
            return await examine_air(parse_link_url(f"udpout:127.0.0.1:{air.local_address[1]}"), for_s=0.4)
        finally:
            air.close()

    [finding] = asyncio.run(run())
    assert finding.verdict is Verdict.OK
    assert finding.text.startswith("3 senders") and finding.text.endswith("1 with RIDLINK_SEPARATION")


def test_an_empty_air_is_a_warning() -> None:
    [finding] = asyncio.run(examine_air(parse_link_url("udpin:127.0.0.1:0"), for_s=0.1))
    assert finding.verdict is Verdict.WARNING and finding.remedy


@pytest.mark.parametrize(
    ("raw", "kind", "autopilot", "value"),
    [
        (px4_integer(-5), INT32, PX4, -5.0),
        (px4_integer(3), 5, PX4, 3.0),
        (2.5, REAL32, PX4, 2.5),
        (3.0, INT32, ARDUPILOT, 3.0),
    ],
)
def test_integers_of_px4_are_bytes_and_those_of_ardupilot_numbers(
    raw: float, kind: int, autopilot: int, value: float
) -> None:
    assert parameter_value(raw, kind, autopilot) == value
