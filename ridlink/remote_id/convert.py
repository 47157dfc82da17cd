"""Remote ID messages of MAVLink to SI and back; wire sentinels stop here.

Reading: a sentinel becomes ``None``. A field that is out of its range or not finite becomes ``None`` as well, alone,
and is counted under ``MESSAGE.field``: one bad field costs neither the message nor the other fields. Values at the end
of a saturating range ("that or more") are taken as they stand.

Writing: nearest value, but errors, accuracies, sizes and intervals round up, so that an uncertainty is never
understated. What does not fit saturates, an infinite speed or error as well; a place, direction, altitude, time or
commanded velocity that cannot be goes out as unknown, and so does NaN. Since 0 means unknown, an exactly known position
goes out as 1 cm.

Trailing zeros vanish in MAVLink 2, hence a field that is absent reads as 0, and 0 as unknown wherever the table of the
message says so.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from ridlink.mavlink.codec import Message
from ridlink.remote_id import identities, location, separation, system
from ridlink.remote_id.messages import (
    MAVLINK_NAMES,
    Authentication,
    BasicId,
    Location,
    OperatorId,
    RemoteIdMessage,
    SelfId,
    Separation,
    System,
)
from ridlink.remote_id.quantities import FieldRejects, write_id_or_mac

MESSAGE_PACK = "OPEN_DRONE_ID_MESSAGE_PACK"


def from_mavlink(message: Message, rejects: FieldRejects | None = None) -> RemoteIdMessage | None:
    """The Remote ID message in SI units, ``None`` where the message is none of the seven.

    Args:
        message: Decoded MAVLink message.
        rejects: Counts fields that were not taken. A message pack, which may hold several messages, is none of the
            seven and counts as a whole: `ridlink.remote_id.bridge.messages_of` reads it.
    """
    reader = _READERS.get(message.name)
    if reader is None:
        if rejects is not None and message.name == MESSAGE_PACK:
            rejects[MESSAGE_PACK] += 1
        return None
    return reader(message.fields, Counter() if rejects is None else rejects)


def to_mavlink(message: RemoteIdMessage) -> tuple[str, dict[str, Any]]:
    """Name and fields of the MAVLink message, for `ridlink.mavlink.codec.Encoder.encode`; addressed to everybody.

    An accuracy code of 0 whose bound is given is derived from the bound.

    Raises:
        PayloadError: If a byte string is text.
    """
    fields = _WRITERS[type(message)](message)
    fields["target_system"] = fields["target_component"] = 0
    fields["id_or_mac"] = write_id_or_mac(message.id_or_mac)
    return MAVLINK_NAMES[type(message)], fields


_Reader = Callable[[dict[str, Any], FieldRejects], RemoteIdMessage]
_Writer = Callable[[Any], dict[str, Any]]

_FORMS: dict[type, tuple[_Reader, _Writer]] = {
    Location: (location.from_fields, location.to_fields),
    Separation: (separation.from_fields, separation.to_fields),
    BasicId: (identities.basic_id_from_fields, identities.basic_id_to_fields),
    System: (system.from_fields, system.to_fields),
    SelfId: (identities.self_id_from_fields, identities.self_id_to_fields),
    OperatorId: (identities.operator_id_from_fields, identities.operator_id_to_fields),
    Authentication: (identities.authentication_from_fields, identities.authentication_to_fields),
}
_READERS: dict[str, _Reader] = {MAVLINK_NAMES[kind]: read for kind, (read, _) in _FORMS.items()}
_WRITERS: dict[type, _Writer] = {kind: write for kind, (_, write) in _FORMS.items()}
