"""What a pair of drones needs between them, part by part, under each separation definition.

Two small multirotors at 10 m/s, 3.5 m of position error per axis (one sigma), Remote ID ten times a second.
"""

from ridlink.separation import Definition, mac_radius, separation_discs

AIRFRAME_M = 0.6
SIGMA_M = 3.5
SPEED_MPS = 10.0
INTERVAL_S = 0.1

bound_m = 3.0 * SIGMA_M  # what RIDLINK_SEPARATION carries: three standard deviations per axis
code_bound_m = 3.0 * 10.0  # what standard Remote ID carries: the code for "better than 10 m", read as one sigma

print("one pair, radii between centres in metres")
print(f"  airframes touch at         {mac_radius([AIRFRAME_M, AIRFRAME_M]):6.2f}")
print(f"  error bounds of both       {2.0 * bound_m:6.2f}")
print(f"  flown between two messages {2.0 * SPEED_MPS * INTERVAL_S:6.2f}")
print()
print("definition      disc radius   of which for errors")
for definition in Definition:
    discs = separation_discs(
        definition,
        own_airframe_m=AIRFRAME_M,
        own_error_bound_m=bound_m,
        own_accuracy_bound_m=code_bound_m,
        own_speed_mps=SPEED_MPS,
        airframe_m=[AIRFRAME_M],
        error_bound_m=[bound_m],
        accuracy_bound_m=[code_bound_m],
        speed_mps=[SPEED_MPS],
        interval_s=INTERVAL_S,
    )
    print(f"{definition.value:14}  {discs.radius_m[0]:9.1f} m   {discs.error_sum_m[0]:9.1f} m")
