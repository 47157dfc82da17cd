"""Remote ID messages of MAVLink to SI and back; wire sentinels stop here.

Reading: a sentinel becomes ``None``. A field that is out of its range or not finite also becomes ``None`` and is
counted under ``MESSAGE.field``; the message and its other fields are still read. Values at the end of a saturating
range ("that or more") are read unchanged.

Writing: values are rounded to the nearest unit. Errors, accuracies, sizes and intervals are rounded up, so that an
uncertainty is never understated. A value that does not fit saturates, also an infinite speed or error. An impossible
position, direction, altitude, time or commanded velocity is sent as unknown, and so is NaN. Since 0 means unknown, the
error of an exactly known position is sent as 1 cm.

MAVLink 2 cuts off trailing zeros. So an absent field reads as 0, and 0 as unknown if the table of the message says so.
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
    """The Remote ID message in SI units, ``None`` if the MAVLink message is none of the seven.

    Args:
        message: Decoded MAVLink message. A message pack may hold several messages and is none of the seven:
            `ridlink.remote_id.bridge.messages_of` reads it.
        rejects: Counts fields that were not taken, and message packs.
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
