"""Identities that own-ship and its neighbours know of each other alike."""

from __future__ import annotations

from collections.abc import Sequence
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance.priority import NOBODY
from ridlink.traffic.track import Track

Identity = tuple[int, bytes | None]
"""System id and identity in Remote ID, None if that is not known."""


def greater(own: Identity, track: Track) -> bool | None:
    """Whether the own identity is the greater one: of system ids, or of bytes if a receiver relays the neighbour.

    None if they cannot be told apart.
    """
    own_sysid, own_uas_id = own
    _, sysid, _, id_or_mac, _ = track.key
    if id_or_mac is None:
        return None if own_sysid == sysid else own_sysid > sysid
    other = track.report.uas_id
    if own_uas_id is None or other is None or own_uas_id.rstrip(b"\0") == other.rstrip(b"\0"):
        return None
    return own_uas_id.rstrip(b"\0") > other.rstrip(b"\0")


def places(own: Identity, tracks: Sequence[Track]) -> tuple[int, NDArray[np.int64]] | None:
    """Numbers that put own-ship and its neighbours into one order, the same for all of them.

    If all are heard directly, these are the system ids, otherwise checksums of the identities in Remote ID: the bytes
    begin with the manufacturer, which should not decide. NOBODY for a neighbour that has not told its identity yet.

    Returns:
        The own number and theirs, shape (n,); None if the own one is not known.
    """
    sysid, uas_id = own
    if all(track.key[3] is None for track in tracks):
        return sysid, np.array([track.key[1] for track in tracks], np.int64)
    if uas_id is None:
        return None
    told = [track.report.uas_id for track in tracks]
    return _number(uas_id), np.array([NOBODY if each is None else _number(each) for each in told], np.int64)


def _number(uas_id: bytes) -> int:
    return crc32(uas_id.rstrip(b"\0"))
