"""The UDP socket of the air: subscribers there receive what the radio model lets through.

A vehicle with a receiver on board gets the same over its own bus.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ridlink.links import Link
from sitl_sim.bus import BusReceiver
from sitl_sim.clock import FleetClock
from sitl_sim.radio import Air

Address = tuple[str, int]

MIN_DELIVERY_S = 0.005
"""Shortest time between two batches of delivered broadcasts."""

MAX_AIR_DATAGRAM = 1200
"""Broadcasts that reach a receiver together share a datagram up to this size; a wake-up of a daemon costs more than the
frames of the datagram."""


@dataclass(frozen=True, slots=True)
class BusAddress:
    """Address of a receiver on board, among the subscribers of the air."""

    index: int


class AirSocket:
    """The air on the network.

    Args:
        air: The broadcast medium.
        clock: The fleet's time.
        buses: Number of vehicles, from the first on, with a receiver on board.
        relay: Called with the index of such a vehicle and the frames of its receiver.
        note_failure: Called after a failure, with its place.
    """

    def __init__(
        self,
        air: Air,
        clock: FleetClock,
        *,
        buses: int,
        relay: Callable[[int, bytes], None],
        note_failure: Callable[[str], None],
    ) -> None:
        self._air, self._clock, self._relay, self._note_failure = air, clock, relay, note_failure
        self._buses = [BusReceiver(index + 1) for index in range(buses)]
        self._link: Link | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._delivery_handle: asyncio.TimerHandle | None = None

    def attach(self, link: Link) -> None:
        """Send through this link; the datagrams that it receives go to `receive`."""
        self._link = link

    @property
    def port(self) -> int | None:
        """The port as bound; None before."""
        return None if self._link is None else self._link.local_address[1]

    def run(self) -> None:
        """From now on deliver broadcasts when they arrive, not only on request."""
        self._loop = asyncio.get_running_loop()

    def rest(self) -> None:
        """Deliver only on request."""
        self._loop = None
        if self._delivery_handle is not None:
            self._delivery_handle.cancel()
            self._delivery_handle = None

    def close(self) -> None:
        """Release the port."""
        if self._link is not None:
            self._link.close()

    def refresh(self, now_s: float) -> None:
        """Renew the subscriptions of receivers on board; subscriptions of silent addresses expire."""
        for index in range(len(self._buses)):
            self._air.listeners.subscribe(BusAddress(index), index + 1, now_s)
        self._air.listeners.expire(now_s)

    def receive(self, datagram: bytes, address: Address) -> None:
        """Receive a datagram of a transmitter, or of a receiver that subscribes."""
        try:
            self._air.receive(datagram, address, self._clock.now_s())
            self.deliver()
        except Exception:
            self._note_failure("air")

    def deliver(self) -> None:
        """Deliver broadcasts that have arrived by now, and call again when the next one arrives."""
        assert self._link is not None
        heard: dict[Any, bytes] = {}
        for broadcast, address in self._air.due(self._clock.now_s()):
            if isinstance(address, BusAddress):
                self._relay(address.index, b"".join(self._buses[address.index].deliver(broadcast)))
                continue
            joined = heard.get(address, b"") + broadcast
            if len(joined) > MAX_AIR_DATAGRAM and address in heard:
                self._link.send(heard[address], address)  # type: ignore[arg-type]
                joined = broadcast
            heard[address] = joined
        for address, datagram in heard.items():
            self._link.send(datagram, address)
        next_s = None if self._clock.is_lockstep else self._air.next_due_s()
        if next_s is not None and self._delivery_handle is None and self._loop is not None:
            self._delivery_handle = self._loop.call_at(
                max(self._clock.real_of(next_s), self._loop.time() + MIN_DELIVERY_S), self._on_delivery
            )

    def _on_delivery(self) -> None:
        self._delivery_handle = None
        try:
            self.deliver()
        except Exception:
            self._note_failure("air")
