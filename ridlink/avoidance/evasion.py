"""Evasion: the last way out if the answer of the half-planes cannot be flown in time.

Half-planes bound velocities; they do not say whether the vehicle reaches one before it meets another vehicle. A
multirotor that is told to outrun an intruder first heard at 80 m, at 12 m/s each, brakes for three seconds on the very
spot where it is hit. So if a disc will be entered deeply before the answer is flown, the path to the answer is compared
with paths to other velocities. A path flies on as before, then changes to its velocity at the acceleration of a real
vehicle, while the neighbours fly straight on. A path that enters the discs less deeply is taken instead.

Axes: north-east, metres, m/s, seconds; columns as in `rows`.
"""

from __future__ import annotations

import math

from ridlink.avoidance.encounter import EPSILON
from ridlink.avoidance.kernel import kernel, larger, norm, smaller
from ridlink.avoidance.programme import measure
from ridlink.avoidance.rows import (
    GAP,
    LANES,
    LATER,
    N_POSITION,
    N_VELOCITY,
    NOW,
    POSITION,
    RADIUS,
    RECIPROCAL,
    VELOCITY,
)

SOON_S = 6.0
"""Paths are followed for this long. Discs that are entered later are left to the half-planes."""

REACTION_S, ACCELERATION_MPS2 = 0.5, 5.0
"""Answer to a velocity setpoint, of the faster of the two autopilots that were measured. With the slower one's 0.7 s
and 2.5 m/s^2, PX4 is taken off answers that it can fly; with the faster one's, ArduPilot is hit as seldom."""

DEEP, LESS_DEEP = 0.25, 0.02
"""Shares of the radius: a path that enters a disc by DEEP is left for one that enters less deeply by LESS_DEEP."""

WAYS = tuple(
    (math.cos(angle), math.sin(angle)) for angle in (0.25 * math.pi, -0.25 * math.pi, 0.5 * math.pi, -0.5 * math.pi)
)
"""Velocities that are tried, as cosine and sine of the angle to the deepest neighbour, all at full speed: midway
between towards it and across the line of sight, and across, to both sides. The right comes first: of two that are alike
the right one is kept."""


@kernel(forceinline=True, inner=True)
def approach_at(t, r_1, r_2, w_1, w_2, d_1, d_2, ramp_s, once_per_ramp):  # type: ignore[no-untyped-def]
    """Squared distance [m^2] to the neighbour at a time on a path, and how much later [s] it is least if both fly
    straight.

    Args:
        t: Time from now.
        r_1: North of the neighbour as seen from own-ship, now.
        r_2: East of it.
        w_1: North of its velocity less own-ship's, now.
        w_2: East of it.
        d_1: North of the change of own-ship's velocity.
        d_2: East of it.
        ramp_s: How long own-ship takes for the change, after its reaction.
        once_per_ramp: One over `ramp_s`.
    """
    answering = larger(t - REACTION_S, 0.0)
    turning = smaller(answering, ramp_s)
    moved = 0.5 * turning * turning * once_per_ramp + (answering - turning)
    s_1, s_2 = r_1 + w_1 * t - d_1 * moved, r_2 + w_2 * t - d_2 * moved
    u_1, u_2 = w_1 - d_1 * turning * once_per_ramp, w_2 - d_2 * turning * once_per_ramp
    return s_1 * s_1 + s_2 * s_2, -(s_1 * u_1 + s_2 * u_2) / larger(u_1 * u_1 + u_2 * u_2, EPSILON)


