"""Which neighbours matter: a test of a few instructions for each, before anything costly is worked out.

Of two dozen neighbours a handful can constrain own-ship, and in open air none. The test takes one square root and no
division. `meeting` works out the neighbours that remain exactly. Nothing is lost: a neighbour is set aside only if
`meeting` would certainly find that it forbids no velocity within the limit, calls for no turn, gives no passing side
and has no disc that own-ship flies into.

Axes: north-east, metres, m/s, seconds; columns as in `rows`.
"""

from __future__ import annotations

import math

from ridlink.avoidance.encounter import EPSILON, HOLD_FACTOR, LEAN_RADII
from ridlink.avoidance.kernel import kernel, larger, norm, smaller
from ridlink.avoidance.lanes import bit_count, gather_lanes, lanes_with, pack_lanes
from ridlink.avoidance.rows import (
    AGE,
    AGE_ACCELERATION,
    BUFFER_SHARE,
    COMMAND,
    CRUISE,
    ERROR_SUM,
    GAP,
    HEARD,
    HORIZON,
    IS_APART,
    KEPT,
    LANES,
    LIMIT,
    MATTERS,
    N_COMMAND,
    N_POSITION,
    N_VELOCITY,
    POSITION,
    RADIUS,
    RECIPROCAL,
    REPORTED,
    RESPONSE,
    SIDE,
    SPEED,
    VELOCITY,
    WIDE,
)
from ridlink.avoidance.turning import buffer_growth_in_kernels

HORIZON_RADII = 1.5
"""The conflict horizon is at least the time in which own-ship flies this many radii of the disc."""

FAR = 1e300
"""Infinity [m or s] where a minimum is sought. With a true infinity the compiler simplifies the minimum, and its code
does not go by lanes."""

BINDS, MEETS = 1.0, 2.0
"""How a neighbour matters: by its half-planes alone, or because it is met on the way as well."""

SURELY = 1.0 + 1e-6
"""Factor of safety of the comparisons, above what rounding can do within 80,000 radii."""

LITTLE = 1e-6
"""The same margin in m/s, for vehicles that do not move."""

HOLD_SQUARE, LEAN_SQUARE = (SURELY * HOLD_FACTOR) ** 2, (SURELY * LEAN_RADII) ** 2
"""Once a neighbour has been HOLD_FACTOR radii away, buffer included, the buffer is held against it. One that begins
nearer, as in a fleet that starts side by side, may come up to the disc itself until then: to push such neighbours out
of a buffer first kept these fleets from moving at all."""


@kernel(forceinline=True, fused=True, inner=True)
def approaches(r_1, r_2, square, w_1, w_2, radius_square):  # type: ignore[no-untyped-def]
    """Whether velocity w approaches a point at r and may pass it within a radius, or leaves it from within that radius.

    With the miss distance m, (r.w)^2 = (r^2 - m^2) w^2. A number times its magnitude is its square with its sign.

    Args:
        r_1: North of the point.
        r_2: East of it.
        square: Square of r.
        w_1: North of the velocity.
        w_2: East of it.
        radius_square: Square of the radius.
    """
    towards = r_1 * w_1 + r_2 * w_2
    return towards * abs(towards) > (square - radius_square) * (w_1 * w_1 + w_2 * w_2)


@kernel(forceinline=True, fused=True, inner=True)
def plus_product(a, b, c):  # type: ignore[no-untyped-def]
    """a + b c, with a single rounding where the machine can."""
    return a + b * c


@kernel(forceinline=True, fused=True, inner=True)
def forbids_nothing(e_1, e_2, o_1, o_2, horizon_s, reach_m):  # type: ignore[no-untyped-def]
    """Whether a half-plane of `encounter.half_plane` without a side is certain to lie outside the limit.

    With r the neighbour, w = o - u the relative velocity, h the horizon and e = r - h w, the nearest way out of the
    velocity obstacle leads to its circle if e.r > R |e|, with n = -e / |e| and a change by R / h - |e| / h. Its
    half-plane begins at n.o + share * change, which is below a limit of -L if

        |e| - R + h / share * e.o / |e| >= h / share * L.

    If L is not less than |o| and |u|, then e.r = e.e + h e.o - h e.u >= R |e| follows and needs no test of its own.

    Args:
        e_1: North of e.
        e_2: East of it.
        o_1: North of the velocity from which changes are shared.
        o_2: East of it.
        horizon_s: h / share.
        reach_m: R + h / share * L.
    """
    square = e_1 * e_1 + e_2 * e_2
    lead = square + horizon_s * (e_1 * o_1 + e_2 * o_2)
    return lead * abs(lead) > reach_m * reach_m * square


@kernel(forceinline=True, inner=True)
def first_lane(block, column, number):  # type: ignore[no-untyped-def]
    """First lane of a column that holds a number; the last lane if none before it does."""
    lane = LANES - 1
    for k in range(LANES - 2, -1, -1):
        lane = k if block[column + k] == number else lane
    return lane


