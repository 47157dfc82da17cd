"""Own-ship and one neighbour: the half-plane that keeps them apart, the side to pass on, how soon they meet.

These functions run for every neighbour of every own-ship, several at a time. So nothing here branches: both answers are
worked out and one is picked. Lengths are compared by their squares. A square root or a division costs as much as ten
other steps, so all answers that need one share it.

Axes: north-east, metres, m/s, seconds. In these axes a rotation by a positive angle is a turn to the right, and
`a x b = a_1 b_2 - a_2 b_1` is positive when b points to the right of a. The neighbour is at r as seen from own-ship;
own-ship flies v, the neighbour u.
"""

from __future__ import annotations

import math

from ridlink.avoidance.kernel import kernel, larger, smaller

EPSILON = 1e-9

LEAST = 1e-18
"""Least length that can still be divided by [m]."""

HOLD_FACTOR = 1.3
CLEAR_FACTOR = 0.5
"""The rule of the road yields if own-ship already passes CLEAR_FACTOR radii on the other side. A side is held until the
miss distance is HOLD_FACTOR radii."""

LEAN_RADII = 2.0
"""A neighbour that is passed at this many radii of its disc calls for no turn."""

LEAN_HORIZONS = 2.5
"""A neighbour that is met later than this many conflict horizons calls for no turn either."""

DODGE_MPS = 1.0
"""A neighbour that moves to its right across the line of sight by more than this dodges to the right."""


@kernel(forceinline=True, inner=True)
def half_plane(  # type: ignore[no-untyped-def]
    r_1, r_2, radius_m, horizon_s, edge_m, w_1, w_2, side, way_1, way_2, barrier_per_s, most_mps
):
    """Smallest change of the relative velocity that leaves a disc's velocity obstacle or, inside the disc, separates.

    Source: van den Berg et al. (2011). The obstacle is a cone cut off by a circle, so the nearest way out leads to the
    circle or to one of the legs of the cone. Inside the disc a barrier asks for separation in proportion to the overlap
    instead.

    Args:
        r_1: North of the neighbour as seen from own-ship.
        r_2: East of it.
        radius_m: Radius of the disc.
        horizon_s: Time after which conflicts do not count, which cuts the cone off.
        edge_m: Radius that the barrier defends, at most `radius_m`.
        w_1: North of the relative velocity, own less neighbour's.
        w_2: East of it.
        side: 0 nearest boundary; 1 the right leg of the cone, -1 the left one, without the circle.
        way_1: North of the unit vector along which own-ship leaves a neighbour that is exactly on top of it.
        way_2: East of it.
        barrier_per_s: Separating speed asked for per metre of overlap.
        most_mps: Largest separating speed that may be asked for.

    Returns:
        Outward normal of the boundary and the change along it [m/s].
    """
    square, radius_square = r_1 * r_1 + r_2 * r_2, radius_m * radius_m
    # Relative velocity from the middle of the circle, times the horizon: a division would have to come before all else.
    off_1, off_2 = w_1 * horizon_s - r_1, w_2 * horizon_s - r_2
    off_square = off_1 * off_1 + off_2 * off_2
    towards, across = r_1 * off_1 + r_2 * off_2, r_1 * off_2 - r_2 * off_1
    inside = square < radius_square
    circle = (side == 0.0) & (towards < 0.0) & (towards * towards > radius_square * off_square)
    # Straight on is passed on the right, also when rounding says left.
    rightwards = across >= -EPSILON * (square + off_square)
    nearer = 1.0 if rightwards else -1.0
    leg = nearer if side == 0.0 else side

    # Only one of these is needed: |r|, the distance from the middle of the circle, the length of the leg.
    outside_square = off_square if circle else square - radius_square
    root = math.sqrt(square if inside else outside_square)
    outside_divisor = root if circle else square
    once_per = (-1.0 if inside else 1.0) / larger(root if inside else outside_divisor, LEAST)
    # Leg of the cone: r turned by asin(R / |r|) to its side; the outward normal is a quarter turn further.
    turned = leg * root
    leg_1, leg_2 = -radius_m * r_1 - turned * r_2, turned * r_1 - radius_m * r_2
    # Exactly on top of each other any direction separates.
    on_top = root < LEAST
    in_1, in_2 = -LEAST * way_1 if on_top else r_1, -LEAST * way_2 if on_top else r_2
    out_1, out_2 = off_1 if circle else leg_1, off_2 if circle else leg_2
    n_1, n_2 = (in_1 if inside else out_1) * once_per, (in_2 if inside else out_2) * once_per

    along = n_1 * w_1 + n_2 * w_2
    parting = smaller(barrier_per_s * (edge_m - root), most_mps) - along
    leaving = (radius_m - root) * (1.0 / horizon_s) if circle else -along
    return n_1, n_2, parting if inside else leaving


