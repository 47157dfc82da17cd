"""The served peers: one link per peer, each with its own rates, and the forwarding of messages between them.

One peer, the companion computer's, is served from the start; up to four others (a conductor, a ground station) are
served from their first message until they have been silent for 10 s. Further peers get answers only.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

from ridlink.mavlink.codec import Encoder, Message
from sitl_sim.autopilot.link import Address, Link
from sitl_sim.autopilot.streams import Streams

AUTOPILOT_COMPONENT = 1
MAX_OTHERS = 4
SILENCE_S = 10.0
MAX_PASSED_ON = 64
"""Limit of frames forwarded between two ticks, so that a flood from one peer does not reach the others."""

_NEVER_PASSED_ON = ("TIMESYNC", "PING")


class Peers:
    """The peers of one vehicle.

    Args:
        system_id: System id of the vehicle.
        companion: Address served from the start; None: only peers that send first.
        streams: Sets the default rates of a new link.
        counters: Counts events by cause: refused_peer, not_passed_on.
    """

    def __init__(self, system_id: int, companion: Address | None, streams: Streams, counters: Counter[str]) -> None:
        self._system_id, self._companion, self._streams, self._counters = system_id, companion, streams, counters
        self._links: dict[Address, Link] = {}
        self._passed_on: list[tuple[Address | None, bytes]] = []

    def __len__(self) -> int:
        return len(self._links)

    def link_to(self, address: Address, now_s: float) -> Link:
        """The link of a peer that sends now; for a peer without a place, a link without streams."""
        link = self._links.get(address)
        if link is None:
            others = len(self._links) - (self._companion in self._links)
            if address == self._companion or others < MAX_OTHERS:
                return self._open(address, math.inf if address == self._companion else now_s, now_s)
            self._counters["refused_peer"] += 1
            return self._link(address, now_s)
        link.heard_s = max(link.heard_s, now_s)
        return link

    def serve_companion(self, now_s: float) -> None:
        """Open the companion's link, if it has none yet."""
        if self._companion is not None and self._companion not in self._links:
            self._open(self._companion, math.inf, now_s)

    def served(self, now_s: float) -> Iterator[Link]:
        """The links of served peers; silent ones are dropped."""
        for link in list(self._links.values()):
            if now_s - link.heard_s > SILENCE_S:
                del self._links[link.address]
            else:
                yield link

    def _open(self, address: Address, heard_s: float, now_s: float) -> Link:
        link = self._links[address] = self._link(address, heard_s)
        self._streams.begin(link, now_s)
        return link

    def _link(self, address: Address, heard_s: float) -> Link:
        return Link(address, Encoder(self._system_id, AUTOPILOT_COMPONENT), heard_s)

    # --- from one to the others ---------------------------------------------------------------------------------------

    def pass_on(self, message: Message, frame: bytes, source: Address) -> None:
        """Forward a frame of a peer to the others with the next tick, unless it is for this autopilot alone."""
        if len(self._links) < 2 or message.name in _NEVER_PASSED_ON:
            return
        targets = message.fields.get("target_system", 0), message.fields.get("target_component", 0)
        if targets != (self._system_id, AUTOPILOT_COMPONENT):
            self.carry(frame, source)

    def carry(self, frames: bytes, source: Address | None = None) -> None:
        """Send bytes to all links except that of their source with the next tick."""
        if len(self._passed_on) >= MAX_PASSED_ON:
            self._counters["not_passed_on"] += 1
        else:
            self._passed_on.append((source, frames))

    def carried(self, link: Link) -> list[bytes]:
        """Frames that are forwarded to a link in this tick."""
        return [frames for source, frames in self._passed_on if source != link.address]

    def end_tick(self) -> None:
        """Clear the forwarded frames, which all links have got."""
        self._passed_on.clear()
