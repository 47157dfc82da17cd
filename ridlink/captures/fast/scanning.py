"""The loops that find frames in the bytes of a file and check them: an index of where each starts.

``scan_raw`` and ``scan_tlog`` take what `ridlink.mavlink.frames` and `ridlink.captures.tlog` take and refuse what they
refuse; those say why, and tests hold them against each other. A frame is an entry of an index: where it starts, its
slot (the place of its message in ``tables.layouts()``) and its time.
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

from typing import Any

import numpy as np

from ridlink.captures.fast.loading import byte_of, checksum, kernel, load
from ridlink.captures.statistics import LEAP
from ridlink.captures.tlog import EARLIEST_TIME_US as _EARLIEST
from ridlink.captures.tlog import LATEST_TIME_US as _LATEST
from ridlink.captures.tlog import LOOKAHEAD, TIME_LENGTH, UNSET_TIME_US
from ridlink.captures.tlog import PLAUSIBLE_STEP_US as _STEP

AT, IN_STEP, HAS_REFERENCE, LAST_CAUSE, LAST_END = range(5)
COUNTS = 8
FIRST = 16
STATE_LENGTH = 24
"""Places in ``state``, which lives as long as the file is read."""

GARBAGE, BAD_CHECKSUM, INCOMPATIBLE, UNCONFIRMED, TRUNCATED, BAD_TIME = range(6)
"""Causes of rejects, in the order of ``tables.CAUSES``."""

MESSAGES, GAPS, LOST, LAST_SEQ, LEAPS = range(5)
SOURCE_LENGTH = 5
"""Places in ``sources``, for each system and component id; the last sequence number is kept plus one."""


def initial_state() -> np.ndarray:
    """The state in which a file begins."""
    state = np.zeros(STATE_LENGTH, np.int64)
    state[LAST_CAUSE] = state[LAST_END] = -1
    state[IN_STEP] = 1
    return state


def no_sources() -> np.ndarray:
    """Empty counts of all sources."""
    return np.zeros(65536 * SOURCE_LENGTH, np.int64)


NO_TIME = np.uint64(UNSET_TIME_US)
"""Time of a frame that has none."""

_EARLIEST_US = np.uint64(_EARLIEST)
_LATEST_US = np.uint64(_LATEST)
_STEP_US = np.uint64(_STEP)


@kernel(forceinline=True)
def msgid_of(data: Any, start: Any) -> Any:
    """Message id of a MAVLink 2 frame."""
    at = np.uint64(start)
    low, high = np.int64(data[at + np.uint64(7)]), np.int64(data[at + np.uint64(9)])
    return low | np.int64(data[at + np.uint64(8)]) << 8 | high << 16


@kernel(forceinline=True)
def time_at(data: Any, at: Any, end: Any) -> Any:
    """The big-endian time at ``at``; what there is of it where the file ends before."""
    if at + TIME_LENGTH <= end:
        at = np.uint64(at)
        return (
            np.uint64(data[at]) << np.uint64(56)
            | np.uint64(data[at + np.uint64(1)]) << np.uint64(48)
            | np.uint64(data[at + np.uint64(2)]) << np.uint64(40)
            | np.uint64(data[at + np.uint64(3)]) << np.uint64(32)
            | np.uint64(data[at + np.uint64(4)]) << np.uint64(24)
            | np.uint64(data[at + np.uint64(5)]) << np.uint64(16)
            | np.uint64(data[at + np.uint64(6)]) << np.uint64(8)
            | np.uint64(data[at + np.uint64(7)])
        )
    value = np.uint64(0)
    for index in range(at, end):
        value = value << np.uint64(8) | np.uint64(data[index])
    return value


@kernel(forceinline=True)
def reject(state: Any, cause: Any, offset: Any, length: Any) -> None:
    """Count bytes that are not taken; without a break from the last of the same cause they are one reject."""
    if cause != state[LAST_CAUSE] or offset != state[LAST_END]:
        if state[COUNTS + cause] == 0:
            state[FIRST + cause] = offset
        state[COUNTS + cause] += 1
        state[LAST_CAUSE] = cause
    state[LAST_END] = offset + length


@kernel(forceinline=True)
def count_source(sources: Any, sysid: Any, compid: Any, seq: Any) -> None:
    """Take the next sequence number of a source; a repeated one is a duplicate, not 255 lost messages."""
    place = (sysid << 8 | compid) * SOURCE_LENGTH
    last = sources[place + LAST_SEQ]
    sources[place + MESSAGES] += 1
    sources[place + LAST_SEQ] = seq + 1
    if last != 0:
        missing = (seq - last) & 255
        if missing != 0 and missing != 255:
            sources[place + GAPS] += 1
            sources[place + LOST] += missing
            sources[place + LEAPS] += missing >= LEAP


@kernel(forceinline=True)
def judge(data: Any, at: Any, payload_end: Any, msgid: Any, ids: Any, table: Any, initial: Any) -> Any:
    """Slot and CRC_EXTRA as ``ids`` has them if the frame checks, 0 if its id is unknown, -1 if it fails."""
    known = ids[msgid] if msgid < len(ids) else 0
    if known == 0:
        return 0
    end = np.uint64(payload_end)
    received = np.int64(data[end]) | np.int64(data[end + np.uint64(1)]) << 8
    if np.int64(checksum(data, at + 1, payload_end, known & 255, table, initial)) != received:
        return -1
    return known


@kernel(forceinline=True)
def ends_with_another(data: Any, start: Any, end: Any, ids: Any, table: Any, initial: Any) -> Any:
    """A frame that checks stands within a frame of an unknown id and ends with it."""
    for at in range(start + 1, end - 7):
        magic = data[at]
        if magic != 0xFD and magic != 0xFE:
            continue
        head = load(data, at)
        if magic == 0xFE:
            payload_end = at + 6 + byte_of(head, 1)
            ends, msgid = payload_end + 2, byte_of(head, 5)
        else:
            flags = byte_of(head, 2)
            if flags & 0xFE:
                continue
            payload_end = at + 10 + byte_of(head, 1)
            ends, msgid = payload_end + 2 + 13 * flags, msgid_of(data, at)
        if ends == end and judge(data, at, payload_end, msgid, ids, table, initial) > 0:
            return True
    return False


@kernel
def scan_raw(
    data: Any, n: Any, base: Any, final: Any, ids: Any, table: Any, initial: Any, state: Any, sources: Any, starts: Any,
    slots: Any, times: Any,
) -> Any:  # fmt: skip
    """Frames of a raw stream, from ``state[AT]`` to ``n`` or to what needs more bytes; how many there are."""
    at = state[AT]
    count = inner_end = 0
    while at < n:
        head = load(data, at)
        magic = byte_of(head, 0)
        cause = -1
        end = at + 1
        if magic == 0xFD:
            flags = byte_of(head, 2)
            if n - at < 10:
                cause = TRUNCATED
            elif flags & 0xFE:
                cause = INCOMPATIBLE
            else:
                payload_end = at + 10 + byte_of(head, 1)
                end = payload_end + 2 + 13 * flags
                msgid = msgid_of(data, at)
                seq, sysid, compid = byte_of(head, 4), byte_of(head, 5), byte_of(head, 6)
        elif magic == 0xFE:
            if n - at < 6:
                cause = TRUNCATED
            else:
                payload_end = at + 6 + byte_of(head, 1)
                end = payload_end + 2
                msgid = byte_of(head, 5)
                seq, sysid, compid = byte_of(head, 2), byte_of(head, 3), byte_of(head, 4)
        else:
            cause = GARBAGE
            while end < n and data[end] != 0xFD and data[end] != 0xFE:
                end += 1
        if cause < 0:
            if end > n:
                cause = TRUNCATED
            else:
                known = judge(data, at, payload_end, msgid, ids, table, initial)
                if known < 0:
                    cause = BAD_CHECKSUM
                elif known == 0:
                    if end == n:
                        if not final:
                            cause = TRUNCATED
                    elif data[end] != 0xFD and data[end] != 0xFE:
                        cause = UNCONFIRMED
                    if cause < 0 and (end == inner_end or ends_with_another(data, at, end, ids, table, initial)):
                        cause = UNCONFIRMED
                        inner_end = end
        if cause < 0:
            starts[count] = at
            slots[count] = known >> 8
            times[count] = NO_TIME
            count += 1
            count_source(sources, sysid, compid, seq)
            at = end
        elif cause == TRUNCATED and not final:
            break
        else:
            if cause != GARBAGE:
                end = at + 1
            reject(state, cause, base + at, end - at)
            at = end
    state[AT] = at
    return count


@kernel(forceinline=True)
def is_near(time_us: Any, reference_us: Any) -> Any:
    """Within three days of each other."""
    if time_us > reference_us:
        return time_us - reference_us <= _STEP_US
    return reference_us - time_us <= _STEP_US


@kernel
def scan_tlog(
    data: Any, n: Any, base: Any, final: Any, ids: Any, table: Any, initial: Any, state: Any, sources: Any, starts: Any,
    slots: Any, times: Any, reference: Any,
) -> Any:  # fmt: skip
    """Records of a tlog, from ``state[AT]`` to ``n`` or to where a record needs more bytes; how many there are.

    ``reference`` holds the last plausible time. Of a frame, its start is that of its magic byte.
    """
    at = state[AT]
    in_step = state[IN_STEP] != 0
    has_reference = state[HAS_REFERENCE] != 0
    reference_us = np.uint64(reference[0])
    count = 0
    last = n if final else n - LOOKAHEAD + 1
    while at < last:
        time_us = time_at(data, at, n)
        near = has_reference and is_near(time_us, reference_us)
        start = at + TIME_LENGTH
        head = load(data, start)
        cause = -1
        end = at
        if n < start + 6:
            cause = TRUNCATED
        elif byte_of(head, 0) == 0xFD:
            flags = byte_of(head, 2)
            payload_end = start + 10 + byte_of(head, 1)
            end = payload_end + 2 + 13 * (flags & 1)
            if end > n:
                cause = TRUNCATED
            elif flags & 0xFE:
                cause = INCOMPATIBLE
            else:
                msgid = msgid_of(data, start)
                seq, sysid, compid = byte_of(head, 4), byte_of(head, 5), byte_of(head, 6)
        elif byte_of(head, 0) == 0xFE:
            payload_end = start + 6 + byte_of(head, 1)
            end = payload_end + 2
            if end > n:
                cause = TRUNCATED
            else:
                msgid = byte_of(head, 5)
                seq, sysid, compid = byte_of(head, 2), byte_of(head, 3), byte_of(head, 4)
        else:
            cause = GARBAGE
        if cause < 0:
            known = judge(data, start, payload_end, msgid, ids, table, initial)
            if known < 0:
                cause = BAD_CHECKSUM
        plausible = near
        if cause < 0:
            if not near:  # a time far from the last one stands if the next agrees; the first, if it is of this century
                if end + TIME_LENGTH <= n and is_near(time_us, time_at(data, end, n)):
                    plausible = True
                elif not has_reference:
                    plausible = end >= n or (time_us >= _EARLIEST_US and time_us <= _LATEST_US)
            if known == 0 and end != n:
                magic_at = end + TIME_LENGTH
                if (
                    magic_at >= n
                    or (data[magic_at] != 0xFD and data[magic_at] != 0xFE)
                    or (has_reference and not is_near(time_at(data, end, n), reference_us))
                ):
                    cause = UNCONFIRMED
            if cause < 0 and not plausible and not in_step:
                cause = GARBAGE
        if cause < 0:
            if plausible:
                reference_us = time_us
                has_reference = True
                times[count] = time_us
            else:
                reject(state, BAD_TIME, base + at, TIME_LENGTH)
                times[count] = NO_TIME
            starts[count] = start
            slots[count] = known >> 8
            count += 1
            count_source(sources, sysid, compid, seq)
            at = end
            in_step = True
            continue
        if in_step or (near and cause != GARBAGE):
            reject(state, cause, base + at, 1)
        in_step = False
        resume = at + 1 + TIME_LENGTH
        while resume < n and data[resume] != 0xFD and data[resume] != 0xFE:
            resume += 1
        at = n if final and resume >= n else max(at + 1, min(resume, n) - TIME_LENGTH)
    state[AT] = at
    state[IN_STEP] = in_step
    state[HAS_REFERENCE] = has_reference
    reference[0] = reference_us
    return count
