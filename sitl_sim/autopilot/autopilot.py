"""The MAVLink interface of one emulated vehicle: datagrams in, datagrams out, no socket and no clock.

Each peer has its own link, as on a real autopilot, with its own message rates and sequence numbers, see `peers`.
Answers go to the peer that asked, served or not. Messages for all or for another component are forwarded unchanged to
the other links, as both real autopilots do.

There is no authentication: like a real autopilot, it obeys every peer.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

from ridlink.geodesy import Geodetic, geodetic_from_ned
from ridlink.mavlink.codec import CRC_EXTRAS, Message, decode_message, encode_payload
from ridlink.mavlink.frames import BadFrame, parse_datagram
from sitl_sim.autopilot.answers import Answers, Heard
from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.ekf_status import spec_of
from sitl_sim.autopilot.link import Address, Link, packed
from sitl_sim.autopilot.mission_protocol import MissionProtocol
from sitl_sim.autopilot.modes import FLAVOURS
from sitl_sim.autopilot.navigation import FleetNavigation
from sitl_sim.autopilot.parameters import Parameters
from sitl_sim.autopilot.peers import AUTOPILOT_COMPONENT, Peers
from sitl_sim.autopilot.pilot import Pilot, Start
from sitl_sim.autopilot.results import Reply
from sitl_sim.autopilot.routine import Routine
from sitl_sim.autopilot.status_texts import StatusTexts
from sitl_sim.autopilot.streams import Streams
from sitl_sim.autopilot.telemetry import Telemetry
from sitl_sim.vehicle import VehicleState
from sitl_sim.world import World

Outgoing = list[tuple[bytes, Address]]

DAEMON_SILENCE_S = 3.0


class Autopilot:
    """One vehicle as seen by its clients.

    Args:
        world: The world.
        index: Its row in the world; its system id is one more.
        navigation: The fleet's navigation solutions, refreshed by the caller before every tick.
        flavour: "px4", "ardupilot" or "ideal".
        utc_clock: Seconds since 1970, for SYSTEM_TIME.
        start: Initial state.
        companion: Address served from the start; None: only peers that send first.

    Attributes:
        pilot: Its flight logic.
        telemetry: Its telemetry.
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
        self.counters: Counter[str] = Counter()
        self._texts = StatusTexts()
        self._board = board = _board_of(world, index, flavour, navigation.home, self._texts)
        self.pilot = Pilot(board, world, navigation[index], start)
        self._routine = Routine(board, world, self.pilot)
        self.telemetry = Telemetry(board, self.pilot, utc_clock)
        self._missions = MissionProtocol(board, self.pilot.mission)
        streams = Streams(board, self.telemetry)
        self._answers = Answers(board, self.pilot, self._missions, streams, self._texts)
        self._peers = Peers(self.system_id, companion, streams, self.counters)
        self._payloads: dict[str, bytes] = {}
        self._announced: tuple[object, ...] = self._state()
        self._now_s = -math.inf

    @property
    def mode_name(self) -> str:
        """Its mode, by the name that ground stations use."""
        return self._board.flavour.name_of(self.pilot.mode)

    @property
    def is_avoiding(self) -> bool:
        """Whether an avoidance daemon was heard and its setpoints were flown at the last tick."""
        return self._now_s - self._answers.daemon_heard_s <= DAEMON_SILENCE_S and self.pilot.is_steered(self._now_s)

    def begin_mission(self) -> None:
        """For a vehicle that avoids nobody: fly to the goal now, or as soon as it has climbed."""
        self._routine.begin_mission()

    # --- bytes out ----------------------------------------------------------------------------------------------------

    def tick(self, now_s: float) -> Outgoing:
        """Advance time; returns the datagrams to send now."""
        self._now_s = self._texts.now_s = now_s
        navigation = self._navigation[self._index]
        if navigation.state is VehicleState.GONE:
            return []  # a wreck is silent
        self._routine.update(navigation, now_s)
        for_all = [*self._reached(), *self._texts.taken()]
        repeated, for_others = self._answers.repeated(), self._answers.for_others()
        if not navigation.link_on:
            self._peers.end_tick()
            return []  # what is said now is not heard later, either
        self._peers.serve_companion(now_s)
        self._payloads.clear()
        at_once = self._changed()
        asks_again = self._missions.tick(now_s)
        outgoing: Outgoing = []
        for link in self._peers.served(now_s):
            names = [name for name in link.due(now_s) if self.telemetry.tells(name)]
            names += [name for name in at_once if name not in names]
            frames = [link.frame(name, self._payload(name)) for name in names]
            frames += [link.message(name, fields) for name, fields in for_all]
            frames += [link.message(*reply) for source, reply in for_others if source != link.address]
            if asks_again is not None and asks_again[0] == link.address:
                frames.append(link.message(*asks_again[1]))
            frames += [link.frame("ADSB_VEHICLE", payload) for payload in repeated]
            frames += self._peers.carried(link)
            outgoing += [(datagram, link.address) for datagram in packed(frames)]
        self._peers.end_tick()
        return outgoing

    def _state(self) -> tuple[object, ...]:
        """The state whose changes are sent at once."""
        pilot = self.pilot
        return pilot.mode, pilot.armed, pilot.failsafe, pilot.mission.current, len(pilot.mission.plan)

    def _changed(self) -> tuple[str, ...]:
        """Messages that are sent now, independent of their rates."""
        before, self._announced = self._announced, self._state()
        return () if before == self._announced else ("HEARTBEAT", "MISSION_CURRENT")

    def _reached(self) -> list[Reply]:
        reached: list[Reply] = [("MISSION_ITEM_REACHED", {"seq": seq}) for seq in self.pilot.mission.reached]
        self.pilot.mission.reached.clear()
        return reached

    def _payload(self, name: str) -> bytes:
        payload = self._payloads.get(name)
        if payload is None:
            payload = self._payloads[name] = encode_payload(spec_of(name), self.telemetry.fields(name))
        return payload

    # --- bytes in -----------------------------------------------------------------------------------------------------

    def receive(self, datagram: bytes, address: Address, now_s: float) -> Outgoing:
        """Process a datagram from a peer; returns the answers. Never raises, whatever the bytes."""
        self._now_s = self._texts.now_s = max(self._now_s, now_s)
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
                continue  # its own message, sent back
            link = link or self._peers.link_to(address, self._now_s)
            is_ours = frame.msgid in self._answers
            if not is_ours and len(self._peers) < 2:
                continue
            message = decode_message(frame)
            self._peers.pass_on(message, frame.raw, address)
            if is_ours and self._is_for_us(message):
                self.counters["taken"] += 1
                replies = self._answers.to(Heard(message, frame, link, self._now_s))
                frames += [link.message(*reply) for reply in replies]
        return [(answer, address) for answer in packed(frames)]

    def relay(self, datagram: bytes) -> None:
        """Send frames of another component of this vehicle on all its links, with the next tick."""
        self._peers.carry(datagram)

    def _is_for_us(self, message: Message) -> bool:
        fields = message.fields
        if fields.get("target_system", fields.get("target", 0)) not in (0, self.system_id):
            return False
        # ArduPilot does not look at the component of a setpoint
        ours = fields.get("target_component", 0) in (0, AUTOPILOT_COMPONENT)
        return ours or (not self._board.is_px4 and message.name.startswith("SET_POSITION_TARGET"))


def _board_of(world: World, index: int, flavour: str, home: Geodetic, texts: StatusTexts) -> Board:
    """The flight controller of a vehicle in a world whose origin is `home`."""
    spec, system_id = world.scenario.vehicles[index], index + 1
    north, east, _ = spec.start_ned_m
    latitude, longitude, altitude = geodetic_from_ned((north, east, 0.0), home)
    ground = Geodetic(float(latitude), float(longitude), float(altitude))
    return Board(
        system_id,
        spec,
        FLAVOURS[flavour],
        Parameters(FLAVOURS[flavour], system_id),
        scenario_home=home,
        own_origin=ground,
        own_home=ground,
        say=texts.say,
        inject=world.inject,
    )
