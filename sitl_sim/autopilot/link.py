"""The link to one peer of a vehicle: it has its own message rates and sequence numbers, as on a real autopilot."""

from __future__ import annotations

import math

from ridlink.mavlink.codec import Encoder, encode_payload
from ridlink.mavlink.frames import encode_frame
from sitl_sim.autopilot.ekf_status import spec_of

Address = tuple[str, int]

MIN_INTERVAL_S = 0.02
MAX_DATAGRAM = 1200
"""Messages that are due together share a datagram up to this size; the buffer of MAVSDK has 2048 bytes."""


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

    def interval_s(self, name: str) -> float | None:
        """Interval of a message [s]; None if it is not sent."""
        return self._interval_s.get(name)

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
        spec, encoder = spec_of(name), self._encoder
        encoder.seq = (encoder.seq + 1) & 0xFF
        return encode_frame(
            spec.msgid, payload, spec.crc_extra, seq=encoder.seq, sysid=encoder.sysid, compid=encoder.compid
        )

    def message(self, name: str, fields: dict[str, object]) -> bytes:
        """One frame from the fields of its message."""
        return self.frame(name, encode_payload(spec_of(name), fields))


def packed(frames: list[bytes]) -> list[bytes]:
    """Frames joined into datagrams of at most ``MAX_DATAGRAM`` bytes, in order."""
    datagrams: list[bytes] = []
    for frame in frames:
        if datagrams and len(datagrams[-1]) + len(frame) <= MAX_DATAGRAM:
            datagrams[-1] += frame
        else:
            datagrams.append(frame)
    return datagrams
