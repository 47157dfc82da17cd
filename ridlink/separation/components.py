"""The paper's distributions of each part of a separation distance, by name.

Source: paper, Tables II to IV, Eq. 4 and 10 to 12. Where text and formula differ, both stand here.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from ridlink.separation.distributions import Distribution, Normal, Triangular, TruncatedNormal
from ridlink.separation.reference import CATEGORIES, MAX_AIRFRAME_M, MIN_AIRFRAME_M, Category
from ridlink.separation.sums import HalfNormalSum, Sum

TEXT, PRINTED, EXACT = "text", "printed density", "exact"

MAC_DISTANCE_M: Mapping[str, Triangular] = MappingProxyType(
    {
        TEXT: Triangular(MIN_AIRFRAME_M, 3.7, MAX_AIRFRAME_M),
        PRINTED: Triangular(0.0, MAX_AIRFRAME_M / 2.0, MAX_AIRFRAME_M),
        EXACT: Triangular(MIN_AIRFRAME_M, (MIN_AIRFRAME_M + MAX_AIRFRAME_M) / 2.0, MAX_AIRFRAME_M),
    }
)
"""Half the sum of two airframes: as section VI has it in words, as Eq. 10 prints it, and as it is for two sizes that
are uniform between 0.1 and 7.5 m (a sum of two uniform sizes is triangular about its middle)."""


def localization_error(sigma_i_m: float, sigma_j_m: float | None = None) -> HalfNormalSum:
    """Localization error of both vehicles [m], Eq. 12.

    Args:
        sigma_i_m: Standard deviation of the one vehicle.
        sigma_j_m: Standard deviation of the other, the same if left out.
    """
    return HalfNormalSum(sigma_i_m, sigma_i_m if sigma_j_m is None else sigma_j_m)


def cruise_speed(category: Category) -> Normal:
    """Speed of a vehicle of a category [m/s], Table III with Eq. 4."""
    return Normal(category.cruise_speed_mps, category.speed_sigma_mps)


def fleet_speed() -> TruncatedNormal:
    """Speed of a vehicle of the paper's simulation [m/s]: N(30.7, 5.1^2), drawn again until within 10 and 51.5.

    The paper says category 3; only with its maximum speed as the mean do the mission times agree.
    """
    category = CATEGORIES[3]
    return TruncatedNormal(category.max_speed_mps, category.speed_sigma_mps, 10.0, CATEGORIES[4].max_speed_mps)


def displacement(category: Category, interval_s: float, other: Category | None = None) -> Normal:
    """Distance that two vehicles fly between two reports, at most relative to each other [m], section IV.

    Args:
        category: Of the one vehicle.
        interval_s: Time between two reports, positive.
        other: Category of the other, the same if left out.
    """
    pair = cruise_speed(category), cruise_speed(other or category)
    variance = pair[0].sigma ** 2 + pair[1].sigma ** 2
    return Normal(interval_s * (pair[0].mu + pair[1].mu), interval_s * variance**0.5)


def displacement_line(category: Category, interval_s: float) -> float:
    """Displacement of a pair that is not exceeded with a probability of 99.7 % [m], a line of the mobility figure.

    `interval (2 V_c + k sqrt(2) sigma_v)`, with k = 2.7478.
    """
    return float(displacement(category, interval_s).quantile(0.997))


def unmac_radius_distribution(sigma_m: float, interval_s: float) -> Sum:
    """Radius of the uNMAC of two vehicles of category 3 [m], Eq. 8 with everything in it random.

    Args:
        sigma_m: Standard deviation of the localization error of either.
        interval_s: Time between two reports, positive.
    """
    parts: tuple[Distribution, ...] = (
        MAC_DISTANCE_M[EXACT],
        localization_error(sigma_m),
        displacement(CATEGORIES[3], interval_s),
    )
    return Sum(parts)
