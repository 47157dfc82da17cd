"""Right of way in a jam: priority by identity, as the last resort.

Discs too large to pass each other can hold all vehicles in place for ever, with every half-plane met. If a vehicle,
with others about that avoid, has come no nearer to its goal for as long as it takes to fly round the largest of their
discs, it falls back on an order. All of them know the order from each other's reports and from the clock: for every
TURN_S each identity has a lot, and of those about the one with the least lot goes first. The others follow by identity,
round and round. Each makes way for all before it, and waits at CLEAR_RADII of the disc until they are through.
Half-planes hold as ever, and no disc is shrunk.

Lots need no agreement: vehicles that hear the same traffic at the same time have the same lots, however long they have
waited. If each counted its own turns, two could wait for each other in every turn anew. A vehicle that goes first and
gets somewhere keeps its turn. One that does not, because it is at its goal or cannot, loses it at the end of the turn,
so no vehicle needs to know whether another has arrived. One that gets nowhere even in its own turns leaves the round
for longer and longer, and stays where it is. Own-ship is back to normal when it is nearer to its goal than before, or
when the others are far away. If vehicles cannot pass even one after the other, because others stay in the air at goals
within a disc of the own goal, a vehicle does not arrive.

Axes: north-east, metres, m/s, seconds.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ridlink.avoidance.encounter import EPSILON
from ridlink.avoidance.kernel import kernel, norm
from ridlink.avoidance.rows import AIM, AIM_IS_VELOCITY, CRUISE, EXTRA_TURN, OWN_COLUMNS, POSITION, VELOCITY
from ridlink.avoidance.types import FloatArray, OwnShip, Traffic, checked_pair

PATIENCE_S = 20.0
"""Least patience; by then the turn of a stalled vehicle has long grown to its most, see `ProgressWatch`."""
PROGRESS_S = 0.5
"""Progress is to be nearer to the goal than ever before by this much flight at cruise."""
TURN_S = 15.0
"""A turn of the clock; the vehicle that goes first must get somewhere in it."""
FLYING_SHARE = 0.1
"""It gets somewhere if it moves further than at this share of the own cruise: hovering in wind and noise is motion,
too."""
RETREAT_COSINE = 0.7
"""A vehicle that flies so straight away from own-ship makes way for it, and believes that it is another one's turn."""
LOOKED_AT_S = 1.0
"""Movement longer ago than this, while own-ship was not stalled, does not count."""
NEAR_RADII = 3.0
KEPT_RADII = 4.0
"""Others count within NEAR_RADII of the pair's disc; the vehicle that goes first counts within KEPT_RADII."""
CLEAR_RADII, FAILED_RADII = 1.5, 0.5
"""A vehicle that gives way waits CLEAR_RADII away, and FAILED_RADII more for each of its own turns that led nowhere:
others, too, may lack the room between a disc and a wall."""
PUSH_S = 1.0
"""It makes up for the missing distance in this time, if its cruise speed allows."""
SIDESTEP = 0.6
"""If another vehicle flies at it, it also moves to that one's left, by this share: the other passes on its right."""

MOST_FAILED = 4
"""Own turns without progress that count; from the second on each doubles the patience."""

# Columns of the memory: least distance to the goal, when it was reached, identity that goes first, in which turn of the
# clock, whether from its beginning, how far that vehicle has come in the turn, north and east, until when, and own
# turns without progress.
(BEST, SINCE, FIRST, TURN, WHOLE, COME, UNTIL, FAILED, TURN_COLUMNS) = (0, 1, 2, 3, 4, 5, 7, 8, 9)

NOBODY = -1
"""Identity of a neighbour that has no place in the order."""

NEXT_ROUND = 1e12
"""More than any identity, and small enough that their order is not lost in rounding."""

LOTS, GOLDEN = 2**31 - 1, 1327217885
"""A prime, and its golden section: lots are as good as random, and the same for every vehicle that computes them."""


@kernel(forceinline=True, inner=True)
def place_of(identity, first):  # type: ignore[no-untyped-def]
    """Place of an identity in the order that begins at `first`."""
    return identity if identity >= first else identity + NEXT_ROUND


@kernel(forceinline=True, inner=True)
def lot(identity, turn):  # type: ignore[no-untyped-def]
    """Lot of an identity in a turn; the least lot goes first."""
    mixed = (identity + turn * GOLDEN) % LOTS
    mixed = (mixed * mixed + identity) % LOTS
    return mixed * mixed % LOTS


@kernel(forceinline=True, inner=True)
def distance_to(own, report):  # type: ignore[no-untyped-def]
    """Distance to a neighbour now [m]."""
    north = report[0] + report[2] * report[6] - own[POSITION]
    east = report[1] + report[3] * report[6] - own[POSITION + 1]
    return norm(north, east)


@kernel(forceinline=True, inner=True)
def patience(kept, round_s):  # type: ignore[no-untyped-def]
    """Time without progress [s] after which own-ship falls back on the order, given the time for a way round."""
    return max(PATIENCE_S, round_s) * 2.0 ** max(kept[FAILED] - 1.0, 0.0)


