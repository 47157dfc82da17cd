"""Message signatures of MAVLink 2: signs frames, and decides which received frames are authentic.

A signed frame ends in 13 bytes: link id, a timestamp of 48 bits in units of 10 us since 2015-01-01, and the first six
bytes of SHA-256 over the key, the frame, and the link id and timestamp. A receiver keeps the last timestamp of every
stream (system, component, link) and accepts only later ones.

A frame changes no state before its signature has been verified, so a forger can neither move a clock nor block a
stream. `MOST_AHEAD` limits how far a valid signature may move our clock.

Source: https://mavlink.io/en/guide/message_signing.html
"""

from __future__ import annotations

import hashlib
import hmac
from collections import OrderedDict
from collections.abc import Mapping
from enum import StrEnum

from ridlink.errors import FrameError
from ridlink.mavlink.crc import checksum
from ridlink.mavlink.frames import HEADER_LENGTH_V2, INCOMPAT_SIGNED, MAGIC_V2, SIGNATURE_LENGTH, Frame

KEY_LENGTH = 32
UNITS_PER_S = 100_000
EPOCH_UTC_S = 1_420_070_400
"""2015-01-01 00:00 UTC, the zero of timestamps."""

LATEST_CLOCK = 2**48 - 2**40
"""In the year 2103. A later clock is not believed, which leaves four months of frames within 48 bits."""

MOST_BEHIND = 60 * UNITS_PER_S
"""How much older than ours the first timestamp of a stream may be: a minute, as in the specification."""

MOST_AHEAD = 600 * UNITS_PER_S
"""How much newer than ours a timestamp may be. The specification has no bound, so one signed frame with a far future
timestamp could stop the link for good. Clocks differ by less than ten minutes."""

MOST_STREAMS = 64
"""Streams remembered; only holders of the key can add one. The stream heard longest ago is forgotten first."""

Stream = tuple[int, int, int]
"""System id, component id, link id."""


class SignatureCause(StrEnum):
    """Reason why a frame was not believed."""

    UNSIGNED = "unsigned"
    WRONG = "signature_wrong"
    REPLAYED = "signature_replayed"
    TOO_OLD = "signature_too_old"
    TOO_NEW = "signature_too_new"


def signing_timestamp(utc_s: float) -> int:
    """The timestamp of a time, in units of 10 us, from 0 to `LATEST_CLOCK`.

    Args:
        utc_s: Seconds since 1970-01-01 UTC.
    """
    return min(LATEST_CLOCK, max(0, int((utc_s - EPOCH_UTC_S) * UNITS_PER_S)))


def signature_of(key: bytes, signed: bytes) -> bytes:
    """The six bytes that sign a frame.

    Args:
        key: Secret key, 32 bytes.
        signed: The frame from its magic byte to its checksum, with link id and timestamp.
    """
    return hashlib.sha256(key + signed).digest()[:6]


class Signing:
    """Signs sent frames and verifies received frames, with one key and one clock.

    Args:
        key: Secret key, 32 bytes.
        link_id: Link id of our own signatures, 0 to 255; each link of a component needs its own.
        timestamp: Earliest value at which the clock starts, as kept from the last run.
        streams: Last timestamps by stream, as kept from the last run.

    Raises:
        ValueError: If the key or the link id has the wrong size.

    Attributes:
        timestamp: The latest timestamp that was sent or believed.
        streams: Last timestamp believed by stream.
    """

    def __init__(
        self, key: bytes, *, link_id: int = 0, timestamp: int = 0, streams: Mapping[Stream, int] | None = None
    ) -> None:
        if len(key) != KEY_LENGTH:
            raise ValueError(f"a signing key has {KEY_LENGTH} bytes, not {len(key)}")
        if not 0 <= link_id <= 255:
            raise ValueError(f"link ids are 0 to 255, not {link_id}")
        self.timestamp = timestamp
        self.streams: OrderedDict[Stream, int] = OrderedDict(streams or {})
        self._key = key
        self._link_id = link_id

    def sign(self, frame: bytes, crc_extra: int, utc_s: float) -> bytes:
        """The same MAVLink 2 frame with a signature whose timestamp is later than all before.

        Args:
            frame: An unsigned MAVLink 2 frame.
            crc_extra: Checksum seed of its message.
            utc_s: Seconds since 1970-01-01 UTC; timestamps do not go back if this clock does.

        Raises:
            FrameError: If the frame is version 1, or signed already.
        """
        if frame[0] != MAGIC_V2 or frame[2] & INCOMPAT_SIGNED:
            part = "magic" if frame[0] != MAGIC_V2 else "incompat_flags"
            raise FrameError("only unsigned MAVLink 2 frames can be signed", part=part)
        self.timestamp = max(signing_timestamp(utc_s), self.timestamp + 1)
        end = HEADER_LENGTH_V2 + frame[1]
        body = bytes((frame[1], frame[2] | INCOMPAT_SIGNED)) + frame[3:end]
        signed = b"\xfd" + body + checksum(body, crc_extra).to_bytes(2, "little")
        signed += bytes((self._link_id,)) + self.timestamp.to_bytes(6, "little")
        return signed + signature_of(self._key, signed)

    def refusal(self, frame: Frame, utc_s: float) -> SignatureCause | None:
        """Why a frame is not believed. None if it is believed; then its timestamp becomes the last of its stream.

        Args:
            frame: A frame as parsed.
            utc_s: Seconds since 1970-01-01 UTC.
        """
        if len(frame.signature) != SIGNATURE_LENGTH:
            return SignatureCause.UNSIGNED
        if not hmac.compare_digest(signature_of(self._key, frame.raw[:-6]), frame.signature[7:]):
            return SignatureCause.WRONG
        stream = (frame.sysid, frame.compid, frame.signature[0])
        timestamp = int.from_bytes(frame.signature[1:7], "little")
        ours = max(signing_timestamp(utc_s), self.timestamp)
        before = self.streams.get(stream)
        if before is not None and timestamp <= before:
            return SignatureCause.REPLAYED
        if before is None and timestamp < ours - MOST_BEHIND:
            return SignatureCause.TOO_OLD
        if timestamp > ours + MOST_AHEAD:
            return SignatureCause.TOO_NEW
        self.streams[stream] = timestamp
        self.streams.move_to_end(stream)
        if len(self.streams) > MOST_STREAMS:
            self.streams.popitem(last=False)
        self.timestamp = max(self.timestamp, timestamp)
        return None
