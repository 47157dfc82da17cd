"""One row for each update of each aircraft: LOCATION, with the SEPARATION of the same instant, and the last BASIC_ID
and SYSTEM of the same sender. In the 25-byte form, a SEPARATION has its time in whole seconds.

An aircraft that is heard over several transports (MAVLink, Wi-Fi, Bluetooth) sends the same data several times:
messages with the same identity, position and sender time make one row, which names all transports. A position without a
time makes no row if it follows one with a time from the same sender within a second of log time, as from an autopilot
beside its transmitter. Rows are in the order of time. They are two seconds of log time late, since a duplicate or a
SEPARATION may follow, or seven if the identity is not known yet, since identities are sent once in three seconds.
Memory is bounded, whatever senders do.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from ridlink.captures.export.fields import Fields
from ridlink.captures.lines import si_fields
from ridlink.remote_id.assembler import EQUAL_TIMESTAMP_VALID_S
from ridlink.remote_id.bridge import whole_seconds_of
from ridlink.remote_id.location import TIMESTAMP_STEP_S
from ridlink.remote_id.messages import ID_TYPE_NONE, ID_TYPE_SERIAL_NUMBER, Authentication
from ridlink.remote_id.separation import separation_of

BASIC_ID, LOCATION, SYSTEM, SEPARATION, AUTHENTICATION = JOINED_NAMES = (
    "OPEN_DRONE_ID_BASIC_ID", "OPEN_DRONE_ID_LOCATION", "OPEN_DRONE_ID_SYSTEM", "RIDLINK_SEPARATION",
    "OPEN_DRONE_ID_AUTHENTICATION",
)  # fmt: skip
"""The messages that are joined; stock receivers relay SEPARATION as AUTHENTICATION."""

MAVLINK = "mavlink"
"""Transport of messages in MAVLink frames, if the capture does not say more."""

HOLD_US = 2_000_000
UNIDENTIFIED_HOLD_US = 7_000_000
UNTIMED_US = 1_000_000
"""Within this time after a position with a time, a position without a time from the same sender is no update."""

VALID_US = int(EQUAL_TIMESTAMP_VALID_S * 1e6)
MAX_SENDERS = 2_000
MAX_HELD_ROWS = 20_000
UPDATES_REMEMBERED = 16

COLUMNS: dict[str, str] = {
    "t": "time", "uas_id": "text", "id_type": "integer", "ua_type": "integer", "sources": "text",
    "transports": "text", "received": "integer",
    "status": "integer", "direction_deg": "number", "speed_horizontal_mps": "number", "speed_vertical_mps": "number",
    "latitude_deg": "number", "longitude_deg": "number", "altitude_barometric_m": "number",
    "altitude_geodetic_m": "number", "height_m": "number", "height_reference": "integer",
    "horizontal_accuracy": "integer", "vertical_accuracy": "integer", "barometer_accuracy": "integer",
    "speed_accuracy": "integer", "horizontal_accuracy_m": "number", "vertical_accuracy_m": "number",
    "barometer_accuracy_m": "number", "speed_accuracy_mps": "number", "timestamp_s": "number",
    "timestamp_accuracy_s": "number",
    "horizontal_error_m": "number", "vertical_error_m": "number", "velocity_error_mps": "number",
    "airframe_size_m": "number", "airframe_height_m": "number", "update_interval_s": "number",
    "commanded_vx_mps": "number", "commanded_vy_mps": "number", "commanded_vz_mps": "number", "flags": "integer",
    "operator_location_type": "integer", "classification_type": "integer", "operator_latitude_deg": "number",
    "operator_longitude_deg": "number", "operator_altitude_geo_m": "number", "area_count": "integer",
    "area_radius_m": "number", "area_ceiling_m": "number", "area_floor_m": "number", "category_eu": "integer",
    "class_eu": "integer", "system_timestamp_s": "number", "id_or_mac": "text",
}  # fmt: skip
"""Columns of a joined row and their contents; ``t`` is microseconds since 1970."""


@dataclass(slots=True)
class _Sender:
    """The last messages of one sender over one transport."""

    key: tuple[str, str, str | None]
    id_type: int = ID_TYPE_NONE
    uas_id: str | None = None
    ua_type: int | None = None
    system: dict[str, Any] = field(default_factory=dict)
    separation: Fields | None = None
    last: _Update | None = None


@dataclass(slots=True)
class _Update:
    """A row that is still open."""

    at_us: int
    row: dict[str, Any]
    sender: _Sender
    sources: list[str]
    transports: list[str]
    has_exact_separation: bool = False


class Joiner:
    """Receives messages in the order of the file and returns rows. A message without a time is of that of the last."""

    def __init__(self) -> None:
        self._senders: OrderedDict[tuple[str, str, str | None], _Sender] = OrderedDict()
        self._updates: OrderedDict[Any, deque[_Update]] = OrderedDict()
        self._held: deque[_Update] = deque()
        self._now_us = 0

    def receive(self, message: Fields) -> Iterator[dict[str, Any]]:
        """Receive one message; returns the rows that are complete now."""
        message = _recognised(message)
        fields = message.fields
        now_us = self._now_us = self._now_us if message.time_us is None else message.time_us
        if message.name == LOCATION:
            self._locate(self._sender(message), message, now_us)
        elif message.name == SEPARATION:
            sender = self._sender(message)
            sender.separation = message._replace(time_us=now_us)
            if sender.last is not None:
                _add(sender.last, sender.separation)
        elif message.name == BASIC_ID:
            self._identify(self._sender(message), fields)
        elif message.name == SYSTEM:
            self._sender(message).system = fields
        while self._held and (
            abs(now_us - self._held[0].at_us) > _patience_us(self._held[0].sender)
            or len(self._held) > MAX_HELD_ROWS
            or (self._held[0].row["t"] is None and len(self._held) > UPDATES_REMEMBERED)
        ):
            yield _finished(self._held.popleft())

    def flush(self) -> Iterator[dict[str, Any]]:
        """The remaining rows; call it at the end of the capture."""
        while self._held:
            yield _finished(self._held.popleft())

    def _sender(self, message: Fields) -> _Sender:
        key = (message.transport or MAVLINK, message.source, message.fields.get("id_or_mac"))
        sender = self._senders.get(key)
        if sender is None:
            sender = self._senders[key] = _Sender(key)
            if len(self._senders) > MAX_SENDERS:
                self._senders.popitem(last=False)
        else:
            self._senders.move_to_end(key)
        return sender

    @staticmethod
    def _identify(sender: _Sender, fields: dict[str, Any]) -> None:
        if fields["ua_type"]:
            sender.ua_type = fields["ua_type"]
        if fields["id_type"] == ID_TYPE_NONE or not fields["uas_id"]:
            return
        # a sender that alternates serial number and registration is one aircraft
        if fields["id_type"] == ID_TYPE_SERIAL_NUMBER or sender.id_type != ID_TYPE_SERIAL_NUMBER:
            sender.id_type, sender.uas_id = fields["id_type"], fields["uas_id"]

    def _locate(self, sender: _Sender, message: Fields, now_us: int) -> None:
        transport = sender.key[0]
        aircraft = sender.key if sender.uas_id is None else sender.uas_id
        updates = self._updates.get(aircraft)
        if updates is None:
            updates = self._updates[aircraft] = deque(maxlen=UPDATES_REMEMBERED)
            if len(self._updates) > MAX_SENDERS:
                self._updates.popitem(last=False)
        else:
            self._updates.move_to_end(aircraft)
        for update in reversed(updates):
            if _is_same(update, message.fields, sender, now_us):
                update.row["received"] += 1
                if update.row["timestamp_s"] is None:
                    update.row.update({name: value for name, value in message.fields.items() if value is not None})
                if message.source not in update.sources:
                    update.sources.append(message.source)
                if transport not in update.transports:
                    update.transports.append(transport)
                sender.last = update
                _add(update, sender.separation)
                return
        row: dict[str, Any] = dict.fromkeys(COLUMNS)
        row.update(message.fields)
        row["t"], row["received"] = message.time_us, 1
        update = _Update(now_us, row, sender, [message.source], [transport])
        _add(update, sender.separation)
        updates.append(update)
        self._held.append(update)
        sender.last = update


def _recognised(message: Fields) -> Fields:
    """The RIDLINK_SEPARATION in an AUTHENTICATION that a stock receiver relayed unread; any other message as it is."""
    if message.name != AUTHENTICATION:
        return message
    said = message.fields | {"authentication_data": bytes.fromhex(message.fields["authentication_data"])}
    separation = separation_of(Authentication(**said | {"id_or_mac": None}))
    if separation is None:
        return message
    fields = si_fields(separation) | {"id_or_mac": message.fields["id_or_mac"]}
    return message._replace(name=SEPARATION, fields=fields, is_25_bytes=True)


def _belongs(separation: Fields, update: _Update) -> bool:
    """Whether both describe the same instant, as far as their times say."""
    separation_s, location_s = separation.fields["timestamp_s"], update.row["timestamp_s"]
    if separation.is_25_bytes:
        is_same = separation_s is None or (location_s is not None and separation_s in whole_seconds_of(location_s))
    else:
        is_same = separation_s == location_s
    apart_us = abs((separation.time_us or 0) - update.at_us)
    return is_same and apart_us < (HOLD_US if separation_s is None else VALID_US)


def _patience_us(sender: _Sender) -> int:
    return UNIDENTIFIED_HOLD_US if sender.uas_id is None else HOLD_US


def _is_same(update: _Update, fields: dict[str, Any], sender: _Sender, now_us: int) -> bool:
    row, transport = update.row, sender.key[0]
    if fields["latitude_deg"] is None or abs(now_us - update.at_us) >= VALID_US:
        return False
    is_timed = fields["timestamp_s"] is not None
    is_beside = update.sender is sender and row["t"] is not None and abs(now_us - update.at_us) < UNTIMED_US
    if row["timestamp_s"] is not None and not is_timed:
        return is_beside
    if (row["latitude_deg"], row["longitude_deg"]) != (fields["latitude_deg"], fields["longitude_deg"]):
        return False
    if row["timestamp_s"] is None:
        return is_timed and is_beside
    apart_s = abs(row["timestamp_s"] - fields["timestamp_s"])  # less than one step over another transport
    return apart_s == 0.0 or (transport not in update.transports and apart_s < TIMESTAMP_STEP_S - 1e-3)


def _add(update: _Update, separation: Fields | None) -> None:
    """Complete a row with its SEPARATION; values of the coarser 25-byte form do not replace better ones."""
    if separation is None or not _belongs(separation, update):
        return
    if separation.is_25_bytes and update.has_exact_separation:
        return
    update.has_exact_separation = not separation.is_25_bytes
    said = separation.fields.items()
    update.row.update({name: value for name, value in said if name not in ("timestamp_s", "id_or_mac")})


def _finished(update: _Update) -> dict[str, Any]:
    row, sender = update.row, update.sender
    system = {name: value for name, value in sender.system.items() if name not in ("timestamp_s", "id_or_mac")}
    row.update(system, system_timestamp_s=sender.system.get("timestamp_s"))
    row["uas_id"], row["ua_type"] = sender.uas_id, sender.ua_type
    row["id_type"] = sender.id_type if sender.uas_id is not None else None
    row["sources"], row["transports"] = " ".join(update.sources), " ".join(update.transports)
    return {name: row[name] for name in COLUMNS}


def join(messages: Iterable[Fields]) -> Iterator[dict[str, Any]]:
    """One row for each update of each aircraft, with the keys of `COLUMNS`, in the order of time."""
    joiner = Joiner()
    for message in messages:
        yield from joiner.receive(message)
    yield from joiner.flush()