@kernel(inner=True)
def time_round(own, reports, identities, count):  # type: ignore[no-untyped-def]
    """Time [s] to fly once round the largest disc of near neighbours that have a place in the order."""
    largest = 0.0
    for j in range(count):
        ordered = reports[j, 7] != 0.0 and identities[j] >= 0
        if ordered and distance_to(own, reports[j]) <= NEAR_RADII * reports[j, 8]:
            largest = max(largest, reports[j, 8])
    return 2.0 * math.pi * largest / max(own[CRUISE], EPSILON)


@kernel(inner=True)
def choose_first(own, identity, reports, identities, count, now_s, clock_s, kept):  # type: ignore[no-untyped-def]
    """Identity that goes first now; NOBODY if no neighbour is near, or own-ship leaves the round.

    Arguments as in `give_way`.
    """
    turn, first, drawn = math.floor(clock_s / TURN_S), kept[FIRST], identity
    known, alone = first == identity, True
    v_1, v_2 = own[VELOCITY], own[VELOCITY + 1]
    e_1 = e_2 = 0.0
    for j in range(count):
        if reports[j, 7] == 0.0 or identities[j] < 0:
            continue
        away = distance_to(own, reports[j])
        if identities[j] == first and away <= KEPT_RADII * reports[j, 8]:
            known, alone = True, False
            v_1, v_2 = reports[j, 2], reports[j, 3]
            e_1 = (reports[j, 0] + v_1 * reports[j, 6] - own[POSITION]) / max(away, EPSILON)
            e_2 = (reports[j, 1] + v_2 * reports[j, 6] - own[POSITION + 1]) / max(away, EPSILON)
        if away <= NEAR_RADII * reports[j, 8]:
            alone = False
            if lot(identities[j], turn) < lot(drawn, turn):
                drawn = identities[j]
    if alone:
        kept[SINCE] = now_s
        return 1.0 * NOBODY
    passed, kept[UNTIL] = min(now_s - kept[UNTIL], LOOKED_AT_S), now_s
    if known:
        kept[COME], kept[COME + 1] = kept[COME] + v_1 * passed, kept[COME + 1] + v_2 * passed
        if kept[TURN] == turn:
            return first
        way = norm(kept[COME], kept[COME + 1])
        retreats = kept[COME] * e_1 + kept[COME + 1] * e_2 >= RETREAT_COSINE * way
        come = way > FLYING_SHARE * own[CRUISE] * TURN_S and not retreats
        if first == identity and kept[WHOLE] != 0.0 and not come:
            kept[FAILED] = min(kept[FAILED] + 1.0, MOST_FAILED)
            if kept[FAILED] >= 2.0:
                kept[SINCE] = now_s
                return 1.0 * NOBODY
        if come:
            drawn = int(first)
    kept[TURN], kept[WHOLE], kept[COME], kept[COME + 1] = turn, 1.0 if known else 0.0, 0.0, 0.0
    return 1.0 * drawn


@kernel
def give_way(own, identity, reports, identities, count, now_s, clock_s, kept):  # type: ignore[no-untyped-def]
    """Make own-ship, if it gets nowhere, give way to those before it: its aim becomes the velocity to do so.

    Args:
        own: Own row, as in `rows`; if it gives way, AIM, AIM_IS_VELOCITY and EXTRA_TURN are written.
        identity: Number of own-ship, not negative.
        reports: Neighbours, rows as in `packing.pack`, shape (>= count, 10).
        identities: Their numbers, NOBODY for a neighbour that has none, shape (>= count,), int64.
        count: Number of neighbours.
        now_s: Time, which must not go back.
        clock_s: Time of the clock that all share.
        kept: Memory of own-ship, see `new_turns`, shape (TURN_COLUMNS,), written.

    Returns:
        True if it gives way.
    """
    if own[AIM_IS_VELOCITY] != 0.0:
        return False
    p_1, p_2, cruise = own[POSITION], own[POSITION + 1], own[CRUISE]
    to_goal = norm(own[AIM] - p_1, own[AIM + 1] - p_2)
    if to_goal < kept[BEST] - PROGRESS_S * cruise or to_goal < cruise:
        kept[BEST], kept[SINCE], kept[FIRST], kept[FAILED] = to_goal, now_s, NOBODY, 0.0
        return False
    waited = now_s - kept[SINCE]
    if waited < patience(kept, 0.0) or waited < patience(kept, time_round(own, reports, identities, count)):
        return False
    first = choose_first(own, identity, reports, identities, count, now_s, clock_s, kept)
    kept[FIRST] = first
    if first == NOBODY:
        return False
    own[EXTRA_TURN] = 0.0
    if first == identity:
        return False

    push_1 = push_2 = 0.0
    for j in range(count):
        if reports[j, 7] == 0.0 or identities[j] < 0 or place_of(identities[j], first) >= place_of(identity, first):
            continue
        e_1 = p_1 - reports[j, 0] - reports[j, 2] * reports[j, 6]
        e_2 = p_2 - reports[j, 1] - reports[j, 3] * reports[j, 6]
        away = norm(e_1, e_2)
        lacking = (CLEAR_RADII + FAILED_RADII * kept[FAILED]) * reports[j, 8] - away
        if lacking <= 0.0 or away < EPSILON:
            continue
        e_1, e_2 = e_1 / away, e_2 / away
        aside = SIDESTEP if reports[j, 2] * e_1 + reports[j, 3] * e_2 > 0.0 else 0.0
        push_1 += lacking / PUSH_S * (e_1 + aside * e_2)
        push_2 += lacking / PUSH_S * (e_2 - aside * e_1)
    share = min(1.0, cruise / max(norm(push_1, push_2), EPSILON))
    own[AIM], own[AIM + 1], own[AIM_IS_VELOCITY] = share * push_1, share * push_2, 1.0
    return True


