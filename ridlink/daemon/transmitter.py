"""The transmitter alone: it receives one autopilot's position and error, and sends them as Remote ID. It steers
nothing.

It sends as component 236 of the vehicle, MAV_COMP_ID_ODID_TXRX_1, of type ODID. The answer of a transmitter module,
OPEN_DRONE_ID_ARM_STATUS, is passed on as an event.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from dataclasses import dataclass
from typing import Any

from ridlink.daemon.events import Events, EventSink
from ridlink.daemon.module_words import ModuleWords
from ridlink.daemon.steady_utc import SteadyUtc
from ridlink.daemon.vehicle_link import open_vehicle_link
from ridlink.engine.intake import STATUSTEXT, VEHICLE_IDS, Intake
from ridlink.engine.unheard import Unheard
from ridlink.links import (
    Address,
    Link,
    LinkUrl,
    SigningOptions,
    open_link,
    refuse_to_speak_to_oneself,
)
from ridlink.mavlink.codec import Encoder
from ridlink.own_ship import OwnShipTelemetry
from ridlink.own_ship.broadcast import INTERVAL_S, Broadcast, BroadcastSettings, honest_error_m
from ridlink.own_ship.names import OwnNames
from ridlink.own_ship.requests import Requests
from ridlink.periodic import Periodic
from ridlink.remote_id.bridge import REMOTE_ID_IDS
from ridlink.remote_id.messages import BasicId
from ridlink.remote_id.text import display_text

TRANSMITTER_COMPONENT = 236
TYPE_ODID, AUTOPILOT_INVALID, STATE_ACTIVE = 34, 8, 4
HEARD_IDS = VEHICLE_IDS - {STATUSTEXT}
"""Messages read from the vehicle link; STATUSTEXT concerns only a program that steers."""


@dataclass(frozen=True, slots=True)
class TransmitterConfig:
    """One transmitter.

    Args:
        vehicle: Link to the autopilot.
        to: Link to transmit on.
        settings: Facts that the autopilot does not send.
        vehicle_sysid: Listen to this autopilot only; by default to the first one heard.
        signing: How the vehicle link is signed; None: it is not signed.
        allow_v1: Take MAVLink 1 frames from the autopilot as well.
    """

    vehicle: LinkUrl
    to: LinkUrl
    settings: BroadcastSettings
    vehicle_sysid: int | None = None
    signing: SigningOptions | None = None
    allow_v1: bool = False

    def __post_init__(self) -> None:
        refuse_to_speak_to_oneself({"vehicle": self.vehicle, "to": self.to})


class Transmitter:
    """Receives and transmits; several may run in one loop.

    Args:
        config: Its configuration.
        on_event: Called with a dictionary once a second, and when a module says something new or falls silent.

    Attributes:
        vehicle_address: Local end of the vehicle link, once `run` has opened it.
        ready: Set once both links are open.
        counters: Sent messages, and received ones that were not taken, by cause.
    """

    def __init__(self, config: TransmitterConfig, *, on_event: EventSink | None = None) -> None:
        self.config = config
        self.counters: Counter[str] = Counter()
        self.ready = asyncio.Event()
        self.vehicle_address: Address | None = None
        self._events = Events(on_event, self.counters)
        self._module = ModuleWords(self._events)
        self._telemetry = OwnShipTelemetry(config.vehicle_sysid)
        self._intake = Intake(allow_v1=config.allow_v1)
        self._unheard = Unheard(self._intake, self._telemetry)
        self._broadcast = Broadcast(config.settings)
        self._speak_as(config.vehicle_sysid or 1)
        self._utc = SteadyUtc(time.monotonic())
        self._names = OwnNames(self._telemetry, config.settings.uas_id)
        self._heartbeat_due, self._second = Periodic(1.0), Periodic(1.0)
        self._requests = Requests(steers=False, broadcasts=True)
        self._vehicle: Link | None = None
        self._to: Link | None = None

    async def run(self, stop: asyncio.Event) -> dict[str, Any]:
        """Transmit until `stop` is set; returns a summary.

        Raises:
            LinkError: If a link cannot be opened.
            ConfigError, OSError: If the key of the vehicle link, or its clock, cannot be used.
        """
        try:
            self._vehicle = await open_vehicle_link(self.config.vehicle, self._from_vehicle, self.config.signing)
            self._to = await open_link(self.config.to, self._from_module)
            self.vehicle_address = self._vehicle.local_address
            self.ready.set()
            due = time.monotonic()
            while not stop.is_set():
                self._step(time.monotonic())
                due = max(due + INTERVAL_S, time.monotonic())
                try:
                    await asyncio.wait_for(stop.wait(), due - time.monotonic())
                except TimeoutError:
                    continue
        finally:
            for link in (self._vehicle, self._to):
                if link is not None:
                    link.close()
        return {"event": "final", "sent": self.counters["sent"], "rejects": self.rejects()}

    def rejects(self) -> dict[str, int]:
        """Messages that were not taken or not sent, or told of a fault, by cause."""
        found = self._intake.counters + self._telemetry.counters + self._module.counters
        for name, link in (("vehicle", self._vehicle), ("transmitter", self._to)):
            if link is not None:
                found.update({f"{name}_link_{cause}": count for cause, count in link.counters.items()})
        return dict(found)

    def _from_vehicle(self, data: bytes, address: Address) -> None:
        now_s = time.monotonic()
        for frame, message in self._intake.messages(data, HEARD_IDS):
            if frame.msgid not in REMOTE_ID_IDS:
                self._telemetry.receive(frame.sysid, frame.compid, message, now_s, address)
                continue
            lock = self._telemetry.lock
            if lock is None or (lock.sysid, lock.source) != (frame.sysid, address):
                continue
            for part in self._intake.remote_id(message):
                if isinstance(part, BasicId) and part.id_or_mac is None:
                    self._names.hear(part)
        lock = self._telemetry.lock
        if lock is not None and lock.sysid != self._encoder.sysid:
            self._speak_as(lock.sysid)

    def _from_module(self, data: bytes, _: Address) -> None:
        self._module.receive(data, time.monotonic())

    def _speak_as(self, sysid: int) -> None:
        # each link counts its own messages, so that receivers see no loss
        self._encoder, self._to_encoder = (Encoder(sysid, TRANSMITTER_COMPONENT) for _ in range(2))

    def _step(self, now_s: float) -> None:
        self._utc.check(now_s)
        telemetry, utc_s = self._telemetry, self._utc.at(now_s)
        lock = telemetry.lock
        if self._heartbeat_due.due(now_s):
            self._to_vehicle(_heartbeat(self._encoder))
            if lock is not None or telemetry.pinned is not None:  # others must know which vehicle sends
                self._send(_heartbeat(self._to_encoder))
        for frame in self._requests.due(self._encoder, telemetry, now_s):
            self._to_vehicle(frame)
        names = self._names
        for datagram in self._broadcast.datagrams(
            self._to_encoder, telemetry, now_s=now_s, utc_s=utc_s, uas_id=names.uas_id, id_type=names.id_type
        ):
            self.counters["sent"] += self._send(datagram)
        if self._second.due(now_s):
            self._tell(now_s)

    def _to_vehicle(self, frame: bytes) -> None:
        lock = self._telemetry.lock
        if self._vehicle is not None:
            source = lock.source if lock is not None else None
            self._vehicle.send(frame, source if isinstance(source, tuple) else None)

    def _send(self, data: bytes) -> bool:
        return self._to is not None and self._to.send(data)

    def _tell(self, now_s: float) -> None:
        self._module.tell(now_s)
        telemetry = self._telemetry
        own = telemetry.state(now_s)
        state = "waiting" if telemetry.lock is None else "no-position" if own is None else "transmitting"
        self._events.emit(
            "summary",
            state=state,
            why=self._unheard.why() or None,
            system_id=None if telemetry.lock is None else telemetry.lock.sysid,
            identity=(identity := self._names.uas_id) and display_text(identity),
            error_m=None if own is None else round(min(honest_error_m(telemetry, own), 655.35), 2),
            sent=self.counters["sent"],
            rejects=self.rejects(),
        )


def _heartbeat(encoder: Encoder) -> bytes:
    return encoder.encode(
        "HEARTBEAT", type=TYPE_ODID, autopilot=AUTOPILOT_INVALID, system_status=STATE_ACTIVE, mavlink_version=3
    )
