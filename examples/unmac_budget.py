"""The distance that a pair of drones needs under each separation definition, part by part, and the risk that is left.

Two small multirotors fly at 10 m/s, with 3.5 m of position error per axis (one sigma) and Remote ID ten times a second.
Five other vehicles are in the picture.
"""

from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, coded_bound_m
from ridlink.separation import Definition, Reported, mac_radius, separation_discs
from ridlink.separation.chance import DEFAULT_ETA, instant_probability, mission_probability

AIRFRAME_M = 0.6
SIGMA_M = 3.5
SPEED_MPS = 10.0
INTERVAL_S = 0.1
NEIGHBOURS = 6

bound_m = 3.0 * SIGMA_M  # what RIDLINK_SEPARATION carries: three standard deviations per axis
code_bound_m = coded_bound_m(bound_m, DEFAULT_CONVENTION)  # what standard Remote ID's accuracy code keeps of it
either = Reported(AIRFRAME_M, bound_m, code_bound_m, SPEED_MPS)
touch_m = mac_radius([AIRFRAME_M, AIRFRAME_M])

print(f"Two airframes of {AIRFRAME_M} m touch at {touch_m:.2f} m between centres. The disc of a pair, in metres:")
print(f"Accuracy codes are read as '{DEFAULT_CONVENTION}': an error of {bound_m:g} m counts as {code_bound_m:.1f} m.")
print()
print("definition      airframes  errors  flown  radius   risk of an encounter at its edge")
for definition in Definition:
    discs = separation_discs(definition, either, either, interval_s=INTERVAL_S, eta=DEFAULT_ETA, neighbours=NEIGHBOURS)
    # The distance flown between two messages is used up; the rest of the disc is there for errors.
    slack_m = discs.radius_m - discs.displacement_m - touch_m
    risk = instant_probability(-slack_m, bound_m, bound_m)
    print(
        f"{definition.value:14}  {discs.airframe_m:9.1f}  {discs.error_sum_m:6.1f}  {discs.displacement_m:5.1f}"
        f"  {discs.radius_m:6.1f}   {risk:.1e}"
    )

print()
print(f"chance: eta {DEFAULT_ETA:g} an encounter, for {NEIGHBOURS} neighbours together. Errors of GNSS last some 10 s:")
print(f"a minute in such traffic holds {mission_probability(DEFAULT_ETA, 60.0, 10.0):.4f}.")
