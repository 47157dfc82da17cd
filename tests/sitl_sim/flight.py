"""One emulated vehicle and one client in virtual time: bytes go to and fro, no socket is opened."""

from __future__ import annotations

import math
from typing import Any

import pytest

from ridlink.geodesy import Geodetic
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, Message, decode_message, decode_payload
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.scenario import Scenario, VehicleSpec
from sitl_sim.autopilot import Autopilot, FleetNavigation, Start
from sitl_sim.autopilot.ekf_status import EKF_STATUS_REPORT
from sitl_sim.vehicle import TICK_S
from sitl_sim.world import World

SENT = {**CRC_EXTRAS, EKF_STATUS_REPORT.msgid: EKF_STATUS_REPORT.crc_extra}
"""CRC_EXTRA of the messages that a vehicle may send."""

HOME = Geodetic(47.397742, 8.545594, 488.0)
COMPANION = ("127.0.0.1", 14540)
GROUND_STATION = ("127.0.0.1", 50000)
START_NED_M = (-200.0, 0.0, -50.0)
UTC_S = 1_800_000_000.0

ARMED = 128
PX4_HOLD, PX4_OFFBOARD, PX4_LAND, PX4_TAKEOFF = 0x03040000, 0x00060000, 0x06040000, 0x02040000
PX4_MISSION, PX4_RETURN, PX4_ALTITUDE = 0x04040000, 0x05040000, 0x00020000
GUIDED = 4

VELOCITY_ONLY = 0x0DC7

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
ARM, TAKEOFF, LAND, RETURN, SET_MODE, REPOSITION = 400, 22, 21, 20, 176, 192
SET_INTERVAL, REQUEST = 511, 512
NAN = math.nan

both = pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
"""Under either autopilot."""


def one_vehicle(**details: Any) -> Scenario:
    usual: dict[str, Any] = {"start_ned_m": START_NED_M, "goal_ned_m": (200.0, 0.0, -50.0), "sigma_m": 0.0}
    return Scenario("one", 600.0, (VehicleSpec(**(usual | details)),))


def message_of(frame: Frame) -> Message:
    """The message of an autopilot in a frame."""
    if frame.msgid != EKF_STATUS_REPORT.msgid:
        return decode_message(frame)
    return Message(EKF_STATUS_REPORT.name, frame.msgid, decode_payload(EKF_STATUS_REPORT, frame.payload))


class Flight:
    """A vehicle, its world, and everything that its peers have heard."""

    def __init__(
        self,
        flavour: str = "px4",
        start: Start = Start.GROUND,
        *,
        scenario: Scenario | None = None,
        gnss: Any = "gauss-markov",
        seed: int = 1,
    ) -> None:
        self.flavour = flavour
        self.world = World(
            scenario or one_vehicle(),
            autopilot=flavour,
            gnss=gnss,
            seed=seed,
            airborne=start is not Start.GROUND,
        )
        self.navigation = FleetNavigation(self.world, HOME)
        self.autopilot = Autopilot(
            self.world,
            0,
            self.navigation,
            flavour=flavour,
            utc_clock=lambda: UTC_S,
            start=start,
            companion=COMPANION,
        )
        self.client = Encoder(255, 190)
        self.now_s = 1000.0
        self.heard: dict[tuple[str, int], list[tuple[float, Message]]] = {}
        self.passed_on: list[tuple[tuple[str, int], Frame]] = []

    def advance(self, duration_s: float) -> None:
        """Let the world and the vehicle live on, tick by tick."""
        for _ in range(round(duration_s / TICK_S)):
            self.world.step(TICK_S)
            self.now_s += TICK_S
            self.navigation.refresh()
            self._note(self.autopilot.tick(self.now_s))

    def _note(self, outgoing: list[tuple[bytes, tuple[str, int]]]) -> list[Message]:
        messages = []
        for datagram, address in outgoing:
            for frame in parse_datagram(datagram, SENT):
                assert isinstance(frame, Frame)
                if (frame.sysid, frame.compid) != (1, 1):
                    self.passed_on.append((address, frame))
                    continue
                messages.append(message_of(frame))
                self.heard.setdefault(address, []).append((self.now_s, messages[-1]))
        return messages

    def send(
        self, name: str, *, sender: Encoder | None = None, address: Any = GROUND_STATION, **fields: Any
    ) -> list[Message]:
        """Send one message to the vehicle; the answers."""
        datagram = (sender or self.client).encode(name, **fields)
        return self._note(self.autopilot.receive(datagram, address, self.now_s))

    def command(self, number: int, *parameters: float, address: Any = GROUND_STATION) -> int:
        """Send a COMMAND_LONG; the result that is acknowledged last (PX4 acknowledges some twice)."""
        fields: dict[str, Any] = {f"param{at}": value for at, value in enumerate(parameters, start=1)}
        answers = self.send(
            "COMMAND_LONG", target_system=1, target_component=1, command=number, address=address, **fields
        )
        acknowledgement = [answer for answer in answers if answer.name == "COMMAND_ACK"][-1]
        assert (acknowledgement.command, acknowledgement.target_system) == (number, 255)
        return int(acknowledgement.result)

    def set_mode(self, main: int, sub: int = 0) -> int:
        return self.command(176, 1.0, main, sub)

    def setpoint(self, *velocity: float, mask: int = VELOCITY_ONLY, frame: int = 1, **fields: Any) -> list[Message]:
        vx, vy, vz = velocity or (0.0, 0.0, 0.0)
        fields |= {"target_system": 1, "target_component": 1, "coordinate_frame": frame, "type_mask": mask}
        return self.send("SET_POSITION_TARGET_LOCAL_NED", vx=vx, vy=vy, vz=vz, **fields)

    def fly(self, duration_s: float, *velocity: float, **fields: Any) -> None:
        """Stream a setpoint at 10 Hz."""
        for _ in range(round(duration_s / 0.1)):
            self.setpoint(*velocity, **fields)
            self.advance(0.1)

    def messages(self, name: str, address: Any = COMPANION) -> list[tuple[float, Message]]:
        return [(at, message) for at, message in self.heard.get(address, []) if message.name == name]

    def last(self, name: str, address: Any = COMPANION) -> Message:
        return self.messages(name, address)[-1][1]

    @property
    def texts(self) -> list[str]:
        return [message.text.rstrip(b"\x00").decode() for _, message in self.messages("STATUSTEXT")]

    @property
    def mode(self) -> int:
        """As the last heartbeat told it."""
        return int(self.last("HEARTBEAT").custom_mode)

    @property
    def armed(self) -> bool:
        return bool(self.last("HEARTBEAT").base_mode & ARMED)

    @property
    def velocity(self) -> list[float]:
        return [float(value) for value in self.world.velocity_ned_mps[0]]

    @property
    def height_m(self) -> float:
        return -float(self.world.position_ned_m[0, 2])


def offboard(flight: Flight) -> int:
    """Bring a vehicle into OFFBOARD or GUIDED, as a client of either autopilot does."""
    if flight.flavour == "ardupilot":
        return flight.set_mode(GUIDED)
    flight.setpoint(0.0, 0.0, 0.0)
    return flight.set_mode(6)


def airborne(flavour: str, **details: Any) -> Flight:
    flight = Flight(flavour, Start.HOLDING, scenario=one_vehicle(**details))
    flight.advance(0.1)
    assert offboard(flight) == ACCEPTED
    return flight
