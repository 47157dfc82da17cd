"""MCAP files for Foxglove and PlotJuggler, with all messages in JSON.

Each position of an aircraft is a ``foxglove.LocationFix`` under ``/remote_id/NAME/fix``, which a map panel can show;
every message is under ``/mavlink/SYSTEM/COMPONENT/NAME``. Topics keep letters, digits, ``-`` and ``_`` of a name.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterable
from typing import Any, BinaryIO

import msgspec

from ridlink.captures.export.fields import Fields
from ridlink.captures.export.geo import MAPPED_NAMES, positions
from ridlink.captures.export.join import MAVLINK
from ridlink.captures.export.tracks import Position
from ridlink.errors import MissingExtraError

LOCATION_FIX = "foxglove.LocationFix"
COVARIANCE_UNKNOWN, COVARIANCE_DIAGONAL = 0, 2
_NUMBER = {"type": "number"}
_LOCATION_FIX_SCHEMA = {
    "title": LOCATION_FIX,
    "description": "A navigation satellite fix for any Global Navigation Satellite System",
    "type": "object",
    "properties": {
        "timestamp": {
            "type": "object",
            "title": "time",
            "properties": {"sec": {"type": "integer", "minimum": 0}, "nsec": {"type": "integer", "minimum": 0}},
        },
        "frame_id": {"type": "string"},
        "latitude": _NUMBER,
        "longitude": _NUMBER,
        "altitude": _NUMBER,
        "position_covariance": {"type": "array", "items": _NUMBER, "minItems": 9, "maxItems": 9},
        "position_covariance_type": {"type": "integer"},
    },
}
_encode = msgspec.json.Encoder().encode


def write_mcap(messages: Iterable[Fields], out: BinaryIO) -> int:
    """Writes all messages, and the fixes made from them; returns the number of messages.

    Raises:
        MissingExtraError: If mcap is not installed.
    """
    try:
        writer_module = importlib.import_module("mcap.writer")
    except ImportError as error:
        raise MissingExtraError("export", "MCAP") from error
    writer = writer_module.Writer(out)
    writer.start(profile="", library="ridlink")
    file = _File(writer)
    count = 0

    def tee() -> Iterable[Fields]:
        nonlocal count
        for message in messages:
            count += 1
            topic = f"/{message.transport or MAVLINK}/{message.source}/{message.name}"
            file.write(topic, message.name, {"type": "object"}, message.time_us, message.fields)
            if message.name in MAPPED_NAMES:
                yield message

    for position in positions(tee(), telemetry=True):
        topic = f"/remote_id/{position.track}/fix"
        file.write(topic, LOCATION_FIX, _LOCATION_FIX_SCHEMA, position.time_us, _fix(position))
    writer.finish()
    return count


def _fix(position: Position) -> dict[str, Any]:
    seconds, micros = divmod(position.time_us or 0, 1_000_000)
    error_m = position.about.get("horizontal_error_m")
    variance = 0.0 if error_m is None else (error_m / 3.0) ** 2
    return {
        "timestamp": {"sec": seconds, "nsec": micros * 1000},
        "frame_id": "",
        "latitude": position.latitude_deg,
        "longitude": position.longitude_deg,
        "altitude": 0.0 if position.altitude_m is None else position.altitude_m,
        "position_covariance": [variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, 0.0],
        "position_covariance_type": COVARIANCE_UNKNOWN if error_m is None else COVARIANCE_DIAGONAL,
    }


class _File:
    """Schemas and channels, registered when they are first needed."""

    def __init__(self, writer: Any) -> None:
        self._writer = writer
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._last_us = 0

    def write(self, topic: str, schema: str, definition: dict[str, Any], time_us: int | None, message: Any) -> None:
        """Add one message; a message without a time gets the previous time."""
        channel = self._channels.get(topic)
        if channel is None:
            if schema not in self._schemas:
                name = schema if schema == LOCATION_FIX else f"mavlink.{schema}"
                self._schemas[schema] = self._writer.register_schema(name, "jsonschema", _encode(definition))
            inert = "/".join(re.sub(r"[^A-Za-z0-9_-]", "_", part) for part in topic.split("/"))
            channel = self._channels[topic] = self._writer.register_channel(inert, "json", self._schemas[schema])
        self._last_us = self._last_us if time_us is None else time_us
        nanoseconds = min(self._last_us * 1000, 2**64 - 1)
        self._writer.add_message(channel, nanoseconds, _encode(message), nanoseconds)
