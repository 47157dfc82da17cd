"""The subscribers of the air, and the positions of senders and receivers.

Emulated vehicles are at their *true* positions, since these determine radio reception. Any other sender is at the
position of its own OPEN_DRONE_ID_LOCATION, and a relayed aircraft at the position of the relayed message. Positions are
in metres, north-east-down about home.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ridlink.geodesy import Geodetic, ned_from_geodetic
from ridlink.mavlink.codec import decode_message
from ridlink.mavlink.frames import Frame
from ridlink.units import deg_from_dege7

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Address = Hashable

SUBSCRIPTION_S = 10.0
"""Time for which a HEARTBEAT subscribes its sender, and for which the position of a sender without subscription is
kept."""

OBSERVER_SYSTEM_ID = 255
"""System id that receives everything: ground stations use it."""

MAX_SUBSCRIBERS = 1024
"""More addresses than this are refused, so that a flood of them cannot fill the memory."""

MAX_PLACES = 4096
"""Limit of stored positions of senders and relayed aircraft, for the same reason."""

_UNKNOWN_ALTITUDE_M = -1000.0


@dataclass(slots=True)
class _Subscriber:
    system_id: int
    heard_s: float


@dataclass(frozen=True, slots=True)
class _Place:
    position_ned_m: FloatArray
    said_s: float


@dataclass(slots=True)
class Receivers:
    """Columns of the subscribers that hear what is in range, and the observers; rebuilt when one comes or goes."""

    addresses: list[Address]
    rows: dict[Address, int]
    system_id: IntArray
    heard_s: FloatArray
    observers: dict[Address, _Subscriber]

    @classmethod
    def of(cls, subscribers: dict[Address, _Subscriber]) -> Receivers:
        """Build the columns of these subscribers."""
        observers = {at: each for at, each in subscribers.items() if each.system_id == OBSERVER_SYSTEM_ID}
        others = {at: each for at, each in subscribers.items() if at not in observers}
        system_id = np.array([subscriber.system_id for subscriber in others.values()], dtype=np.int64)
        heard_s = np.array([subscriber.heard_s for subscriber in others.values()])
        return cls(list(others), {address: row for row, address in enumerate(others)}, system_id, heard_s, observers)


class Listeners:
    """The subscribers of the air.

    Args:
        home: Origin of the NED frame; without it, subscribers outside the emulator have no position.
        counters: Counts subscribed, refused and expired addresses.
    """

    def __init__(self, home: Geodetic | None, counters: Counter[str]) -> None:
        self._home, self._counters = home, counters
        self._placed: FloatArray = np.empty((0, 3))
        self._reported: dict[tuple[Address, int | bytes], _Place] = {}
        self._subscribers: dict[Address, _Subscriber] = {}
        self._receivers: Receivers | None = None
        self._where: FloatArray | None = None

    def place_vehicles(self, position_ned_m: npt.ArrayLike, on_air: npt.ArrayLike | None = None) -> None:
        """Set the true positions of the emulator's vehicles.

        Args:
            position_ned_m: Shape (n, 3); their system ids are 1 to n.
            on_air: Whether the radio of each vehicle works, shape (n,), by default all: a crashed vehicle neither sends
                nor receives.
        """
        self._placed = np.array(position_ned_m, dtype=np.float64).reshape(-1, 3)
        if on_air is not None:
            self._placed[~np.asarray(on_air, dtype=np.bool_)] = np.nan
        self._where = None

    def subscribe(self, address: Address, system_id: int, now_s: float) -> None:
        """Subscribe an address for 10 s, or keep it subscribed."""
        known = self._subscribers.get(address)
        if known is not None and known.system_id == system_id:
            known.heard_s = now_s
            if self._receivers is not None and address in self._receivers.rows:
                self._receivers.heard_s[self._receivers.rows[address]] = now_s
            return
        if known is None and len(self._subscribers) >= MAX_SUBSCRIBERS:
            self._counters["refused"] += 1
            return
        self._counters["subscribed"] += 1
        self._subscribers[address] = _Subscriber(system_id, now_s)
        self._receivers = None

    def expire(self, now_s: float) -> None:
        """Forget addresses that have been silent for 10 s."""
        for address, subscriber in list(self._subscribers.items()):
            if now_s - subscriber.heard_s > SUBSCRIPTION_S:
                del self._subscribers[address]
                self._receivers = None
                self._counters["expired"] += 1
        for (address, who), place in list(self._reported.items()):
            stays = address in self._subscribers and isinstance(who, int)
            if not stays and now_s - place.said_s > SUBSCRIPTION_S:
                del self._reported[address, who]
                self._where = None

    @property
    def subscribers(self) -> dict[Address, int]:
        """System ids by address."""
        return {address: subscriber.system_id for address, subscriber in self._subscribers.items()}

    def note_position(self, frame: Frame, address: Address, now_s: float) -> None:
        """Store the reported position of a sender; a relayed message sets the position of the relayed aircraft."""
        location = decode_message(frame)
        if self._home is None:
            return
        latitude, longitude = deg_from_dege7(location.latitude), deg_from_dege7(location.longitude)
        unknown = latitude == 0.0 and longitude == 0.0
        if unknown or not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            return
        altitude = location.altitude_geodetic
        if not math.isfinite(altitude) or altitude <= _UNKNOWN_ALTITUDE_M:
            altitude = self._home.altitude_m
        relayed = _relayed(location)
        key = address, frame.sysid if relayed is None else relayed
        if key not in self._reported and len(self._reported) >= MAX_PLACES:
            self._counters["refused"] += 1
            return
        self._reported[key] = _Place(ned_from_geodetic(latitude, longitude, altitude, self._home), now_s)
        if relayed is None:
            self._where = None

    def whereabouts(self, system_id: int, address: Address | None, frame: Frame | None = None) -> FloatArray | None:
        """Position from which a broadcast is sent: that of its sender, else that of the aircraft that it relays.

        Args:
            system_id: System id of the sender.
            address: Address of the sender; None: a vehicle of the emulator.
            frame: The broadcast frame.

        Returns:
            Position, shape (3,), NaN off the air; None if unknown.
        """
        if 1 <= system_id <= len(self._placed):
            return np.asarray(self._placed[system_id - 1])
        place = self._reported.get((address, system_id))
        if place is None and frame is not None and frame.checked:
            relayed = _relayed(decode_message(frame))
            place = None if relayed is None else self._reported.get((address, relayed))
        return None if place is None else place.position_ned_m

    @property
    def receivers(self) -> Receivers:
        """Columns of the subscribers that hear what is in range, and the observers; rebuilt when one came or went."""
        if self._receivers is None:
            self._receivers = Receivers.of(self._subscribers)
            self._where = None
        return self._receivers

    def places(self) -> FloatArray:
        """Positions of the receivers, shape (m, 3): NaN off the air, infinite if unknown."""
        receivers = self.receivers
        if self._where is None:
            where = np.full((len(receivers.addresses), 3), np.nan)
            placed = (receivers.system_id >= 1) & (receivers.system_id <= len(self._placed))
            where[placed] = self._placed[receivers.system_id[placed] - 1]
            for row in np.flatnonzero(~placed).tolist():
                own = self._reported.get((receivers.addresses[row], int(receivers.system_id[row])))
                where[row] = math.inf if own is None else own.position_ned_m
            self._where = where
        return self._where


def _relayed(message: Any) -> bytes | None:
    """``id_or_mac`` of the aircraft that a Remote ID message relays; None if it is the sender's own, or no Remote
    ID."""
    identity = bytes(getattr(message, "id_or_mac", b""))
    return identity if any(identity) else None