@kernel
def give_way_in_worlds(  # type: ignore[no-untyped-def]
    own, deciding, heard, present, radius_m, range_m, now_s, kept, reports, identities
):
    """`give_way` for all that decide, in every world; a vehicle's identity is its place. Arguments as in `worlds`.

    Args:
        own: Own-ships on their way to goals, written.
        deciding: True for vehicles that decide.
        heard: What others hear of each.
        present: True for vehicles in the air.
        radius_m: Radii.
        range_m: Vehicles further than this are not heard.
        now_s: Time, also of the clock that all share.
        kept: Memory of the vehicles, from `new_turns`, written.
        reports: Scratch, shape (N, 10).
        identities: Scratch, shape (N,), int64.
    """
    for world in range(own.shape[0]):
        for i in range(own.shape[1]):
            if not deciding[world, i]:
                continue
            own[world, i, AIM_IS_VELOCITY] = 0.0
            count = 0
            if now_s - kept[world, i, SINCE] >= patience(kept[world, i], 0.0):
                p_1, p_2 = own[world, i, POSITION], own[world, i, POSITION + 1]
                for j in range(own.shape[1]):
                    if j == i or not present[world, j]:
                        continue
                    if norm(heard[world, j, 0] - p_1, heard[world, j, 1] - p_2) > range_m:
                        continue
                    for column in range(8):
                        reports[count, column] = heard[world, j, column]
                    reports[count, 8], identities[count] = radius_m[world, i, j], j
                    count += 1
            give_way(own[world, i], i, reports, identities, count, now_s, now_s, kept[world, i])


def new_turns(*shape: int) -> FloatArray:
    """Memory of vehicles that have not flown yet, shape (*shape, TURN_COLUMNS)."""
    kept = np.zeros((*shape, TURN_COLUMNS))
    kept[..., BEST], kept[..., FIRST] = math.inf, NOBODY
    return kept


class RightOfWay:
    """`give_way` for one own-ship on its way to one goal. Reads no clock."""

    def __init__(self) -> None:
        self._kept = new_turns()
        self._own = np.zeros(OWN_COLUMNS)

    def velocity(
        self,
        own: OwnShip,
        identity: int,
        traffic: Traffic,
        identities: NDArray[np.int64],
        *,
        goal_ne_m: ArrayLike,
        cruise_mps: float,
        now_s: float,
        clock_s: float | None = None,
    ) -> FloatArray | None:
        """Velocity to make way with [m/s, north-east], instead of the one to the goal; None: fly to the goal.

        Args:
            own: Own-ship.
            identity: Number of own-ship in the order, not negative.
            traffic: Neighbours.
            identities: Their numbers, NOBODY for a neighbour that has none, shape (n,).
            goal_ne_m: Goal, shape (2,).
            cruise_mps: Speed wanted.
            now_s: The caller's clock; must not go back.
            clock_s: Time of a clock that all share, for example UTC; None if there is none. Then turns follow `now_s`,
                and vehicles agree on who goes first in some of them only.

        Raises:
            ValueError: If there is not one number for each neighbour, the own one is negative, or a value is not
                finite.
        """
        numbers = np.asarray(identities, dtype=np.int64)
        if numbers.shape != (len(traffic),) or identity < 0:
            raise ValueError(
                f"identities must hold {len(traffic)} numbers, and the own one not be negative: {identity}"
            )
        clock_s = now_s if clock_s is None else clock_s
        if not (math.isfinite(now_s) and math.isfinite(clock_s) and math.isfinite(cruise_mps)):
            raise ValueError(f"now_s, clock_s and cruise_mps must be finite, got {now_s}, {clock_s} and {cruise_mps}")
        row, reports = self._own, np.zeros((len(traffic), 10))
        row[:] = 0.0
        row[POSITION : POSITION + 2], row[VELOCITY : VELOCITY + 2] = own.position_ne_m, own.velocity_ne_mps
        row[AIM : AIM + 2], row[CRUISE] = checked_pair("goal_ne_m", goal_ne_m), cruise_mps
        reports[:, 0:2], reports[:, 2:4], reports[:, 6] = traffic.position_ne_m, traffic.velocity_ne_mps, traffic.age_s
        reports[:, 7], reports[:, 8] = traffic.reciprocal, traffic.radius_m
        if give_way(row, identity, reports, numbers, len(traffic), now_s, clock_s, self._kept):
            return row[AIM : AIM + 2].copy()
        return None
