"""The sieve of neighbours against the half-plane that each of them stands for, at the very boundary."""

import math

from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numba import njit

from ridlink.avoidance.encounter import half_plane
from ridlink.avoidance.sift import LITTLE, SURELY, forbids_nothing

BEYOND = st.one_of(
    st.just(0.0), st.builds(math.copysign, st.floats(-14.0, 0.0).map(lambda e: 10.0**e), st.sampled_from([-1, 1]))
)
"""How much further away than the boundary, as a share: mostly next to nothing, on either side."""

angles = st.floats(0.0, 2.0 * math.pi)
shares = st.floats(0.0, 1.0)


@njit
def both(r_1, r_2, o_1, o_2, u_1, u_2, radius_m, horizon_s, share, limit_mps):
    """Whether nothing is forbidden, as the sieve says; where the half-plane with no side begins [m/s]."""
    e_1, e_2 = r_1 - horizon_s * (o_1 - u_1), r_2 - horizon_s * (o_2 - u_2)
    shared = horizon_s / share
    nothing = forbids_nothing(e_1, e_2, o_1, o_2, shared, radius_m + shared * (SURELY * limit_mps + LITTLE))
    n_1, n_2, change = half_plane(
        r_1, r_2, radius_m, horizon_s, radius_m, o_1 - u_1, o_2 - u_2, 0.0, 1.0, 0.0, 1.0, limit_mps
    )
    return nothing, n_1 * o_1 + n_2 * o_2 + share * change


@settings(max_examples=500, deadline=None)
@given(
    angles,
    BEYOND,
    shares,
    angles,
    shares,
    angles,
    st.floats(0.5, 60.0),
    st.floats(0.0, 400.0),
    st.floats(1.0, 60.0),
    st.sampled_from([0.5, 1.0]),
)
@example(0.0, -1e-3, 1.0, 0.0, 1.0, 0.0, 10.0, 15.0, 8.0, 0.5)  # both fly straight at each other, at their limit
def test_a_neighbour_is_set_aside_exactly_where_its_half_plane_begins_beyond_the_limit(
    way, beyond, own, own_way, other, other_way, limit, radius, horizon, share
):
    o = (own * limit * math.cos(own_way), own * limit * math.sin(own_way))
    u = (other * limit * math.cos(other_way), other * limit * math.sin(other_way))
    # The relative velocity leads to a place beside the neighbour; at this distance from it the half-plane is at -limit.
    north, east = math.cos(way), math.sin(way)
    off = (radius + horizon / share * (limit - (north * o[0] + east * o[1]))) * (1.0 + beyond)
    assume(off > 0.0)
    r = (off * north + horizon * (o[0] - u[0]), off * east + horizon * (o[1] - u[1]))

    nothing, bound = both(*r, *o, *u, radius, horizon, share, limit)
    if nothing:
        assert bound <= -limit * (1.0 - 1e-12)
    # Near is what SURELY and LITTLE leave to the full computation; the share counts from the terms that may cancel.
    certain = 1e-5 * (1.0 + horizon / share * limit / off)
    if abs(beyond) > certain:
        assert nothing == (beyond > 0.0) == (bound < -limit)
