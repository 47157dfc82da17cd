"""One neighbour, one decision: the size of its disc, and the velocity that keeps out of this disc.

Own-ship flies north at 10 m/s. The neighbour comes towards it, a little to one side, and was heard 0.1 s ago.
"""

import numpy as np

from ridlink.avoidance import OwnShip, Traffic
from ridlink.avoidance.solver import new_solver
from ridlink.separation import Definition, Reported, separation_discs

WANTED = np.array([10.0, 0.0])  # north, east [m/s]
# As reported: airframe [m], error bounds from RIDLINK_SEPARATION and from the accuracy code [m], speed [m/s].
own_said = Reported(0.6, 10.5, 30.0, 10.0)
neighbour_said = Reported(np.array([0.6]), np.array([10.5]), np.array([30.0]), np.array([10.0]))

discs = separation_discs(Definition.CANDIDATE2, own_said, neighbour_said, interval_s=0.1)
own = OwnShip(np.zeros(2), WANTED, WANTED, airframe_m=0.6, speed_limit_mps=12.0)
neighbour = Traffic(
    position_ne_m=np.array([[100.0, 5.0]]),
    velocity_ne_mps=np.array([[-10.0, 0.0]]),
    command_ne_mps=np.array([[np.nan, np.nan]]),  # it does not say what it commands
    age_s=np.array([0.1]),
    radius_m=discs.radius_m,
    error_sum_m=discs.error_sum_m,
    reciprocal=np.array([False]),  # it does not say that it avoids, so own-ship does all of the avoiding
    memory=np.zeros(1, np.int8),
)
decision = new_solver("halfplane").solve(own, neighbour, preferred_ne_mps=WANTED, cruise_mps=10.0)

print(f"disc of the pair    {discs.radius_m[0]:.1f} m, {discs.error_sum_m[0]:.1f} m of it for errors")
print(f"left to it now      {decision.nearest_margin_m:.1f} m, entered in {decision.time_to_violation_s:.1f} s")
print("fly north, east     {:.1f}, {:.1f} m/s".format(*decision.velocity_ne_mps))
print(f"status              {decision.status.name.lower()}")
