"""The air: one shared broadcast medium, bytes in and bytes out, without a socket or a clock.

An address that sends a HEARTBEAT is subscribed for 10 s under its system id, and receives what that vehicle would hear:
broadcasts of others within radio range, some of them lost, all of them a little late. System id 255 is an observer and
receives everything at once. All other messages are broadcast: a transmitter need not subscribe.

The module ``listeners`` has the positions of senders and receivers. A subscriber that has never reported its position
hears all senders (it may be about to be hit). A sender that has never reported its position is heard by observers only,
except for relayed messages: these are heard around the relayed aircraft.

Positions are in metres, north-east-down about home; times are the caller's ``now_s``.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter

import numpy as np
import numpy.typing as npt

from ridlink.errors import ConfigError
from ridlink.geodesy import Geodetic
from ridlink.mavlink.codec import CRC_EXTRAS, message_spec
from ridlink.mavlink.frames import BadFrame, Frame, parse_datagram
from ridlink.technologies import TECHNOLOGIES
from sitl_sim.chance import reception_chances
from sitl_sim.listeners import SUBSCRIPTION_S, Address, FloatArray, Listeners, Receivers

MAX_UNDELIVERED = 200_000
"""Limit of datagrams under way; beyond it, broadcasts are dropped and counted."""

CROWD_S = 1.0
"""Time between two counts of the senders around each receiver."""

SENDING_PERIODS = 3.0
"""A sender that has not sent for this many periods, or seconds, no longer counts as a neighbour."""


class Air:
    """The medium.

    Args:
        technology: One of ``TECHNOLOGIES``.
        range_m: Radio range, instead of that of the technology.
        loss: Share lost, at any distance and with any number of senders, instead of that of the technology.
        seed: Seed of losses and latencies. Losses between a sender and a receiver depend only on the two system ids and
            on the number of broadcasts of the sender.
        home: Origin of the NED frame; without it, subscribers outside the emulator have no position.

    Attributes:
        technology: The chosen technology.
        range_m: The radio range in effect.
        listeners: Subscribers and positions.
        counters: Events by cause: subscribed, refused, expired, malformed, no_position, off_air, broadcast,
            out_of_range, lost, delivered, overflow.

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
        self._loss = loss
        if not (math.isfinite(self.range_m) and self.range_m > 0.0):
            raise ConfigError(f"the radio range must be positive and finite, not {self.range_m}")
        if loss is not None and not 0.0 <= loss <= 1.0:
            raise ConfigError(f"the loss must be between 0 and 1, not {loss}")
        self.counters: Counter[str] = Counter()
        self._seed = seed
        self.listeners = Listeners(home, self.counters)
        self._sends: Counter[int] = Counter()
        self._sent_from: dict[int, tuple[float, FloatArray]] = {}
        self._crowd: FloatArray | None = None
        self._crowd_of: Receivers | None = None
        self._crowd_s = -math.inf
        self._under_way: list[tuple[float, int, bytes, tuple[Address, ...]]] = []
        self._waiting = 0
        self._sent = 0

    # --- bytes in -----------------------------------------------------------------------------------------------------

    def receive(self, datagram: bytes, address: Address, now_s: float) -> None:
        """Receive a datagram from the air's socket; never raises, whatever it holds.

        HEARTBEATs subscribe their sender and are not broadcast; every other frame is broadcast unchanged.
        """
        first: Frame | None = None
        kept: list[bytes] = []
        for found in parse_datagram(datagram, CRC_EXTRAS):
            if isinstance(found, BadFrame):
                self.counters["malformed"] += 1
                continue
            if found.msgid == _HEARTBEAT:
                self.listeners.subscribe(address, found.sysid, now_s)
                continue
            if found.msgid == _LOCATION and found.checked:
                self.listeners.note_position(found, address, now_s)
            first = first or found
            kept.append(found.raw)
        if first is not None:
            position = self.listeners.whereabouts(first.sysid, address, first)
            self._spread(first.sysid, address, position, b"".join(kept), now_s)

    def broadcast(self, sender: int, position_ned_m: npt.ArrayLike | None, payload: bytes, now_s: float) -> None:
        """Broadcast bytes unchanged.

        Args:
            sender: System id of a vehicle of the emulator.
            position_ned_m: Position of transmission; None: that of the sender.
            payload: One datagram.
            now_s: Time of sending.
        """
        position = (
            self.listeners.whereabouts(sender, None)
            if position_ned_m is None
            else np.asarray(position_ned_m, dtype=np.float64)
        )
        self._spread(sender, None, position, payload, now_s)

    def _spread(
        self, sender: int, address: Address | None, position: FloatArray | None, payload: bytes, now_s: float
    ) -> None:
        """Send a payload to all receivers that hear it."""
        self.counters["broadcast"] += 1
        if position is not None and np.isnan(position[0]):
            self.counters["off_air"] += 1
            return
        self._sends[sender] += 1
        if position is not None:
            self._sent_from[sender] = now_s, position
        receivers = self.listeners.receivers
        observers = tuple(
            to
            for to, observer in receivers.observers.items()
            if to != address and observer.system_id != sender and now_s - observer.heard_s <= SUBSCRIPTION_S
        )
        if observers and self._has_room(len(observers)):
            self._push(now_s, payload, observers)
        if position is None:
            self.counters["no_position"] += 1
        elif receivers.addresses:
            self._spread_in_range(sender, address, position, payload, now_s)

    def _spread_in_range(
        self, sender: int, address: Address | None, position: FloatArray, payload: bytes, now_s: float
    ) -> None:
        receivers, where = self.listeners.receivers, self.listeners.places()
        listening = (receivers.system_id != sender) & (now_s - receivers.heard_s <= SUBSCRIPTION_S)
        if address is not None and address in receivers.rows:
            listening[receivers.rows[address]] = False
        gap = where - position
        distance_m = np.sqrt(np.einsum("ij,ij->i", gap, gap))
        distance_m[np.isinf(distance_m)] = 0.0
        heard = listening & (distance_m <= self.range_m)
        self.counters["out_of_range"] += int(np.count_nonzero(listening)) - int(np.count_nonzero(heard))
        # both numbers are always drawn, so that the latencies do not depend on the loss
        arrives, late = reception_chances(self._seed, sender, self._sends[sender], receivers.system_id)
        kept = heard & (arrives < self._arriving_share(distance_m, now_s))
        rows = np.flatnonzero(kept)
        self.counters["lost"] += int(np.count_nonzero(heard)) - len(rows)
        if not self._has_room(len(rows)):
            return
        shortest, longest = self.technology.latency_s
        if longest == 0.0:
            self._push(now_s, payload, tuple(receivers.addresses[row] for row in rows.tolist()))
            return
        arrival_s = now_s + shortest + late[rows] * (longest - shortest)
        for row, at_s in zip(rows.tolist(), arrival_s.tolist(), strict=True):
            self._push(at_s, payload, (receivers.addresses[row],))

    def _arriving_share(self, distance_m: FloatArray, now_s: float) -> FloatArray | float:
        """Share of receptions of this broadcast without fading or collision, shape (m,)."""
        if self._loss is not None:
            return 1.0 - self._loss
        share = self.technology.link_share(np.minimum(distance_m, self.range_m), self.range_m)
        if self.technology.crowding > 0.0:
            share = share * self.technology.collision_share(self._senders_around(now_s))
        return share

    def _senders_around(self, now_s: float) -> FloatArray:
        """Other senders in range of each receiver, shape (m,), without this one and its own vehicle; updated each
        second."""
        receivers = self.listeners.receivers
        if self._crowd is None or self._crowd_of is not receivers or now_s - self._crowd_s >= CROWD_S:
            patience_s = SENDING_PERIODS * max(self.technology.period_s, 1.0)
            self._sent_from = {key: sent for key, sent in self._sent_from.items() if now_s - sent[0] <= patience_s}
            senders = np.array([position for _, position in self._sent_from.values()]).reshape(-1, 3)
            gap = np.linalg.norm(self.listeners.places()[:, None] - senders[None, :], axis=2)
            is_another = receivers.system_id[:, None] != np.array(list(self._sent_from), dtype=np.int64)
            in_range = np.count_nonzero(is_another & (gap <= self.range_m), axis=1)
            self._crowd = np.maximum(in_range - 1.0, 0.0)
            self._crowd_s, self._crowd_of = now_s, receivers
        return self._crowd

    def _has_room(self, count: int) -> bool:
        """Whether this many more may be under way; if so, they are counted."""
        if self._waiting + count > MAX_UNDELIVERED:
            self.counters["overflow"] += count
            return False
        self._waiting += count
        self.counters["delivered"] += count
        return count > 0

    def _push(self, at_s: float, payload: bytes, addresses: tuple[Address, ...]) -> None:
        self._sent += 1
        heapq.heappush(self._under_way, (at_s, self._sent, payload, addresses))

    # --- bytes out ----------------------------------------------------------------------------------------------------

    def due(self, now_s: float) -> list[tuple[bytes, Address]]:
        """Datagrams that have arrived by now, in order of arrival."""
        arrived: list[tuple[bytes, Address]] = []
        while self._under_way and self._under_way[0][0] <= now_s:
            _, _, payload, addresses = heapq.heappop(self._under_way)
            arrived += [(payload, address) for address in addresses]
        self._waiting -= len(arrived)
        return arrived

    def next_due_s(self) -> float | None:
        """Time of the next arrival; None if nothing is under way."""
        return self._under_way[0][0] if self._under_way else None


_HEARTBEAT = message_spec("HEARTBEAT").msgid
_LOCATION = message_spec("OPEN_DRONE_ID_LOCATION").msgid