@kernel(forceinline=True, inner=True)
def rule_side(v_1, v_2, u_1, u_2, reciprocal, head_on_cosine, head_on_speed_mps):  # type: ignore[no-untyped-def]
    """Side that the rule of the road gives own-ship: 1 right, -1 left, 0 if it gives none.

    On opposite courses both turn to the right. A crossing vehicle that avoids nobody is passed astern: ahead of it, at
    its own speed, a slow answer ends in a race.

    Args:
        v_1: North of the own velocity.
        v_2: East of it.
        u_1: North of the neighbour's reported velocity.
        u_2: East of it.
        reciprocal: True if the neighbour takes its half of the avoidance.
        head_on_cosine: Courses are opposite if the cosine of their angle is below this; not above zero.
        head_on_speed_mps: Below this a course is mostly noise.
    """
    own_square, other_square = v_1 * v_1 + v_2 * v_2, u_1 * u_1 + u_2 * u_2
    slow = smaller(own_square, other_square) <= head_on_speed_mps * head_on_speed_mps
    parallel = v_1 * u_1 + v_2 * u_2
    opposite_square = head_on_cosine * head_on_cosine * own_square * other_square
    opposite = (parallel < 0.0) & (parallel * parallel > opposite_square)
    crossing = (parallel < 0.0) | (parallel * parallel < opposite_square)
    # Astern is the side that the neighbour moves away from.
    astern = -1.0 if v_1 * u_2 - v_2 * u_1 > 0.0 else 1.0
    passed = 0.0 if reciprocal | (not crossing) else astern
    side = 1.0 if opposite else passed
    return 0.0 if slow else side


@kernel(forceinline=True, inner=True)
def passing_side(  # type: ignore[no-untyped-def]
    held, rule, r_1, r_2, distance_m, w_1, w_2, c_1, c_2, reciprocal, radius_m, horizon_s
):
    """Side on which own-ship passes a neighbour if the nearest boundary will not do: 1 right, -1 left, 0 nearest.

    Both vehicles must see the same case, so only reported velocities count, not private commands. The choice is held
    until the encounter is over, so that noise cannot change it. One exception: if the two disagree, because one saw
    itself clear on the left and the other did not, right wins. Otherwise both dodge the same way and lock on.

    Args:
        held: Side that is kept from the last step, 0 if none.
        rule: Side that the rule of the road gives.
        r_1: North of the neighbour as seen from own-ship.
        r_2: East of it.
        distance_m: Length of r.
        w_1: North of the relative velocity, own less neighbour's.
        w_2: East of it.
        c_1: North of the neighbour's command, or of its velocity if it sends none.
        c_2: East of it.
        reciprocal: True if the neighbour takes its half of the avoidance.
        radius_m: Disc with its buffer.
        horizon_s: Conflict horizon.
    """
    closing_square = w_1 * w_1 + w_2 * w_2
    # Miss distance times closing speed, positive when own-ship passes to the right of the neighbour.
    across = r_1 * w_2 - r_2 * w_1
    across_square, unit_square = across * across, radius_m * radius_m * closing_square
    over = (closing_square < EPSILON * EPSILON) | (distance_m < radius_m) | (r_1 * w_1 + r_2 * w_2 <= 0.0)
    over = over | (across_square > HOLD_FACTOR * HOLD_FACTOR * unit_square)
    dodges = (held < 0.0) & reciprocal & (r_2 * c_1 - r_1 * c_2 > DODGE_MPS * distance_m)
    gap = distance_m - radius_m
    later = gap * gap >= closing_square * horizon_s * horizon_s
    clear = (rule * across < 0.0) & (across_square > CLEAR_FACTOR * CLEAR_FACTOR * unit_square)
    wanted = -rule if clear else rule
    fresh = 0.0 if later else wanted
    kept = fresh if held == 0.0 else held
    side = 1.0 if dodges else kept
    return 0.0 if over else side


@kernel(forceinline=True, inner=True)
def lean(r_1, r_2, w_1, w_2, radius_m, once_per_horizon, horizons):  # type: ignore[no-untyped-def]
    """Weight in [0, 1] of the turn that a neighbour calls for, tapered in miss distance and time.

    With a threshold instead, the turn would move the miss distance across the threshold, and chatter.

    Args:
        r_1: North of the neighbour as seen from own-ship.
        r_2: East of it.
        w_1: North of the relative velocity, preferred less the neighbour's velocity or command.
        w_2: East of it.
        radius_m: Disc without its buffer.
        once_per_horizon: One over the conflict horizon, 1/s.
        horizons: The turn begins this many conflict horizons ahead and is whole one horizon later.
    """
    square = w_1 * w_1 + w_2 * w_2
    radius = larger(radius_m, EPSILON)
    once_per = 1.0 / (larger(square, EPSILON) * radius)
    time = (r_1 * w_1 + r_2 * w_2) * radius * once_per
    miss_radii = abs(r_1 * w_2 - r_2 * w_1) * math.sqrt(square) * once_per
    near = smaller(larger(LEAN_RADII - miss_radii, 0.0), 1.0)
    soon = smaller(larger(horizons - time * once_per_horizon, 0.0), 1.0)
    weight = near * soon * smaller(larger(time, 0.0), 1.0)
    return 0.0 if square < EPSILON else weight


@kernel(forceinline=True, inner=True)
def time_to_entry(r_1, r_2, w_1, w_2, radius_m, never_s):  # type: ignore[no-untyped-def]
    """Time [s] until a disc is entered at relative velocity w (own less neighbour's); 0 inside, `never_s` if never."""
    inside = radius_m * radius_m - r_1 * r_1 - r_2 * r_2
    square = w_1 * w_1 + w_2 * w_2
    towards = r_1 * w_1 + r_2 * w_2
    root = towards * towards + square * inside
    # If the two approach, w is not zero.
    time = (towards - math.sqrt(larger(root, 0.0))) / larger(square, EPSILON * EPSILON)
    never = (towards <= 0.0) | (root <= 0.0)
    entry = never_s if never else larger(time, 0.0)
    return 0.0 if inside > 0.0 else entry