@kernel(inner=True)
def deepest_entry(own, candidates, found, c_1, c_2, enough):  # type: ignore[no-untyped-def]
    """How deeply a path enters a disc, as a share of its radius.

    Args:
        own: Own-ship.
        candidates: Blocks of the neighbours that matter, with their half-planes; the path's entry into each disc is
            written to GAP.
        found: Number of them.
        c_1: North of the velocity that the path leads to.
        c_2: East of it.
        enough: Blocks after one that is entered this deeply are not looked at.

    Returns:
        Share of the radius by which the least distance falls short of it, halved if the neighbour avoids as well; the
        largest of all neighbours, 0 if no disc is entered.
    """
    p_1, p_2, v_1, v_2 = own[POSITION], own[POSITION + 1], own[VELOCITY], own[VELOCITY + 1]
    d_1, d_2 = c_1 - v_1, c_2 - v_2
    ramp = norm(d_1, d_2) / ACCELERATION_MPS2 + EPSILON
    once_per = 1.0 / ramp
    deepest = 0.0
    for b in range(-(-found // LANES)):
        block = candidates[b]
        for k in range(LANES):
            r_1, r_2 = block[N_POSITION + k] - p_1, block[N_POSITION + LANES + k] - p_2
            w_1, w_2 = block[N_VELOCITY + k] - v_1, block[N_VELOCITY + LANES + k] - v_2
            # Where the two are nearest before the change is flown, in two steps from where they would be without it ...
            _, later = approach_at(0.0, r_1, r_2, w_1, w_2, d_1, d_2, ramp, once_per)
            t = smaller(larger(later, 0.0), SOON_S)
            first, later = approach_at(t, r_1, r_2, w_1, w_2, d_1, d_2, ramp, once_per)
            t = smaller(larger(t + later, 0.0), SOON_S)
            second, _ = approach_at(t, r_1, r_2, w_1, w_2, d_1, d_2, ramp, once_per)
            # ... and afterwards, on the straight way that it leads to.
            _, later = approach_at(REACTION_S + ramp, r_1, r_2, w_1, w_2, d_1, d_2, ramp, once_per)
            t = smaller(REACTION_S + ramp + larger(later, 0.0), SOON_S)
            third, _ = approach_at(t, r_1, r_2, w_1, w_2, d_1, d_2, ramp, once_per)
            least = smaller(smaller(r_1 * r_1 + r_2 * r_2, first), smaller(second, third))
            share = 0.5 if block[RECIPROCAL + k] != 0.0 else 1.0
            entry = share * (1.0 - math.sqrt(least) / larger(block[RADIUS + k], EPSILON))
            # Lanes after the last neighbour, and neighbours that forbid nothing, have no half-plane.
            bound = larger(block[NOW + 2 * LANES + k], block[LATER + 2 * LANES + k])
            block[GAP + k] = entry if bound > -math.inf else 0.0
            deepest = larger(deepest, block[GAP + k])
        if deepest >= enough:
            break
    return deepest


@kernel(forceinline=True, inner=True)
def too_soon(own, x, violation_s):  # type: ignore[no-untyped-def]
    """Whether the first disc is entered before a velocity is flown; never inside one, which is left to the barrier.

    Args:
        own: Own-ship.
        x: Velocity.
        violation_s: Time until the first disc is entered as both fly now, 0 inside of one.
    """
    flown_s = REACTION_S + norm(x[0] - own[VELOCITY], x[1] - own[VELOCITY + 1]) / ACCELERATION_MPS2
    return 0.0 < violation_s <= smaller(flown_s, SOON_S)


@kernel(inner=True)
def evade(own, candidates, found, limit, lines, begin, first, x):  # type: ignore[no-untyped-def]
    """Replace the answer by a velocity whose path enters discs less deeply, if that is needed and there is one.

    Args:
        own: Own-ship.
        candidates: Blocks of the neighbours that matter, with their half-planes; GAP is overwritten.
        found: Number of them.
        limit: Largest speed.
        lines: Half-planes; those in columns `begin..first-1` are not exceeded.
        begin: See `lines`.
        first: See `lines`.
        x: Answer, shape (2,), read and written.

    Returns:
        True if the answer was replaced.
    """
    answer = deepest_entry(own, candidates, found, x[0], x[1], math.inf)
    if answer < DEEP:
        return False
    r_1 = r_2 = 0.0
    for b in range(-(-found // LANES)):
        for k in range(LANES):
            if candidates[b, GAP + k] == answer:
                r_1 = candidates[b, N_POSITION + k] - own[POSITION]
                r_2 = candidates[b, N_POSITION + LANES + k] - own[POSITION + 1]
    distance = norm(r_1, r_2)
    least, changed = answer - LESS_DEEP, False
    once_per = limit / distance
    for cosine, sine in WAYS:
        along, across = once_per * cosine, once_per * sine
        c_1, c_2 = along * r_1 - across * r_2, across * r_1 + along * r_2
        if begin < first and measure(lines, begin, first, c_1, c_2) > EPSILON:
            continue
        entry = deepest_entry(own, candidates, found, c_1, c_2, least)
        if entry < least - EPSILON:
            least, changed = entry, True
            x[0], x[1] = c_1, c_2
    return changed
