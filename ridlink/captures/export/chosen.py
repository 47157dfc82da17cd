"""A selection applied to the frames of a block."""

from __future__ import annotations

import numpy as np

from ridlink.captures.export.selection import Selection
from ridlink.captures.fast.blocks import Block
from ridlink.captures.fast.tables import slot_of

_NO_TIME = np.uint64(2**64 - 1)


def chosen_frames(selection: Selection, block: Block) -> np.ndarray | None:
    """Which frames of a block are selected, as an array of truth values; ``None`` for all."""
    if selection.is_everything:
        return None
    keep = np.ones(block.count, np.bool_)
    if selection.names is not None:
        slots = [slot_of()[name] for name in selection.names if name in slot_of()]
        keep &= np.isin(block.slots, np.array(slots, block.slots.dtype))
    if selection.source_system is not None:
        keep &= block.sysids() == selection.source_system
    if selection.since_us is not None or selection.until_us is not None:
        keep &= block.times != _NO_TIME
    if selection.since_us is not None:
        keep &= block.times >= np.uint64(max(selection.since_us, 0))
    if selection.until_us is not None:
        keep &= block.times < np.uint64(max(selection.until_us, 0))
    return keep
