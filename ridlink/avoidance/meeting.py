"""The neighbours that matter, worked out exactly, block by block: passing sides, turns they call for, half-planes.

Most neighbours matter only by their half-planes. A few are met on the way; only these have a passing side or call for a
turn. `sift` decides which neighbours come here; `encounter` has the formulas for one of them.

Axes: north-east, metres, m/s, seconds; columns as in `rows`.
"""

from __future__ import annotations

import math

from ridlink.avoidance.encounter import EPSILON, half_plane, lean, passing_side, rule_side, time_to_entry
from ridlink.avoidance.kernel import kernel, larger, norm, smaller
from ridlink.avoidance.lanes import block_of, copy_lanes, lane_of
from ridlink.avoidance.rows import (
    BARRIER,
    BARRIER_SHARE,
    COMMAND,
    CRUISE,
    HEAD_ON_COSINE,
    HEAD_ON_SPEED,
    HORIZON,
    IS_APART,
    KEPT,
    LANES,
    LATER,
    LIMIT,
    N_COMMAND,
    N_POSITION,
    N_VELOCITY,
    NOW,
    PASSING_LEFT,
    POSITION,
    RADIUS,
    RECIPROCAL,
    RESPONSE,
    SIDE,
    VELOCITY,
    WIDE,
)
from ridlink.avoidance.sift import FAR, HORIZON_RADII

PUSHED_MPS = 5.0
"""The barrier may ask this much of a pair that was once apart, even of a slow vehicle: a buffer of seven metres asks
for more."""

START_RADII = 1.5
"""A neighbour within this many radii calls for no turn of a standing vehicle; one a radius further away calls for all
of it. A vehicle that stands at the edge of a disc waits; it is not just starting."""


