"""The lots of `priority`, for tests that need to know who goes first."""

from __future__ import annotations

from ridlink.avoidance import priority
from ridlink.avoidance.priority import TURN_S
from tests.avoidance.way_in import way_in

lot = way_in(priority.lot)


def turn_of(first: int, *others: int) -> int:
    """A turn of the clock in which one identity goes first of several, and not in the next one."""
    leaders = [min((first, *others), key=lambda each: lot(each, turn)) for turn in range(200)]
    return next(k for k in range(199) if leaders[k] == first != leaders[k + 1])


def clock_in(turn: int) -> float:
    """What the clock says in the middle of a turn [s]."""
    return (turn + 0.5) * TURN_S
