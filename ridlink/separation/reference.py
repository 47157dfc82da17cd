"""Reference figures of the separation definitions, SI units.

Sources: Table II (GPS accuracy), Table III (vehicle categories), Table IV (fleet) and Eq. 4 (speed sigma) of the paper
"Remote ID for separation provision and multi-agent navigation" (Vinogradov et al., 2023). Airframe sizes are diameters.
"""

from __future__ import annotations

from dataclasses import dataclass

from ridlink.ranges import Range

MAX_AIRFRAME_M = 7.5
"""Largest airframe of the paper's database; stands in for an unknown one (section III)."""

MIN_AIRFRAME_M = 0.1
"""Smallest airframe of the fleet of Table IV; a smaller reported size is raised to this."""

AIRFRAME_CAP_M = 30.0
"""No unmanned aircraft of any category is larger: a larger report is clamped, so that one packet cannot block a whole
sky."""

AIRFRAME_RANGE = Range(MIN_AIRFRAME_M, AIRFRAME_CAP_M, "m")
"""What an own airframe may be said to measure: discs count no other."""

AIRFRAME_HEIGHT_RANGE = Range(0.01, AIRFRAME_CAP_M, "m")
"""The same for its height, from the centimetre that RIDLINK_SEPARATION counts in."""

UNKNOWN_ERROR_BOUND_M = 40.0
"""Upper bound of the localization error of one vehicle that reports none (160 m for a pair in Table IV is 2 (40 +
40))."""

ERROR_CAP_M = 185.0
"""0.1 NM. A report with a larger error cannot be used for separation: it is clamped, and the caller must flag it."""

SNMAC_PAIR_RADIUS_M = 15.0
"""Radius that the sNMAC definition puts around a pair: twice the true sum of two largest airframe radii (Table IV)."""

GPS_SIGMA_M = (1.9, 3.5, 4.85, 10.0)
"""One sigma per axis of the four accuracy standards of Table II; the table prints three."""

GPS_STANDARDS = ("zero age of data", "over all ages of data", "any age of data", "worst case in normal operations")
"""Names of those four in Table II."""

REPORT_INTERVAL_S = 0.1
"""Time between two Remote ID reports in section VI-B."""

LONGEST_INTERVAL_S = 1.0
"""Interval of standard Remote ID; a vehicle heard less often coasts, and its disc grows for that."""

SPEED_CAP_MPS = 254.25
"""Largest horizontal speed that Remote ID can express."""


@dataclass(frozen=True, slots=True)
class Category:
    """One column of Table III.

    Args:
        number: Category number, 1 to 4.
        max_takeoff_mass_kg: Largest take-off mass of the category.
        cruise_speed_mps: Mean cruise speed V_c.
        max_speed_mps: Maximum airspeed V_max.
    """

    number: int
    max_takeoff_mass_kg: float
    cruise_speed_mps: float
    max_speed_mps: float

    @property
    def speed_sigma_mps(self) -> float:
        """Standard deviation of the cruise speed [m/s], Eq. 4: a third of the distance to V_max."""
        return (self.max_speed_mps - self.cruise_speed_mps) / 3.0


CATEGORIES: dict[int, Category] = {
    1: Category(1, 1.8, 12.9, 20.6),
    2: Category(2, 9.0, 10.3, 15.4),
    3: Category(3, 9.0, 15.4, 30.7),
    4: Category(4, 25.0, 30.7, 51.5),
}
"""Table III, "representative UAV categories"."""


UNKNOWN_SPEED_MPS = CATEGORIES[3].max_speed_mps
"""Speed of a vehicle that reports none: the maximum of category 3, the most inclusive one (section VI-B)."""
