"""Who goes first where nobody gets anywhere: priority by identity, as the last resort.

Discs that are too large to pass each other can hold everybody in place for ever, with every half-plane met. Whoever has
come no nearer to its goal for as long as it takes to fly round the largest of them, while others that avoid are about,
then falls back on an order that all of them know from each other's reports and from the clock: for every TURN_S each
identity has a lot, and who draws the least of those about goes first. Everybody else makes way for all that go before
it, those that follow the first one by identity, round and round, and waits at CLEAR_RADII of the disc until they are
through. Half-planes hold as ever and nothing is shrunk.

Lots need no agreement: whoever hears the same vehicles at the same time has the same ones, however long it has been
waiting. Were turns counted by each on its own, two could each wait for the other, in every turn anew. Who goes first
and comes somewhere keeps its turn; who does not, because it is at its goal or cannot, loses it as the time is over, so
nobody need know of another whether it has arrived. Who gets nowhere in its own turns either leaves the round for longer
and longer, and stays where it is. An own-ship is back to normal when it has come nearer to its goal than it was before,
or when the others are far away. Where the geometry does not admit one after the other either, because others stay in
the air at goals within a disc of the own one, a vehicle does not arrive.

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
"""At least: by then the turn of a stalled vehicle has long grown to its most, see `ProgressWatch`."""
PROGRESS_S = 0.5
"""Nearer to the goal than ever before by so long a flight at cruise is progress."""
TURN_S = 15.0
"""A turn of the clock; who goes first must come somewhere in it."""
FLYING_SHARE = 0.1
"""Somewhere is further than at this share of the own cruise; who hovers in wind and noise has a speed, too."""
RETREAT_COSINE = 0.7
"""Whose way leads so straight away from own-ship makes way for it, and believes that it is another one's turn."""
LOOKED_AT_S = 1.0
"""What was done longer ago than this, while own-ship was not stalled, counts for nothing."""
NEAR_RADII = 3.0
KEPT_RADII = 4.0
"""Others count within so many radii of the pair's disc; who goes first does until it is further than the second."""
CLEAR_RADII, FAILED_RADII = 1.5, 0.5
"""Who gives way waits so many radii away, and so many further for each of its own turns that led nowhere: others may
lack the room, too, between a disc and a wall."""
PUSH_S = 1.0
"""It makes up for what is lacking in this time, if its cruise speed allows."""
SIDESTEP = 0.6
"""Whom another one flies at also moves to that one's left, by this share: the other passes on its right."""

MOST_FAILED = 4
"""Own turns without progress that count; from the second on each doubles the patience."""

# Columns of what is kept: least distance to the goal, when it was reached, who goes first, in which turn of the clock,
# whether from its beginning, how far it has come in that turn, north and east, until when, and own turns without
# progress.
(BEST, SINCE, FIRST, TURN, WHOLE, COME, UNTIL, FAILED, TURN_COLUMNS) = (0, 1, 2, 3, 4, 5, 7, 8, 9)

NOBODY = -1
"""Identity of a neighbour that has no place in the order."""

NEXT_ROUND = 1e12
"""More than any identity, and little enough for their order not to be lost in it."""

LOTS, GOLDEN = 2**31 - 1, 1327217885
"""A prime, and the golden section of it: lots are as good as thrown, and the same for whoever works them out."""


@kernel(forceinline=True, inner=True)
def place_of(identity, first):  # type: ignore[no-untyped-def]
    """Place of an identity in the order that begins at `first`."""
    return identity if identity >= first else identity + NEXT_ROUND


@kernel(forceinline=True, inner=True)
def lot(identity, turn):  # type: ignore[no-untyped-def]
    """What an identity draws in a turn; the least goes first."""
    mixed = (identity + turn * GOLDEN) % LOTS
    mixed = (mixed * mixed + identity) % LOTS
    return mixed * mixed % LOTS


@kernel(forceinline=True, inner=True)
def distance_to(own, report):  # type: ignore[no-untyped-def]
    """How far a neighbour is now [m]."""
    north = report[0] + report[2] * report[6] - own[POSITION]
    east = report[1] + report[3] * report[6] - own[POSITION + 1]
    return norm(north, east)


@kernel(forceinline=True, inner=True)
def patience(kept, round_s):  # type: ignore[no-untyped-def]
    """Time without progress after which own-ship falls back on the order [s], with the time for a way round."""
    return max(PATIENCE_S, round_s) * 2.0 ** max(kept[FAILED] - 1.0, 0.0)


@kernel(inner=True)
def time_round(own, reports, identities, count):  # type: ignore[no-untyped-def]
    """Time to fly once round the largest disc of those near that have a place in the order [s]."""
    largest = 0.0
    for j in range(count):
        ordered = reports[j, 7] != 0.0 and identities[j] >= 0
        if ordered and distance_to(own, reports[j]) <= NEAR_RADII * reports[j, 8]:
            largest = max(largest, reports[j, 8])
    return 2.0 * math.pi * largest / max(own[CRUISE], EPSILON)


@kernel(inner=True)
def choose_first(own, identity, reports, identities, count, now_s, clock_s, kept):  # type: ignore[no-untyped-def]
    """Who goes first now, own-ship or a neighbour; NOBODY if no neighbour is near. Arguments as in `give_way`."""
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
    """Have a vehicle that gets nowhere make way for those before it: its aim becomes the velocity to do so.

    Args:
        own: Own row, as in `rows`; AIM, AIM_IS_VELOCITY and EXTRA_TURN are written where it gives way.
        identity: Number of own-ship, not negative.
        reports: Neighbours, rows as in `packing.pack`, shape (>= count, 10).
        identities: Their numbers, NOBODY for who has none, shape (>= count,), int64.
        count: How many there are.
        now_s: Time, which must not go back.
        clock_s: Time on the clock that all share.
        kept: What own-ship keeps, see `new_turns`, shape (TURN_COLUMNS,), written.

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
    """The same for all that decide, in every world; vehicles are known by their places. Arguments as in `worlds`.

    Args:
        own: Own-ships on their way to goals, written.
        deciding: Who decides.
        heard: What others hear of each.
        present: Who is in the air.
        radius_m: Radii.
        range_m: Vehicles further than this are not heard.
        now_s: Time, which is that of the clock that all share, too.
        kept: As `new_turns` made it, written.
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
    """What vehicles keep that have not flown yet, shape (*shape, TURN_COLUMNS)."""
    kept = np.zeros((*shape, TURN_COLUMNS))
    kept[..., BEST], kept[..., FIRST] = math.inf, NOBODY
    return kept


class RightOfWay:
    """The same for one own-ship on its way to one goal. Fed and asked; reads no clock."""

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
        """Velocity to make way with [m/s, north-east], to be preferred to that towards the goal; None: fly there.

        Args:
            own: Own-ship.
            identity: Number of own-ship in the order, not negative.
            traffic: Neighbours.
            identities: Their numbers, NOBODY for who has none, shape (n,).
            goal_ne_m: Where to go, shape (2,).
            cruise_mps: Speed wanted.
            now_s: The caller's clock; must not go back.
            clock_s: What the clock says that all share, UTC for example; None where there is none. Without one turns
                are the caller's own, and who goes first is agreed upon in some of them only.

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
