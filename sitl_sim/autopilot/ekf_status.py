"""EKF_STATUS_REPORT (193), which only ArduPilot has: not in common.xml, so its layout is written down here.

Source: ardupilotmega.xml; the figures are those of the recorded ArduPilot, whose "variances" are innovation ratios.
"""

from __future__ import annotations

import struct

from ridlink.mavlink.codec import MESSAGES, MessageSpec, message_spec

_RATIOS = ("velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance", "terrain_alt_variance")
_FIELDS, _TYPES = (*_RATIOS, "flags"), (*("float",) * len(_RATIOS), "uint16_t")

EKF_STATUS_REPORT = MessageSpec(
    msgid=193,
    name="EKF_STATUS_REPORT",
    crc_extra=71,
    fields=_FIELDS,
    types=_TYPES,
    array_lengths=(0,) * len(_FIELDS),
    xml_fields=("flags", *_RATIOS),
    units={},
    layout=struct.Struct("<5fH"),
    plain=True,
    zeros=dict.fromkeys(_FIELDS, 0),
    arrays=(),
)

_GOOD, _LOST = 831, 37
"""Flags with a position and without one: the absolute horizontal position is bit 16."""


def ekf_status_fields(*, has_position: bool) -> dict[str, object]:
    """Fields of EKF_STATUS_REPORT; without a position the ratios are 0, which is no good sign."""
    if not has_position:
        return {"flags": _LOST}
    return {"flags": _GOOD, "velocity_variance": 0.005, "pos_horiz_variance": 0.009, "compass_variance": 0.003}


def spec_of(name: str) -> MessageSpec:
    """Layout of a message that an autopilot sends."""
    return EKF_STATUS_REPORT if name == EKF_STATUS_REPORT.name else message_spec(name)


def name_of(msgid: int) -> str | None:
    """Name of a message; None if neither the dialect nor this module has it."""
    spec = EKF_STATUS_REPORT if msgid == EKF_STATUS_REPORT.msgid else MESSAGES.get(msgid)
    return None if spec is None else spec.name
