"""Random numbers that depend only on the event and its participants, not on the order of events.

The losses between a sender and a receiver must not change when others listen, send or run in another process. A
counter-based generator ensures this: each number is a hash of seed, sender, number of the broadcast, and receiver.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
UintArray = npt.NDArray[np.uint64]

_MASK = (1 << 64) - 1
_STEP = 0x9E3779B97F4A7C15
_FIRST, _SECOND = 0xBF58476D1CE4E5B9, 0x94D049BB133111EB


def reception_chances(
    seed: int, sender: int, number: int, receivers: npt.NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """Two independent numbers, uniform in [0, 1), for each receiver of one broadcast.

    Source: the finaliser of SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014).

    Args:
        seed: Seed of the run.
        sender: System id of the sender.
        number: Sequence number of the broadcast.
        receivers: System ids, shape (m,).

    Returns:
        Numbers for the loss and for the latency, shape (m,) each.
    """
    state = 0
    for word in (seed, sender, number):
        state = _mixed((state ^ word) + _STEP)
    keys = receivers.astype(np.uint64) * np.uint64(_STEP) ^ np.uint64(state)
    first = _mixed_array(keys)
    return _unit(first), _unit(_mixed_array(first + np.uint64(_STEP)))


def _mixed(word: int) -> int:
    word &= _MASK
    word = ((word ^ (word >> 30)) * _FIRST) & _MASK
    word = ((word ^ (word >> 27)) * _SECOND) & _MASK
    return word ^ (word >> 31)


def _mixed_array(words: UintArray) -> UintArray:
    words = (words ^ (words >> np.uint64(30))) * np.uint64(_FIRST)
    words = (words ^ (words >> np.uint64(27))) * np.uint64(_SECOND)
    return words ^ (words >> np.uint64(31))


def _unit(words: UintArray) -> FloatArray:
    return (words >> np.uint64(11)).astype(np.float64) * 2.0**-53
