"""The MAVLink face of one emulated vehicle: datagrams in, datagrams out, no socket and no clock.

Each peer has a link of its own, as on a real autopilot: its own message rates and its own sequence numbers. One peer,
the companion computer's, is served from the start; up to four others (a conductor, a ground station) are served from
when they speak until they have been silent for 10 s. Answers go to whoever asked, served or not.

Nobody is authenticated: like a real autopilot, it obeys whoever speaks to it.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable

from ridlink.mavlink.codec import CRC_EXTRAS, MESSAGES, Encoder, Message, decode_message, encode_payload, message_spec
from ridlink.mavlink.frames import BadFrame, Frame, encode_frame, parse_datagram
from sitl_sim.autopilot.commands import Command, Commands, MavCommand, read_command
from sitl_sim.autopilot.modes import FLAVOURS
from sitl_sim.autopilot.navigation import FleetNavigation
from sitl_sim.autopilot.parameters import Parameters
from sitl_sim.autopilot.pilot import Pilot, Result, Severity, Start
from sitl_sim.autopilot.telemetry import DEFAULT_INTERVAL_S, LEGACY_STREAMS, ON_REQUEST, Telemetry
from sitl_sim.world import VehicleState, World

Address = tuple[str, int]
Outgoing = list[tuple[bytes, Address]]

AUTOPILOT_COMPONENT = 1
AVOIDANCE_COMPONENT = 196
"""MAV_COMP_ID_OBSTACLE_AVOIDANCE: an avoidance daemon."""

MAX_OTHER_PEERS = 4
PEER_SILENCE_S = 10.0
DAEMON_SILENCE_S = 3.0
TEXT_REPEAT_S = 1.0
MIN_INTERVAL_S = 0.02
MAX_DATAGRAM = 1200
"""Messages that are due together share a datagram up to this size; MAVSDK reads into 2048 bytes."""

MAX_WAITING_TEXTS = 16
_PHASE_STEP = 0.6180339887
"""Golden ratio: spreads the streams of any number of vehicles evenly over a period."""


class Link:
    """Streams to one peer."""

    def __init__(self, address: Address, encoder: Encoder, heard_s: float) -> None:
        self.address = address
        self.heard_s = heard_s
        self._encoder = encoder
        self._interval_s: dict[str, float] = {}
        self._due_s: dict[str, float] = {}
        self._next_s = math.inf

    def stream(self, name: str, interval_s: float, from_s: float) -> None:
        """Send a message this often; an infinite interval stops it."""
        if math.isinf(interval_s):
            self._interval_s.pop(name, None)
            self._due_s.pop(name, None)
        else:
            self._interval_s[name] = max(interval_s, MIN_INTERVAL_S)
            self._due_s[name] = from_s
        self._next_s = min(self._due_s.values(), default=math.inf)

    def due(self, now_s: float) -> list[str]:
        """Messages to send now."""
        if now_s < self._next_s:
            return []
        names = []
        for name, due_s in self._due_s.items():
            if due_s <= now_s:
                names.append(name)
                interval_s = self._interval_s[name]
                self._due_s[name] = due_s + interval_s if now_s - due_s < interval_s else now_s + interval_s
        self._next_s = min(self._due_s.values())
        return names

    def frame(self, name: str, payload: bytes) -> bytes:
        """One frame with this link's sequence number."""
        spec, encoder = message_spec(name), self._encoder
        encoder.seq = (encoder.seq + 1) & 0xFF
        return encode_frame(
            spec.msgid, payload, spec.crc_extra, seq=encoder.seq, sysid=encoder.sysid, compid=encoder.compid
        )


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
        counters: Events by cause: taken, bad_frame, refused_peer.
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
        self._parameters = Parameters(self._flavour, self.system_id)
        spec = world.scenario.vehicles[index]
        self.pilot = Pilot(world, index, spec, self._flavour, self._parameters, navigation[index], start, self._say)
        self.telemetry = Telemetry(self.pilot, self._flavour, self.system_id, navigation.home, utc_clock)
        self._commands = Commands(self.pilot, self._flavour, self._parameters, navigation.home, self.telemetry.home)
        self.counters: Counter[str] = Counter()
        self._companion = companion
        self._links: dict[Address, Link] = {}
        self._payloads: dict[str, bytes] = {}
        self._announced = (self.pilot.mode, self.pilot.armed, self.pilot.failsafe)
        self._texts: deque[tuple[Severity, str]] = deque(maxlen=MAX_WAITING_TEXTS)
        self._said_s: dict[str, float] = {}
        self._now_s = -math.inf
        self._daemon_heard_s = -math.inf
        self._handlers: dict[int, Callable[[Message, Frame, Link], list[bytes]]] = {
            message_spec(name).msgid: handler
            for name, handler in (
                ("HEARTBEAT", self._on_heartbeat),
                ("PING", self._on_ping),
                ("TIMESYNC", self._on_timesync),
                ("SET_MODE", self._on_set_mode),
                ("COMMAND_LONG", self._on_command),
                ("COMMAND_INT", self._on_command),
                ("SET_POSITION_TARGET_LOCAL_NED", self._on_setpoint),
                ("PARAM_REQUEST_LIST", self._on_param_request_list),
                ("PARAM_REQUEST_READ", self._on_param_request_read),
                ("PARAM_SET", self._on_param_set),
                ("REQUEST_DATA_STREAM", self._on_request_data_stream),
            )
        }

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
        if self._companion is not None and self._companion not in self._links:
            self._open_link(self._companion, math.inf)
        self._payloads.clear()
        changed = self._announced != (self.pilot.mode, self.pilot.armed, self.pilot.failsafe)
        self._announced = (self.pilot.mode, self.pilot.armed, self.pilot.failsafe)
        outgoing: Outgoing = []
        for link in list(self._links.values()):
            if now_s - link.heard_s > PEER_SILENCE_S:
                del self._links[link.address]
                continue
            names = link.due(now_s)
            if changed and "HEARTBEAT" not in names:
                names.append("HEARTBEAT")
            frames = [link.frame(name, self._payload(name)) for name in names]
            frames += [self._text_frame(link, severity, text) for severity, text in self._texts]
            outgoing += [(datagram, link.address) for datagram in _packed(frames)]
        self._texts.clear()
        return outgoing

    def _payload(self, name: str) -> bytes:
        payload = self._payloads.get(name)
        if payload is None:
            payload = self._payloads[name] = encode_payload(message_spec(name), self.telemetry.fields(name))
        return payload

    def _reply(self, link: Link, name: str, **fields: object) -> bytes:
        return link.frame(name, encode_payload(message_spec(name), fields))

    def _text_frame(self, link: Link, severity: Severity, text: str) -> bytes:
        return self._reply(link, "STATUSTEXT", severity=int(severity), text=text[:50])

    def _say(self, severity: Severity, text: str) -> None:
        """Queue a STATUSTEXT for everybody; the same text at most once a second."""
        if self._now_s - self._said_s.get(text, -math.inf) >= TEXT_REPEAT_S:
            self._said_s[text] = self._now_s
            self._texts.append((severity, text))

    # --- bytes in -----------------------------------------------------------------------------------------------------

    def receive(self, datagram: bytes, address: Address, now_s: float) -> Outgoing:
        """Take a datagram from a peer, and give the answers to it; never raises, whatever the bytes."""
        self._now_s = max(self._now_s, now_s)
        if self._navigation[self._index].state is VehicleState.GONE:
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
            if handler is None:
                continue
            message = decode_message(frame)
            if self._is_for_us(message):
                self.counters["taken"] += 1
                frames += handler(message, frame, link)
        return [(answer, address) for answer in _packed(frames)]

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
        link = Link(address, Encoder(self.system_id, AUTOPILOT_COMPONENT), heard_s)
        self._links[address] = link
        for name, interval_s in DEFAULT_INTERVAL_S.items():
            if name in self.telemetry:
                self._stream(link, name, interval_s)
        return link

    def _stream(self, link: Link, name: str, interval_s: float) -> None:
        """Start a stream; the same messages of different vehicles fall into different moments."""
        phase = (self.system_id * _PHASE_STEP) % 1.0 * min(interval_s, 0.1) if math.isfinite(interval_s) else 0.0
        link.stream(name, interval_s, self._now_s + phase)

    def _is_for_us(self, message: Message) -> bool:
        target_system = message.fields.get("target_system", 0)
        target_component = message.fields.get("target_component", 0)
        if target_system not in (0, self.system_id):
            return False
        # ArduPilot does not look at the component of a setpoint
        ours = target_component in (0, AUTOPILOT_COMPONENT)
        return ours or (not self._flavour.is_px4 and message.name == "SET_POSITION_TARGET_LOCAL_NED")

    # --- one handler a message ----------------------------------------------------------------------------------------

    def _on_heartbeat(self, message: Message, frame: Frame, link: Link) -> list[bytes]:
        if frame.sysid == self.system_id and frame.compid == AVOIDANCE_COMPONENT:
            self._daemon_heard_s = self._now_s
        return []

    def _on_ping(self, message: Message, frame: Frame, link: Link) -> list[bytes]:
        if message.target_system or message.target_component:
            return []  # an answer to somebody
        return [
            self._reply(
                link,
                "PING",
                time_usec=message.time_usec,
                seq=message.seq,
                target_system=frame.sysid,
                target_component=frame.compid,
            )
        ]

    def _on_timesync(self, message: Message, frame: Frame, link: Link) -> list[bytes]:
        if message.tc1:
            return []
        boot_ns = round(self.pilot.navigation.time_s * 1e9)
        return [self._reply(link, "TIMESYNC", tc1=max(boot_ns, 1), ts1=message.ts1)]

    def _on_setpoint(self, message: Message, frame: Frame, link: Link) -> list[bytes]:
        self.pilot.take_setpoint(message, self._now_s)
        return []

    def _on_set_mode(self, message: Message, frame: Frame, link: Link) -> list[bytes]:
        mode = self._flavour.mode_of(message.custom_mode)
        if mode is not None:
            self.pilot.set_mode(mode, self._now_s)
        return []

    def _on_command(self, message: Message, frame: Frame, link: Link) -> list[bytes]:
        command = read_command(message)
        asked_for: list[bytes] = []
        match command.number:
            case MavCommand.SET_MESSAGE_INTERVAL:
                result = self._set_interval(command, link)
            case MavCommand.REQUEST_MESSAGE:
                result, asked_for = self._once(_message_name(command[1]), link)
            case MavCommand.GET_HOME_POSITION:
                result, asked_for = self._once("HOME_POSITION", link)
            case MavCommand.REQUEST_AUTOPILOT_CAPABILITIES:
                result, asked_for = self._once("AUTOPILOT_VERSION", link)
            case _:
                result = self._commands.execute(command, self._now_s)
        acknowledgement = self._reply(
            link,
            "COMMAND_ACK",
            command=command.number,
            result=int(result),
            target_system=frame.sysid,
            target_component=frame.compid,
        )
        return [acknowledgement, *asked_for]

    def _once(self, name: str | None, link: Link) -> tuple[Result, list[bytes]]:
        if name is None or name not in self.telemetry:
            return Result.UNSUPPORTED, []
        return Result.ACCEPTED, [link.frame(name, encode_payload(message_spec(name), self.telemetry.fields(name)))]

    def _set_interval(self, command: Command, link: Link) -> Result:
        name, interval_us = _message_name(command[1]), command[2]
        if name is None or name not in self.telemetry:
            if self._flavour.is_px4:
                return Result.ACCEPTED  # as PX4 answers, although nothing will come
            self._say(Severity.WARNING, "message interval refused: unknown message")
            return Result.DENIED
        if interval_us is None:
            interval_s = DEFAULT_INTERVAL_S.get(name, math.inf)
        else:
            interval_s = math.inf if interval_us < 0.0 else interval_us / 1e6
        self._stream(link, name, interval_s)
        return Result.ACCEPTED

    def _on_request_data_stream(self, message: Message, frame: Frame, link: Link) -> list[bytes]:
        everything = tuple(name for names in LEGACY_STREAMS.values() for name in names)
        names = LEGACY_STREAMS.get(message.req_stream_id, everything if message.req_stream_id == 0 else ())
        for name in names:
            wanted = message.start_stop and message.req_message_rate
            self._stream(link, name, 1.0 / message.req_message_rate if wanted else math.inf)
        return []

    def _on_param_request_list(self, message: Message, frame: Frame, link: Link) -> list[bytes]:
        return [self._param_value(link, index) for index in range(len(self._parameters))]

    def _on_param_request_read(self, message: Message, frame: Frame, link: Link) -> list[bytes]:
        index = self._parameters.find(message.param_id, message.param_index)
        return [] if index is None else [self._param_value(link, index)]

    def _on_param_set(self, message: Message, frame: Frame, link: Link) -> list[bytes]:
        index = self._parameters.find(message.param_id)
        if index is None:
            return []
        if not self._parameters.set(index, message.param_value, message.param_type):
            self._say(Severity.WARNING, "parameter refused: type or value")
        return [self._param_value(link, index)]

    def _param_value(self, link: Link, index: int) -> bytes:
        return self._reply(link, "PARAM_VALUE", **self._parameters.fields(index))


def _message_name(msgid: float | None) -> str | None:
    spec = MESSAGES.get(int(msgid or 0))
    if spec is None or (spec.name not in DEFAULT_INTERVAL_S and spec.name not in ON_REQUEST):
        return None
    return spec.name


def _packed(frames: list[bytes]) -> list[bytes]:
    """Frames joined into datagrams of at most ``MAX_DATAGRAM`` bytes, in order."""
    datagrams: list[bytes] = []
    for frame in frames:
        if datagrams and len(datagrams[-1]) + len(frame) <= MAX_DATAGRAM:
            datagrams[-1] += frame
        else:
            datagrams.append(frame)
    return datagrams
