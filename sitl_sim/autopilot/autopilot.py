"""The MAVLink face of one emulated vehicle: datagrams in, datagrams out, no socket and no clock.

Each peer has a link of its own, as on a real autopilot: its own message rates and its own sequence numbers. One peer,
the companion computer's, is served from the start; up to four others (a conductor, a ground station) are served from
when they speak until they have been silent for 10 s. Answers go to whoever asked, served or not.

What is meant for everybody or for somebody else is passed on to the other links untouched, as both real autopilots do.

Nobody is authenticated: like a real autopilot, it obeys whoever speaks to it.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable
from typing import TypeVar

from ridlink.geodesy import Geodetic, geodetic_from_ned
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, Message, decode_message, encode_payload, message_spec
from ridlink.mavlink.frames import BadFrame, Frame, parse_datagram
from sitl_sim.autopilot.commands import Commands, MavCommand, read_command
from sitl_sim.autopilot.files import refuse_file_transfer
from sitl_sim.autopilot.link import Address, Link, packed
from sitl_sim.autopilot.mission_protocol import MissionProtocol
from sitl_sim.autopilot.modes import FLAVOURS
from sitl_sim.autopilot.navigation import FleetNavigation
from sitl_sim.autopilot.orders import Orders
from sitl_sim.autopilot.parameters import ParameterProtocol, Parameters, Reply
from sitl_sim.autopilot.pilot import Pilot, Start
from sitl_sim.autopilot.results import Result, Severity
from sitl_sim.autopilot.streams import Streams
from sitl_sim.autopilot.telemetry import Telemetry
from sitl_sim.world import VehicleState, World

Outgoing = list[tuple[bytes, Address]]

AUTOPILOT_COMPONENT = 1
AVOIDANCE_COMPONENT = 196
"""MAV_COMP_ID_OBSTACLE_AVOIDANCE: an avoidance daemon."""

MAV_TYPE_GCS = 6

MAX_OTHER_PEERS = 4
PEER_SILENCE_S = 10.0
DAEMON_SILENCE_S = 3.0
TEXT_REPEAT_S = 1.0
MAX_WAITING_TEXTS = 16
MAX_PASSED_ON = 64
"""Frames passed on between two ticks; a flood from one peer is not carried to the others."""

THROTTLE_MIDDLE_US = (1400, 1600)
THROTTLE_MIDDLE = (400, 600)
"""Stick positions of RC_CHANNELS_OVERRIDE and MANUAL_CONTROL that keep the height."""

_NEVER_PASSED_ON = ("TIMESYNC", "PING")

T = TypeVar("T")
Handler = Callable[[Message, Frame, Link], list[Reply]]


class Autopilot:
    """One vehicle as its clients see it.

    Args:
        world: Where it flies.
        index: Its row there; its system id is one more.
        navigation: The fleet's navigation solutions, refreshed by the caller before every tick.
        flavour: "px4", "ardupilot" or "ideal".
        utc_clock: Seconds since 1970, for SYSTEM_TIME.
        start: How it begins.
        companion: Address served from the start; None: only who speaks to it.

    Attributes:
        pilot: Its flight logic.
        counters: Events by cause: taken, bad_frame, refused_peer, not_passed_on.
    """

    def __init__(
        self,
        world: World,
        index: int,
        navigation: FleetNavigation,
        *,
        flavour: str = "px4",
        utc_clock: Callable[[], float],
        start: Start = Start.GROUND,
        companion: Address | None = None,
    ) -> None:
        self._index, self._navigation = index, navigation
        self.system_id = index + 1
        self._flavour = FLAVOURS[flavour]
        parameters = Parameters(self._flavour, self.system_id)
        spec = world.scenario.vehicles[index]
        north, east, _ = spec.start_ned_m
        latitude, longitude, altitude = geodetic_from_ned((north, east, 0.0), navigation.home)
        own_home = Geodetic(float(latitude), float(longitude), float(altitude))
        homes = (navigation.home, own_home)
        self.pilot = Pilot(world, index, spec, self._flavour, parameters, navigation[index], *homes, start, self._say)
        self.telemetry = Telemetry(self.pilot, self._flavour, self.system_id, own_home, utc_clock)
        self._orders = Orders(self.pilot, self._flavour, parameters, spec.cooperative, self._say)
        self._commands = Commands(self.pilot, self._orders, self._flavour, parameters, *homes)
        self._missions = MissionProtocol(self.pilot.mission, px4=self._flavour.is_px4, say=self._say)
        self._streams = Streams(self.telemetry, self.system_id, self._flavour, self._say)
        self.counters: Counter[str] = Counter()
        self._companion = companion
        self._links: dict[Address, Link] = {}
        self._payloads: dict[str, bytes] = {}
        self._passed_on: list[tuple[Address | None, bytes]] = []
        self._repeated: list[bytes] = []
        self._announced: tuple[object, ...] = self._state()
        self._texts: deque[tuple[Severity, str]] = deque(maxlen=MAX_WAITING_TEXTS)
        self._said_s: dict[str, float] = {}
        self._refusals = 0
        self._now_s = -math.inf
        self._daemon_heard_s = -math.inf
        self._handlers = self._all_handlers(ParameterProtocol(parameters, px4=self._flavour.is_px4, say=self._say))

    def _all_handlers(self, parameters: ParameterProtocol) -> dict[int, Handler]:
        handlers: dict[str, Handler] = {
            "HEARTBEAT": self._on_heartbeat,
            "PING": self._on_ping,
            "TIMESYNC": self._on_timesync,
            "SET_MODE": self._on_set_mode,
            "COMMAND_LONG": self._on_command,
            "COMMAND_INT": self._on_command,
            "SET_POSITION_TARGET_LOCAL_NED": self._on_setpoint,
            "SET_POSITION_TARGET_GLOBAL_INT": self._on_setpoint,
            "RC_CHANNELS_OVERRIDE": self._on_rc_override,
            "MANUAL_CONTROL": self._on_manual_control,
            "ADSB_VEHICLE": self._on_adsb_vehicle,
            "PARAM_REQUEST_LIST": lambda message, _, __: parameters.everything(message),
            "PARAM_REQUEST_READ": lambda message, _, __: parameters.read(message),
            "PARAM_SET": lambda message, _, __: parameters.set(message),
            "REQUEST_DATA_STREAM": self._on_request_data_stream,
            "FILE_TRANSFER_PROTOCOL": self._on_file_transfer,
        }
        for name in (
            "COUNT", "ITEM_INT", "ITEM", "REQUEST_LIST", "REQUEST_INT", "REQUEST", "CLEAR_ALL", "SET_CURRENT",
            "WRITE_PARTIAL_LIST", "ACK",
        ):  # fmt: skip
            handlers[f"MISSION_{name}"] = self._on_mission
        return {message_spec(name).msgid: handler for name, handler in handlers.items()}

    @property
    def is_avoiding(self) -> bool:
        """Whether an avoidance daemon is heard and its setpoints are flown, at the time of the last tick."""
        return self._now_s - self._daemon_heard_s <= DAEMON_SILENCE_S and self.pilot.is_steered(self._now_s)

    # --- bytes out ----------------------------------------------------------------------------------------------------

    def tick(self, now_s: float) -> Outgoing:
        """Let time pass, and give what is to be sent now."""
        self._now_s = now_s
        navigation = self._navigation[self._index]
        if navigation.state is VehicleState.GONE:
            return []  # a wreck is silent
        self.pilot.update(navigation, now_s)
        if not navigation.link_on:
            return []
        if self._companion is not None and self._companion not in self._links:
            self._open_link(self._companion, math.inf)
        self._payloads.clear()
        changed = self._announced != self._state()
        self._announced = self._state()
        for_all: list[Reply] = [("MISSION_ITEM_REACHED", {"seq": seq}) for seq in _drained(self.pilot.mission.reached)]
        for_all += [
            ("STATUSTEXT", {"severity": int(severity), "text": text[:50]}) for severity, text in _drained(self._texts)
        ]
        asks_again = self._missions.tick(now_s)
        outgoing: Outgoing = []
        for link in list(self._links.values()):
            if now_s - link.heard_s > PEER_SILENCE_S:
                del self._links[link.address]
                continue
            names = [name for name in link.due(now_s) if self.telemetry.tells(name)]
            if changed:
                names += [name for name in ("HEARTBEAT", "MISSION_CURRENT") if name not in names]
            frames = [link.frame(name, self._payload(name)) for name in names]
            frames += [link.message(name, fields) for name, fields in for_all]
            if asks_again is not None and asks_again[0] == link.address:
                frames.append(link.message(*asks_again[1]))
            frames += [link.frame("ADSB_VEHICLE", payload) for payload in self._repeated]
            frames += [raw for source, raw in self._passed_on if source != link.address]
            outgoing += [(datagram, link.address) for datagram in packed(frames)]
        self._passed_on.clear()
        self._repeated.clear()
        return outgoing

    def _state(self) -> tuple[object, ...]:
        """What is told at once when it changes."""
        pilot = self.pilot
        return pilot.mode, pilot.armed, pilot.failsafe, pilot.mission.current, len(pilot.mission.plan)

    def _payload(self, name: str) -> bytes:
        payload = self._payloads.get(name)
        if payload is None:
            payload = self._payloads[name] = encode_payload(message_spec(name), self.telemetry.fields(name))
        return payload

    def _say(self, severity: Severity, text: str) -> None:
        """Queue a STATUSTEXT for everybody; the same text at most once a second."""
        self._refusals += 1
        if self._now_s - self._said_s.get(text, -math.inf) >= TEXT_REPEAT_S:
            self._said_s = {old: at for old, at in self._said_s.items() if self._now_s - at < TEXT_REPEAT_S}
            if len(self._said_s) < MAX_WAITING_TEXTS:
                self._said_s[text] = self._now_s
                self._texts.append((severity, text))

    # --- bytes in -----------------------------------------------------------------------------------------------------

    def receive(self, datagram: bytes, address: Address, now_s: float) -> Outgoing:
        """Take a datagram from a peer, and give the answers to it; never raises, whatever the bytes."""
        self._now_s = max(self._now_s, now_s)
        navigation = self._navigation[self._index]
        if navigation.state is VehicleState.GONE or not navigation.link_on:
            return []
        frames: list[bytes] = []
        link: Link | None = None
        for frame in parse_datagram(datagram, CRC_EXTRAS):
            if isinstance(frame, BadFrame) or not frame.checked:
                self.counters["bad_frame"] += 1
                continue
            if frame.sysid == self.system_id and frame.compid == AUTOPILOT_COMPONENT:
                continue  # its own words, sent back
            link = link or self._link_to(address, now_s)
            handler = self._handlers.get(frame.msgid)
            if handler is None and len(self._links) < 2:
                continue
            message = decode_message(frame)
            self._pass_on(message, frame, address)
            if handler is not None and self._is_for_us(message):
                self.counters["taken"] += 1
                frames += [link.message(*reply) for reply in handler(message, frame, link)]
        return [(answer, address) for answer in packed(frames)]

    def relay(self, datagram: bytes) -> None:
        """Put frames of another component of this vehicle on all its links, with the next tick."""
        if len(self._passed_on) >= MAX_PASSED_ON:
            self.counters["not_passed_on"] += 1
        else:
            self._passed_on.append((None, datagram))

    def _pass_on(self, message: Message, frame: Frame, source: Address) -> None:
        """To the other links, unless it is for this autopilot alone."""
        if len(self._links) < 2 or message.name in _NEVER_PASSED_ON:
            return
        targets = message.fields.get("target_system", 0), message.fields.get("target_component", 0)
        if targets == (self.system_id, AUTOPILOT_COMPONENT):
            return
        if len(self._passed_on) >= MAX_PASSED_ON:
            self.counters["not_passed_on"] += 1
        else:
            self._passed_on.append((source, frame.raw))

    def _link_to(self, address: Address, now_s: float) -> Link:
        """The link of a peer; whoever finds no place among the served ones gets answers only."""
        link = self._links.get(address)
        if link is None:
            others = len(self._links) - (self._companion in self._links)
            if address == self._companion or others < MAX_OTHER_PEERS:
                return self._open_link(address, math.inf if address == self._companion else now_s)
            self.counters["refused_peer"] += 1
            return Link(address, Encoder(self.system_id, AUTOPILOT_COMPONENT), now_s)
        link.heard_s = max(link.heard_s, now_s)
        return link

    def _open_link(self, address: Address, heard_s: float) -> Link:
        link = self._links[address] = Link(address, Encoder(self.system_id, AUTOPILOT_COMPONENT), heard_s)
        self._streams.begin(link, self._now_s)
        return link

    def _is_for_us(self, message: Message) -> bool:
        fields = message.fields
        if fields.get("target_system", fields.get("target", 0)) not in (0, self.system_id):
            return False
        # ArduPilot does not look at the component of a setpoint
        ours = fields.get("target_component", 0) in (0, AUTOPILOT_COMPONENT)
        return ours or (not self._flavour.is_px4 and message.name.startswith("SET_POSITION_TARGET"))

    # --- one handler a message ----------------------------------------------------------------------------------------

    def _on_heartbeat(self, message: Message, frame: Frame, link: Link) -> list[Reply]:
        if frame.sysid == self.system_id and frame.compid == AVOIDANCE_COMPONENT:
            self._daemon_heard_s = self._now_s
        if message.type == MAV_TYPE_GCS:
            self.pilot.failsafes.note_ground_station(self._now_s)
        return []

    def _on_ping(self, message: Message, frame: Frame, link: Link) -> list[Reply]:
        if message.target_system or message.target_component:
            return []  # an answer to somebody
        return [("PING", {"time_usec": message.time_usec, "seq": message.seq, **_to(frame)})]

    def _on_file_transfer(self, message: Message, frame: Frame, link: Link) -> list[Reply]:
        return refuse_file_transfer(message, frame.sysid, frame.compid)

    def _on_timesync(self, message: Message, frame: Frame, link: Link) -> list[Reply]:
        if message.tc1:
            return []
        boot_ns = round(self.pilot.navigation.time_s * 1e9)
        return [("TIMESYNC", {"tc1": max(boot_ns, 1), "ts1": message.ts1})]

    def _on_setpoint(self, message: Message, frame: Frame, link: Link) -> list[Reply]:
        self.pilot.take_setpoint(message, self._now_s)
        return []

    def _on_rc_override(self, message: Message, frame: Frame, link: Link) -> list[Reply]:
        low, high = THROTTLE_MIDDLE_US
        if message.chan3_raw not in (0, 0xFFFF):
            self.pilot.note_throttle(centred=low <= message.chan3_raw <= high, now_s=self._now_s)
        return []

    def _on_manual_control(self, message: Message, frame: Frame, link: Link) -> list[Reply]:
        low, high = THROTTLE_MIDDLE
        self.pilot.note_throttle(centred=low <= message.z <= high, now_s=self._now_s)
        return []

    def _on_adsb_vehicle(self, message: Message, frame: Frame, link: Link) -> list[Reply]:
        """PX4 gives foreign traffic out again as its own."""
        if self._flavour.is_px4 and len(self._repeated) < MAX_PASSED_ON:
            self._repeated.append(frame.payload)
        return []

    def _on_set_mode(self, message: Message, frame: Frame, link: Link) -> list[Reply]:
        mode = self._flavour.mode_of(message.custom_mode)
        if mode is None:
            self._orders.refuse(f"mode refused: there is no {message.custom_mode}")
        else:
            self._orders.set_mode(mode, self._now_s)
        return []

    def _on_mission(self, message: Message, frame: Frame, link: Link) -> list[Reply]:
        return self._missions.receive(message, (frame.sysid, frame.compid), link.address, self._now_s)

    def _on_request_data_stream(self, message: Message, frame: Frame, link: Link) -> list[Reply]:
        self._streams.legacy(message, link, self._now_s)
        return []

    def _on_command(self, message: Message, frame: Frame, link: Link) -> list[Reply]:
        command = read_command(message)
        said = self._refusals
        answered = self._streams.command(command, link, self._now_s)
        result, asked_for = answered or (self._commands.execute(command, self._now_s), [])
        if result is not Result.ACCEPTED and self._refusals == said:
            self._say(Severity.WARNING, f"command {command.number}: {result.name.lower().replace('_', ' ')}")
        results = [result]
        if self._flavour.is_px4 and command.number == MavCommand.DO_SET_MODE and result is not Result.DENIED:
            results.insert(0, Result.ACCEPTED)  # PX4 acknowledges twice, the first time whatever comes of it
        acknowledgement = {"command": command.number, **_to(frame)}
        return [*(("COMMAND_ACK", acknowledgement | {"result": int(each)}) for each in results), *asked_for]


def _to(frame: Frame) -> dict[str, object]:
    return {"target_system": frame.sysid, "target_component": frame.compid}


def _drained(waiting: list[T] | deque[T]) -> list[T]:
    taken = list(waiting)
    waiting.clear()
    return taken