@kernel(forceinline=True, inner=True)
def collect(neighbours, count, candidates, names):  # type: ignore[no-untyped-def]
    """Copy the neighbours that matter to the candidates: first those that are met, then those that bind.

    Args:
        neighbours: Blocks, with MATTERS filled in.
        count: Number of blocks.
        candidates: Result; no passing side yet.
        names: Result: places of the candidates among the neighbours.

    Returns:
        Numbers of neighbours that are heard, of candidates, and of candidates that are met.
    """
    heard, found = LANES * count, 0
    for b in range(count):
        met = lanes_with(neighbours[b], MATTERS, MEETS)
        pack_lanes(met, LANES * b, names, found)
        heard -= bit_count(lanes_with(neighbours[b], GAP, FAR))
        found += bit_count(met)
    meetings = found
    for b in range(count):
        bound = lanes_with(neighbours[b], MATTERS, BINDS)
        pack_lanes(bound, LANES * b, names, found)
        found += bit_count(bound)
    for b in range(-(-found // LANES)):
        target, first = candidates[b], LANES * b
        # Lanes after the last candidate hold some neighbour or other.
        place_0, place_1, place_2, place_3 = names[first], names[first + 1], names[first + 2], names[first + 3]
        for column in range(0, HEARD, LANES):
            gather_lanes(neighbours, place_0, place_1, place_2, place_3, column, target)
        for k in range(LANES):
            target[SIDE + k] = 0.0
    return heard, found, meetings


@kernel(forceinline=True, inner=True)
def sift(own, neighbours, count, range_m, preferred, settings, candidates, names):  # type: ignore[no-untyped-def]
    """Pick the neighbours that matter.

    Args:
        own: Own-ship.
        neighbours: Blocks; GAP is filled in, and KEPT as far as it is known here.
        count: Number of blocks.
        range_m: Neighbours whose reports are from further away are not heard.
        preferred: Velocity without traffic, shape (2,).
        settings: Constants.
        candidates: Result: blocks of the neighbours that matter: first those that are met, then the others.
        names: Result: places of the candidates among the neighbours.

    Returns:
        Numbers of neighbours that are heard, that matter, and that are met; place of the first neighbour with the least
        distance less radius, -1 if none is heard; that distance [m], FAR if there is none.
    """
    p_1, p_2, v_1, v_2 = own[POSITION], own[POSITION + 1], own[VELOCITY], own[VELOCITY + 1]
    o_1, o_2 = (v_1 + own[COMMAND]) / 2.0, (v_2 + own[COMMAND + 1]) / 2.0
    a_1, a_2 = preferred[0], preferred[1]
    fastest, stretch = SURELY * max(own[LIMIT], norm(o_1, o_2)) + LITTLE, HORIZON_RADII / max(own[CRUISE], 1.0)
    least_horizon, wait, buffer, growth = (
        settings[HORIZON], settings[RESPONSE], settings[BUFFER_SHARE], settings[AGE_ACCELERATION] / 2.0,
    )  # fmt: skip
    buffer *= buffer_growth_in_kernels(own[CRUISE], wait)
    reach, late = range_m * range_m, wait > 0.0
    margin, near = FAR, -1
    for b in range(count):
        block, before = neighbours[b], margin
        for k in range(LANES):
            off_1, off_2 = block[REPORTED + k] - p_1, block[REPORTED + LANES + k] - p_2
            heard = (block[HEARD + k] != 0.0) & (off_1 * off_1 + off_2 * off_2 <= reach)
            r_1, r_2 = block[N_POSITION + k] - p_1, block[N_POSITION + LANES + k] - p_2
            u_1, u_2, age = block[N_VELOCITY + k], block[N_VELOCITY + LANES + k], block[AGE + k]
            disc = block[RADIUS + k]
            radius = disc + buffer * block[ERROR_SUM + k] + growth * age * age
            block[WIDE + k] = radius
            horizon = larger(least_horizon, stretch * radius)
            square = r_1 * r_1 + r_2 * r_2
            distance = math.sqrt(square)
            gap = distance - disc if heard else FAR
            block[GAP + k] = gap
            margin = smaller(margin, gap)

            w_1, w_2 = v_1 - u_1, v_2 - u_2
            hold_square = HOLD_SQUARE * (radius * radius)
            passed = approaches(r_1, r_2, square, w_1, w_2, hold_square)
            lean_square = LEAN_SQUARE * disc * disc + EPSILON
            leans = approaches(r_1, r_2, square, a_1 - u_1, a_2 - u_2, lean_square)
            c_1, c_2 = block[N_COMMAND + k], block[N_COMMAND + LANES + k]
            leans = leans | (late & approaches(r_1, r_2, square, a_1 - c_1, a_2 - c_2, lean_square))
            e_1, e_2 = plus_product(r_1, -horizon, o_1 - u_1), plus_product(r_2, -horizon, o_2 - u_2)
            l_1, l_2 = plus_product(e_1, -wait, w_1), plus_product(e_2, -wait, w_2)
            # h / share; the share is a half or one.
            shared = plus_product(horizon, horizon, block[RECIPROCAL + k])
            most = plus_product(radius, shared, larger(fastest, block[SPEED + k]))
            free_now = forbids_nothing(e_1, e_2, o_1, o_2, shared, most)
            free_later = forbids_nothing(l_1, l_2, o_1, o_2, shared, most)
            meets = passed | leans
            matters = heard & (meets | (not (free_now & free_later)))
            degree = MEETS if meets else BINDS
            block[MATTERS + k] = degree if matters else 0.0

            kept = block[KEPT + k]
            apart = (kept >= IS_APART) | (square >= hold_square)
            side = kept - IS_APART if kept >= IS_APART else kept
            # APART is forgotten if the neighbour is out of range, a side also once the neighbour is no longer met.
            block[KEPT + k] = (IS_APART if apart & heard else 0.0) + (side if meets & heard else 0.0)
        near = b if margin < before else near
    nearest = LANES * near + first_lane(neighbours[near], GAP, margin) if near >= 0 else -1
    heard, found, meetings = collect(neighbours, count, candidates, names)
    return heard, found, meetings, nearest, margin
