"""The air: one broadcast medium, sans-IO. (interface, being filled)"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from ridlink.geodesy import Geodetic

Address = Any  # hashable, e.g. ("127.0.0.1", 50123)


@dataclass(frozen=True, slots=True)
class Technology:
    name: str
    period_s: float  # shortest time between two updates of one sender; broadcasters use max(interval, period_s)
    range_m: float
    latency_s: tuple[float, float]  # uniform between
    loss: float
    source: str


TECHNOLOGIES: dict[str, Technology] = {}  # bt4, bt5, wifi-beacon, wifi-nan, nr-sidelink, ideal


class Air:
    counters: dict[str, int]

    def __init__(
        self,
        technology: str = "ideal",
        *,
        range_m: float | None = None,  # None: the technology's (ideal: 400)
        loss: float | None = None,
        seed: int = 1,
        home: Geodetic | None = None,  # needed to place outside senders by their LOCATION
    ) -> None: ...

    def place_vehicles(self, position_ned_m: npt.ArrayLike, in_air: npt.ArrayLike) -> None:
        """True positions (n, 3) of the emulator's vehicles, system ids 1..n; call once a tick."""

    def receive(self, datagram: bytes, address: Address, now_s: float) -> None:
        """A datagram from the air's socket: HEARTBEATs subscribe their sender, everything else is broadcast. Never raises."""

    def subscribe(self, address: Address, system_id: int, now_s: float) -> None:
        """Hear what vehicle `system_id` would hear for 10 s from now; 255 hears everything."""

    def broadcast(self, sender: int | Address, position_ned_m: npt.ArrayLike | None, payload: bytes, now_s: float) -> None:
        """Sender: system id of an emulated vehicle (position None: as placed), or address of a subscriber."""

    def due(self, now_s: float) -> list[tuple[bytes, Address]]:
        """What is to be delivered by now, in order."""

    def next_due_s(self) -> float | None:
        """When `due` has something next."""

    def expire(self, now_s: float) -> None:
        """Forget subscribers that were silent for 10 s."""
