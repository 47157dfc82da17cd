"""A foreign feed as traffic: converts JSON objects of aircraft to Remote ID frames, as a receiver would relay them.

A broker is not trusted. An item that is no object, or has no identity, no position on Earth or an old one, is counted
and dropped. An identity only names a transmitter behind our relay (``id_or_mac``). Nothing in a feed can be a command.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from typing import Any

import msgspec

from ridlink.mavlink.codec import Encoder
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import STATUS_AIRBORNE, BasicId, Location, RemoteIdMessage, Separation
from ridlink.remote_id.quantities import ID_LENGTH, SECONDS_PER_HOUR
from ridlink.traffic.track import SENDER_AGE_S

RELAY_SYSID, RELAY_COMPID = 254, 236
"""Ids of the relay: an ODID transmitter component (MAV_COMP_ID_ODID_TXRX_1) of a system of its own."""

LONGEST_PAYLOAD = 64 * 1024
MOST_AIRCRAFT_A_MESSAGE = 500
OLD_S = SENDER_AGE_S[1] - 1.0
"""A position of this age is dropped: when it arrives, up to a second later, its timestamp would be taken for that of a
wrong clock, and it for one just measured."""

SERIAL_NUMBER = 1

NAMES: dict[str, tuple[str, ...]] = {
    "identity": ("uas_id", "uas", "id"),
    "latitude_deg": ("latitude_deg", "latitude", "lat"),
    "longitude_deg": ("longitude_deg", "longitude", "lon", "lng"),
    "altitude_geodetic_m": ("altitude_geodetic_m", "alt_ellipsoid"),
    "speed_horizontal_mps": ("speed_horizontal_mps", "speed"),
    "speed_vertical_mps": ("speed_vertical_mps", "vspeed"),
    "direction_deg": ("direction_deg", "direction", "track"),
    "horizontal_error_m": ("horizontal_error_m",),
    "airframe_size_m": ("airframe_size_m",),
}
"""Keys that are read, in the order of preference. An altitude must be above the ellipsoid: ``alt`` does not say above
what, and an unknown altitude is treated as any altitude."""


class Feed:
    """Converts payloads of the feed to frames.

    Attributes:
        counters: Payloads and aircraft by their outcome.
    """

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self._encoder = Encoder(RELAY_SYSID, RELAY_COMPID)

    def frames(self, payload: bytes | bytearray, utc_s: float) -> list[bytes]:
        """The frames of a payload, which is one object, a list of them, or an object with ``states``.

        Args:
            payload: JSON.
            utc_s: Time of arrival, seconds since 1970-01-01 UTC; used for reports without a time.
        """
        if len(payload) > LONGEST_PAYLOAD:
            self.counters["too_long"] += 1
            return []
        try:
            document = msgspec.json.decode(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            self.counters["not_json"] += 1
            return []
        if isinstance(document, dict) and isinstance(document.get("states"), list):
            document = document["states"]
        rows = document if isinstance(document, list) else [document]
        frames: list[bytes] = []
        if len(rows) > MOST_AIRCRAFT_A_MESSAGE:
            self.counters["too_many"] += len(rows) - MOST_AIRCRAFT_A_MESSAGE
        for row in rows[:MOST_AIRCRAFT_A_MESSAGE]:
            frames += self._aircraft(row, utc_s)
        return frames

    def _aircraft(self, row: Any, utc_s: float) -> list[bytes]:
        if not isinstance(row, dict):
            self.counters["not_an_object"] += 1
            return []
        identity = next((row[name] for name in NAMES["identity"] if isinstance(row.get(name), str) and row[name]), None)
        if identity is None:
            self.counters["without_identity"] += 1
            return []
        latitude = _number(row, "latitude_deg", -90.0, 90.0)
        longitude = _number(row, "longitude_deg", -180.0, 180.0)
        if latitude is None or longitude is None or latitude == longitude == 0.0:
            self.counters["without_position"] += 1
            return []
        age_s = row.get("age_s")
        late_s = max(age_s, 0.0) if isinstance(age_s, int | float) else 0.0
        if late_s >= OLD_S:
            self.counters["too_old"] += 1
            return []
        timestamp_s = round((utc_s - late_s) % SECONDS_PER_HOUR, 1) % SECONDS_PER_HOUR
        transmitter = _transmitter(identity)
        raw = identity.encode("utf-8", "replace")[:ID_LENGTH]
        direction = _number(row, "direction_deg", 0.0, 360.0)
        messages: list[RemoteIdMessage] = [
            BasicId(id_type=SERIAL_NUMBER, ua_type=0, uas_id=raw, id_or_mac=transmitter),
            Location(
                status=STATUS_AIRBORNE,
                latitude_deg=latitude,
                longitude_deg=longitude,
                altitude_geodetic_m=_number(row, "altitude_geodetic_m", -999.0, 31_767.0),
                speed_horizontal_mps=_number(row, "speed_horizontal_mps", 0.0, 254.25),
                speed_vertical_mps=_number(row, "speed_vertical_mps", -62.0, 62.0),
                direction_deg=None if direction is None else direction % 360.0,
                timestamp_s=timestamp_s,
                id_or_mac=transmitter,
            ),
        ]
        error, size = _number(row, "horizontal_error_m", 0.0, 650.0), _number(row, "airframe_size_m", 0.1, 30.0)
        if error is not None or size is not None:
            messages.append(
                Separation(
                    timestamp_s=timestamp_s,
                    horizontal_error_m=error,
                    airframe_size_m=size,
                    id_or_mac=transmitter,
                )
            )
        self.counters["aircraft"] += 1
        return [self._frame(message) for message in messages]

    def _frame(self, message: RemoteIdMessage) -> bytes:
        name, fields = to_mavlink(message)
        return self._encoder.encode(name, **fields)


def _transmitter(identity: str) -> bytes:
    """``id_or_mac`` of an identity: always the same 20 bytes for one identity."""
    return hashlib.blake2b(identity.encode("utf-8", "replace"), digest_size=ID_LENGTH).digest()


def _number(row: dict[str, Any], what: str, least: float, most: float) -> float | None:
    """The value of a key if it is a finite number within its range, else None."""
    for name in NAMES[what]:
        value = row.get(name)
        if isinstance(value, int | float) and not isinstance(value, bool) and -math.inf < value < math.inf:
            return float(value) if least <= value <= most else None  # an integer may be too large for a float
    return None