@kernel(forceinline=True, inner=True)
def meet(  # type: ignore[no-untyped-def]
    own, neighbours, candidates, found, names, meetings, preferred, horizons, announced, settings
):
    """Work out passing sides and turns for the neighbours that are met on the way.

    Args:
        own: Own-ship.
        neighbours: Blocks; the memory of the encounters (KEPT) is updated.
        candidates: Blocks, as `sift` left them, those that are met first. In the blocks that hold one of these, SIDE is
            filled in, and N_COMMAND becomes the midpoint of the neighbour's velocity and its command.
        found: Number of candidates.
        names: As `sift` left them.
        meetings: Number of neighbours that are met.
        preferred: Velocity without traffic, shape (2,).
        horizons: Conflicts later than this many conflict horizons call for no turn.
        announced: Weight in [0, 1] of turns that neighbours call for by their commands alone.
        settings: Constants.

    Returns:
        Weights of the turn to the right, to the left, and when starting; least time to violation of those met [s], FAR
        if there is none.
    """
    p_1, p_2, v_1, v_2 = own[POSITION], own[POSITION + 1], own[VELOCITY], own[VELOCITY + 1]
    a_1, a_2 = preferred[0], preferred[1]
    stretch = HORIZON_RADII / max(own[CRUISE], 1.0)
    least_horizon = settings[HORIZON]
    cosine, course_speed = settings[HEAD_ON_COSINE], settings[HEAD_ON_SPEED]
    right = left = start = 0.0
    violation = FAR
    for b in range(-(-meetings // LANES)):
        block = candidates[b]
        # One array, distances known beforehand, no branch: so the compiler can take all lanes at once.
        for k in range(LANES):
            heard, reciprocal = LANES * b + k < found, block[RECIPROCAL + k] != 0.0
            r_1, r_2 = block[N_POSITION + k] - p_1, block[N_POSITION + LANES + k] - p_2
            u_1, u_2 = block[N_VELOCITY + k], block[N_VELOCITY + LANES + k]
            c_1, c_2 = block[N_COMMAND + k], block[N_COMMAND + LANES + k]
            disc, radius = block[RADIUS + k], block[WIDE + k]
            # A large disc must be seen earlier.
            horizon = larger(least_horizon, stretch * radius)
            some = larger(radius, EPSILON)
            once_per = 1.0 / (horizon * some)
            once_per_horizon = once_per * some
            distance = math.sqrt(r_1 * r_1 + r_2 * r_2)
            w_1, w_2 = v_1 - u_1, v_2 - u_2

            entry = time_to_entry(r_1, r_2, w_1, w_2, disc, FAR)
            violation = smaller(violation, entry if heard else FAR)

            rule = rule_side(v_1, v_2, u_1, u_2, reciprocal, cosine, course_speed)
            # By their velocities alone, while all speed up, each of a few expects to pass first.
            flown = lean(r_1, r_2, a_1 - u_1, a_2 - u_2, disc, once_per_horizon, horizons)
            commanded = lean(r_1, r_2, a_1 - c_1, a_2 - c_2, disc, once_per_horizon, horizons)
            called = larger(flown, announced * commanded)
            weight = called if heard else 0.0
            right, left = larger(right, 0.0 if rule < 0.0 else weight), larger(left, weight if rule < 0.0 else 0.0)
            # Circling works only if the neighbour does it too; one that stands or lands is passed instead.
            away = smaller(larger(distance * horizon * once_per - START_RADII, 0.0), 1.0)
            start = larger(start, weight * away if reciprocal else 0.0)

            # KEPT of a candidate already says whether it is, or ever was, apart.
            kept = block[KEPT + k]
            apart = kept >= IS_APART
            kept = kept - IS_APART if apart else kept
            held = -1.0 if kept == PASSING_LEFT else kept
            side = passing_side(held, rule, r_1, r_2, distance, w_1, w_2, c_1, c_2, reciprocal, radius, horizon)
            block[SIDE + k] = side
            passing = PASSING_LEFT if side < 0.0 else side
            block[KEPT + k] = passing + IS_APART if apart else passing
            # Head-on, the neighbour's own midpoint: then both see the same relative velocity.
            block[N_COMMAND + k], block[N_COMMAND + LANES + k] = (u_1 + c_1) / 2.0, (u_2 + c_2) / 2.0
    for m in range(meetings):
        neighbours[block_of(names[m]), KEPT + lane_of(names[m])] = candidates[block_of(m), KEPT + lane_of(m)]
    return right, left, start, violation


@kernel(forceinline=True, inner=True)
def neighbour_half_planes(own, candidates, found, preferred, settings, lines, first):  # type: ignore[no-untyped-def]
    """Write the half-planes of all neighbours: for each block LANES of now, and LANES of later if there is a response
    time. A half-plane that every velocity within the limit meets is written as one that forbids nothing.

    Args:
        own: Own-ship.
        candidates: Blocks, as `meet` left them.
        found: Number of neighbours.
        preferred: Velocity without traffic, shape (2,).
        settings: Constants.
        lines: Result, from column `first` on.
        first: See `lines`.

    Returns:
        Index after the last column of `lines` that is used.
    """
    p_1, p_2, v_1, v_2 = own[POSITION], own[POSITION + 1], own[VELOCITY], own[VELOCITY + 1]
    # Midpoint of the own velocity and the own command: the point from which changes are shared.
    o_1, o_2 = (v_1 + own[COMMAND]) / 2.0, (v_2 + own[COMMAND + 1]) / 2.0
    a_1, a_2 = preferred[0], preferred[1]
    speed = norm(a_1, a_2)
    way_1, way_2 = a_1 / max(speed, EPSILON), a_2 / max(speed, EPSILON)
    if speed <= EPSILON:
        way_1, way_2 = 1.0, 0.0
    limit, stretch = own[LIMIT], HORIZON_RADII / max(own[CRUISE], 1.0)
    least_horizon, wait = settings[HORIZON], settings[RESPONSE]
    barrier, most = settings[BARRIER], settings[BARRIER_SHARE] * limit
    # After being clear of a neighbour, one that obeys late may ask for more: a share of a low limit is too little.
    pushed = max(most, min(limit, PUSHED_MPS)) if wait > 0.0 else most

    used = first
    for b in range(-(-found // LANES)):
        block = candidates[b]
        for k in range(LANES):
            heard, reciprocal = LANES * b + k < found, block[RECIPROCAL + k] != 0.0
            r_1, r_2 = block[N_POSITION + k] - p_1, block[N_POSITION + LANES + k] - p_2
            u_1, u_2 = block[N_VELOCITY + k], block[N_VELOCITY + LANES + k]
            c_1, c_2 = block[N_COMMAND + k], block[N_COMMAND + LANES + k]
            disc, radius, side = block[RADIUS + k], block[WIDE + k], block[SIDE + k]
            horizon = larger(least_horizon, stretch * radius)
            w_1, w_2 = v_1 - u_1, v_2 - u_2
            # The edge that the barrier defends: with the buffer, but not against a neighbour that began inside it.
            apart = block[KEPT + k] >= IS_APART
            edge, asked = radius if apart else disc, pushed if apart else most
            x_1, x_2 = c_1 if side != 0.0 else u_1, c_2 if side != 0.0 else u_2
            share = 0.5 if reciprocal else 1.0

            now_side = side if r_1 * w_1 + r_2 * w_2 > 0.0 else 0.0
            n_1, n_2, change = half_plane(
                r_1, r_2, radius, horizon, edge, o_1 - x_1, o_2 - x_2, now_side, way_1, way_2, barrier, asked
            )
            bound = n_1 * o_1 + n_2 * o_2 + share * change
            matters = heard & (bound > -limit)
            block[NOW + k], block[NOW + LANES + k] = n_1, n_2
            block[NOW + 2 * LANES + k] = bound if matters else -math.inf

            s_1, s_2 = r_1 - w_1 * wait, r_2 - w_2 * wait
            later_side = side if s_1 * w_1 + s_2 * w_2 > 0.0 else 0.0
            n_1, n_2, change = half_plane(
                s_1, s_2, radius, horizon, edge, o_1 - x_1, o_2 - x_2, later_side, way_1, way_2, barrier, asked
            )
            bound = n_1 * o_1 + n_2 * o_2 + share * change
            matters = heard & (bound > -limit)
            block[LATER + k], block[LATER + LANES + k] = n_1, n_2
            block[LATER + 2 * LANES + k] = bound if matters else -math.inf

        for row in range(3):
            copy_lanes(block, NOW + LANES * row, lines[row], used)
        used += LANES
        if wait > 0.0:
            for row in range(3):
                copy_lanes(block, LATER + LANES * row, lines[row], used)
            used += LANES
    return used
