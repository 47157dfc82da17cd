"""The air: one broadcast medium that everybody shares, as bytes in and bytes out, without a socket or a clock.

Whoever sends a HEARTBEAT is subscribed for 10 s under its system id, and hears what that vehicle would hear: what
others broadcast within radio range, some of it lost, all of it a little late. System id 255 is an observer and hears
everything at once. Subscribers broadcast simply by sending.

Where senders and receivers are: the emulator's vehicles (system ids 1 to n) at their *true* positions, because radio
waves do not care what a receiver believes; everybody else where its own OPEN_DRONE_ID_LOCATION says. A subscriber that
has never said where it is hears everybody (it may be about to be hit) and is heard by observers only.

Positions are metres north-east-down about home; times are the caller's ``now_s``.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ridlink.errors import ConfigError
from ridlink.geodesy import Geodetic, ned_from_geodetic
from ridlink.mavlink.codec import CRC_EXTRAS, decode_message, message_spec
from ridlink.mavlink.frames import BadFrame, Frame, parse_datagram
from ridlink.technologies import TECHNOLOGIES
from ridlink.units import deg_from_dege7
from sitl_sim.fleet import Stream, vehicle_generator

FloatArray = npt.NDArray[np.float64]
Address = Hashable

SUBSCRIPTION_S = 10.0
"""How long a HEARTBEAT keeps its sender subscribed."""

OBSERVER_SYSTEM_ID = 255
"""Hears everything: ground stations use this system id."""

MAX_SUBSCRIBERS = 1024
"""More addresses than this are refused, so that a flood of them cannot fill the memory."""

MAX_UNDELIVERED = 200_000
"""Datagrams under way at most; beyond, what is broadcast is dropped and counted."""

_UNKNOWN_ALTITUDE_M = -1000.0
_BLOCK = 512


@dataclass(slots=True)
class _Subscriber:
    system_id: int
    heard_s: float
    chance: _Chance = field(repr=False)


class _Chance:
    """Uniform figures of one receiver, drawn in blocks because calls are slow."""

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator
        self._block: list[float] = []

    def draw(self) -> float:
        """The next figure in [0, 1)."""
        if not self._block:
            self._block = self._generator.random(_BLOCK).tolist()
            self._block.reverse()
        return self._block.pop()


class Air:
    """The medium.

    Args:
        technology: One of ``TECHNOLOGIES``.
        range_m: Radio range, instead of the technology's.
        loss: Share lost, instead of the technology's.
        seed: Seed of losses and latencies; each receiver has its own generator by system id.
        home: Origin of the NED frame, without which subscribers outside the emulator cannot be placed.

    Attributes:
        technology: What was chosen.
        range_m, loss: As they apply.
        counters: Events by cause: subscribed, refused, expired, malformed, unsubscribed, no_position, off_air,
            broadcast, out_of_range, lost, delivered, overflow.

    Raises:
        ConfigError: If the technology is unknown, or range or loss out of their range.
    """

    def __init__(
        self,
        technology: str = "ideal",
        *,
        range_m: float | None = None,
        loss: float | None = None,
        seed: int = 1,
        home: Geodetic | None = None,
    ) -> None:
        if technology not in TECHNOLOGIES:
            raise ConfigError(f"unknown technology '{technology}': known are {', '.join(TECHNOLOGIES)}")
        self.technology = TECHNOLOGIES[technology]
        self.range_m = self.technology.range_m if range_m is None else range_m
        self.loss = self.technology.loss if loss is None else loss
        if not (math.isfinite(self.range_m) and self.range_m > 0.0):
            raise ConfigError(f"the radio range must be positive and finite, not {self.range_m}")
        if not 0.0 <= self.loss <= 1.0:
            raise ConfigError(f"the loss must be between 0 and 1, not {self.loss}")
        self.counters: Counter[str] = Counter()
        self._seed = seed
        self._home = home
        self._placed: FloatArray = np.empty((0, 3))
        self._reported: dict[tuple[Address, int], FloatArray] = {}
        self._subscribers: dict[Address, _Subscriber] = {}
        self._under_way: list[tuple[float, int, bytes, Address]] = []
        self._sent = 0

    # --- who is where -------------------------------------------------------------------------------------------------

    def place_vehicles(self, position_ned_m: npt.ArrayLike, on_air: npt.ArrayLike | None = None) -> None:
        """Say where the emulator's vehicles truly are now.

        Args:
            position_ned_m: Shape (n, 3); their system ids are 1 to n.
            on_air: Whose radio works, shape (n,), all unless given: who has crashed neither hears nor is heard.
        """
        self._placed = np.array(position_ned_m, dtype=np.float64).reshape(-1, 3)
        if on_air is not None:
            self._placed[~np.asarray(on_air, dtype=np.bool_)] = np.nan

    def subscribe(self, address: Address, system_id: int, now_s: float) -> None:
        """Subscribe an address for 10 s, or keep it subscribed."""
        known = self._subscribers.get(address)
        if known is not None and known.system_id == system_id:
            known.heard_s = now_s
            return
        if known is None and len(self._subscribers) >= MAX_SUBSCRIBERS:
            self.counters["refused"] += 1
            return
        self.counters["subscribed"] += 1
        chance = _Chance(vehicle_generator(self._seed, Stream.RADIO, system_id))
        self._subscribers[address] = _Subscriber(system_id, now_s, chance)

    def expire(self, now_s: float) -> None:
        """Forget who has been silent for 10 s."""
        for address, subscriber in list(self._subscribers.items()):
            if now_s - subscriber.heard_s > SUBSCRIPTION_S:
                del self._subscribers[address]
                self.counters["expired"] += 1
        for address, system_id in list(self._reported):
            if address not in self._subscribers:
                del self._reported[address, system_id]

    @property
    def subscribers(self) -> dict[Address, int]:
        """System ids by address."""
        return {address: subscriber.system_id for address, subscriber in self._subscribers.items()}

    # --- bytes in -----------------------------------------------------------------------------------------------------

    def receive(self, datagram: bytes, address: Address, now_s: float) -> None:
        """Take a datagram from the air's socket; never raises, whatever it holds.

        HEARTBEATs subscribe their sender and go no further; every other frame is broadcast as it came.
        """
        sender: int | None = None
        kept: list[bytes] = []
        for found in parse_datagram(datagram, CRC_EXTRAS):
            if isinstance(found, BadFrame):
                self.counters["malformed"] += 1
                continue
            if found.msgid == _HEARTBEAT:
                self.subscribe(address, found.sysid, now_s)
                continue
            if found.msgid == _LOCATION and found.checked and address in self._subscribers:
                self._note_position(found, address)
            sender = found.sysid if sender is None else sender
            kept.append(found.raw)
        if sender is None:
            return
        if address not in self._subscribers:
            self.counters["unsubscribed"] += 1
            return
        self._spread(sender, address, self._whereabouts(sender, address), b"".join(kept), now_s)

    def broadcast(
        self, sender: int | Address, position_ned_m: npt.ArrayLike | None, payload: bytes, now_s: float
    ) -> None:
        """Broadcast bytes as they are.

        Args:
            sender: System id of a vehicle of the emulator, or the address of a subscriber.
            position_ned_m: Where it is sent from; None: where the sender was placed, or last said that it is.
            payload: One datagram.
            now_s: Time of sending.
        """
        if isinstance(sender, int):
            system_id, address = sender, None
        elif (subscriber := self._subscribers.get(sender)) is not None:
            system_id, address = subscriber.system_id, sender
        else:
            self.counters["unsubscribed"] += 1
            return
        position = (
            self._whereabouts(system_id, address)
            if position_ned_m is None
            else np.asarray(position_ned_m, dtype=np.float64)
        )
        self._spread(system_id, address, position, payload, now_s)

    def _note_position(self, frame: Frame, address: Address) -> None:
        """Remember where a subscriber says that it is; what it relays of others says nothing about itself."""
        location = decode_message(frame)
        if self._home is None or any(location.id_or_mac):
            return
        latitude, longitude = deg_from_dege7(location.latitude), deg_from_dege7(location.longitude)
        unknown = latitude == 0.0 and longitude == 0.0
        if unknown or not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            return
        altitude = location.altitude_geodetic
        if not math.isfinite(altitude) or altitude <= _UNKNOWN_ALTITUDE_M:
            altitude = self._home.altitude_m
        self._reported[address, frame.sysid] = ned_from_geodetic(latitude, longitude, altitude, self._home)

    def _whereabouts(self, system_id: int, address: Address | None) -> FloatArray | None:
        if 1 <= system_id <= len(self._placed):
            return np.asarray(self._placed[system_id - 1])
        return self._reported.get((address, system_id))

    def _spread(
        self, sender: int, address: Address | None, position: FloatArray | None, payload: bytes, now_s: float
    ) -> None:
        """Put a payload under way to everybody who hears it."""
        self.counters["broadcast"] += 1
        limit = self.range_m * self.range_m
        heard: list[bool] = []
        if position is None:
            self.counters["no_position"] += 1
        elif np.isnan(position[0]):
            self.counters["off_air"] += 1
            return
        elif len(self._placed):
            gap = self._placed - position
            heard = (np.einsum("ij,ij->i", gap, gap) <= limit).tolist()
        shortest, longest = self.technology.latency_s
        delivered = lost = too_far = 0
        for to, subscriber in self._subscribers.items():
            system_id = subscriber.system_id
            if to == address or system_id == sender or now_s - subscriber.heard_s > SUBSCRIPTION_S:
                continue
            latency_s = 0.0
            if system_id != OBSERVER_SYSTEM_ID:
                if position is None:
                    continue
                if 1 <= system_id <= len(heard):
                    in_range = heard[system_id - 1]
                else:
                    own = self._reported.get((to, system_id))
                    in_range = own is None or float(np.sum((own - position) ** 2)) <= limit
                if not in_range:
                    too_far += 1
                    continue
                # both figures are drawn every time: another loss leaves the latencies of what arrives alone
                is_lost, late = subscriber.chance.draw() < self.loss, subscriber.chance.draw()
                if is_lost:
                    lost += 1
                    continue
                latency_s = shortest + late * (longest - shortest)
            if len(self._under_way) >= MAX_UNDELIVERED:
                self.counters["overflow"] += 1
                continue
            self._sent += 1
            heapq.heappush(self._under_way, (now_s + latency_s, self._sent, payload, to))
            delivered += 1
        self.counters["out_of_range"] += too_far
        self.counters["lost"] += lost
        self.counters["delivered"] += delivered

    # --- bytes out ----------------------------------------------------------------------------------------------------

    def due(self, now_s: float) -> list[tuple[bytes, Address]]:
        """What has arrived by now, in order of arrival."""
        arrived = []
        while self._under_way and self._under_way[0][0] <= now_s:
            _, _, payload, address = heapq.heappop(self._under_way)
            arrived.append((payload, address))
        return arrived

    def next_due_s(self) -> float | None:
        """When something arrives next; None if nothing is under way."""
        return self._under_way[0][0] if self._under_way else None


_HEARTBEAT = message_spec("HEARTBEAT").msgid
_LOCATION = message_spec("OPEN_DRONE_ID_LOCATION").msgid
