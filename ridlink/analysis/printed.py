"""Compares printed numbers of the paper with the results of its equations, in metres and seconds.

Nothing here is tuned towards a printed number: if the computed number differs, `Comparison.why` gives the reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from ridlink.separation.chance import ChanceBound, chance_error_sum
from ridlink.separation.components import (
    EXACT,
    MAC_DISTANCE_M,
    displacement_line,
    localization_error,
    unmac_radius_distribution,
)
from ridlink.separation.reference import (
    CATEGORIES,
    GPS_SIGMA_M,
    GPS_STANDARDS,
    MAX_AIRFRAME_M,
    REPORT_INTERVAL_S,
    SNMAC_PAIR_RADIUS_M,
    UNKNOWN_ERROR_BOUND_M,
)
from ridlink.technologies import COMPARED

CLOSE = 0.01
"""Relative difference up to which a figure is close: the error of a sampled quantile, or of reading off a curve."""

PAPER_SIGMA_M = 10.0
"""Localization error of the paper's simulation, its worst case."""

PRINTED_3SIGMA_M = ("5.7", "10.5", "13.85", "30")
PRINTED_MEAN_M = ("3", "5.6", "7.4", "16")
PRINTED_QUANTILE_M = ("9.34", "17.3", "23.94", "49.5")


class Verdict(StrEnum):
    """Result of comparing a printed figure with the computed one.

    EQUAL: equal to all printed digits. CLOSE: not equal to all printed digits, but within 1 %. DIFFERS: it does not
    follow from the equations. NOT_PRINTED: the paper shows it as a curve only.
    """

    EQUAL = "equal"
    CLOSE = "close"
    DIFFERS = "differs"
    NOT_PRINTED = "not printed"


@dataclass(frozen=True, slots=True)
class Comparison:
    """One figure.

    Attributes:
        where: Section, table, figure or equation of the paper.
        what: Quantity.
        unit: Unit of both numbers, empty for a count.
        printed: As printed, None if it is not printed.
        ours: As computed; lowest and highest value if it is a range.
        verdict: Result of the comparison.
        why: Reason for a difference, empty if there is none.
    """

    where: str
    what: str
    unit: str
    printed: str | None
    ours: float | tuple[float, float]
    verdict: Verdict
    why: str = ""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def compared(where: str, what: str, unit: str, printed: str | None, ours: float, why: str = "") -> Comparison:
    """A comparison judged by the printed digits; the reason is kept only if there is a difference."""
    if printed is None:
        return Comparison(where, what, unit, None, ours, Verdict.NOT_PRINTED)
    value = float(printed)
    half_a_digit = 0.5 * 10.0 ** -len(printed.partition(".")[2])
    off = abs(ours - value)
    if off <= half_a_digit * (1.0 + 1e-9):
        return Comparison(where, what, unit, printed, ours, Verdict.EQUAL)
    verdict = Verdict.CLOSE if off <= CLOSE * abs(value) else Verdict.DIFFERS
    return Comparison(where, what, unit, printed, ours, verdict, why)


def comparisons() -> list[Comparison]:
    """All printed figures that follow, or should follow, from the equations."""
    return [*_table_ii(), *_sizes(), *_localization(), *_mobility(), *_unmac(), *_simulation()]


def _table_ii() -> Iterator[Comparison]:
    for sigma, standard, printed in zip(GPS_SIGMA_M, GPS_STANDARDS, PRINTED_3SIGMA_M, strict=True):
        yield compared(
            "Table II", f"3 sigma, {standard} (sigma {sigma:g})", "m", printed, 3.0 * sigma,
            "the printed sigma is 4.85 m, a third of the printed 3 sigma is 4.62 m",
        )  # fmt: skip
    beyond = 100.0 * math.exp(-(3.0**2) / 2.0)
    yield compared(
        "Table II", "positions beyond 3 sigma (printed as 99.7 % within)", "%", "0.3", beyond,
        "0.3 % lie beyond it on one axis, 1.1 % of positions in the plane",
    )  # fmt: skip


def _sizes() -> Iterator[Comparison]:
    yield compared("Table IV", "sNMAC, sum of the two largest airframes", "m", "15", 2.0 * MAX_AIRFRAME_M)
    yield compared(
        "Eq. 9", "radius at which the two largest airframes touch, against sNMAC's", "m", f"{SNMAC_PAIR_RADIUS_M:g}",
        MAX_AIRFRAME_M, "the sum of diameters is used as a radius: the MAC rate of 4.3 % fits 15 m",
    )  # fmt: skip
    pair = 2.0 * UNKNOWN_ERROR_BOUND_M
    yield compared("VI-A", "upper bound of the localization error of a pair", "m", "80", pair)
    yield compared("Table IV", "Remote ID, error part of the diameter", "m", "160", 2.0 * pair)
    yield compared(
        "Table IV", "Candidates, error part of the diameter, 3 sigma each", "m", f"{3.0 * PAPER_SIGMA_M:g}",
        2.0 * (3.0 + 3.0) * PAPER_SIGMA_M,
        "the printed '3 sigma' comes near the published times only as the sum of both errors in the radius",
    )  # fmt: skip
    yield compared(
        "VI-A", "mode of the MAC distance", "m", "3.7", MAC_DISTANCE_M[EXACT].mode,
        "half the sum of two sizes within 0.1 and 7.5 m peaks midway; Eq. 10 as printed has 3.75 m",
    )  # fmt: skip
    yield compared("Eq. 10", "99.7 % of MAC distances", "m", None, float(MAC_DISTANCE_M[EXACT].quantile(0.997)))


def _localization() -> Iterator[Comparison]:
    for sigma, printed in zip(GPS_SIGMA_M, PRINTED_MEAN_M, strict=True):
        yield compared(
            "VI-A, Eq. 12", f"mean error of a pair, sigma {sigma:g}", "m", printed, localization_error(sigma).mean,
            "follows from a sigma of 4.62 m, a third of the 13.85 m of Table II, and not from the printed 4.85 m",
        )  # fmt: skip
    for sigma, printed in zip(GPS_SIGMA_M, PRINTED_QUANTILE_M, strict=True):
        yield compared(
            "VI-A, Eq. 12", f"99.9 % error of a pair, sigma {sigma:g}", "m", printed,
            float(localization_error(sigma).quantile(0.999)), "off as the quantile of a finite sample is",
        )  # fmt: skip


def _mobility() -> Iterator[Comparison]:
    for number, category in CATEGORIES.items():
        yield compared(
            "mobility figure", f"99.7 % of what two of category {number} fly in 1 s", "m", None,
            displacement_line(category, 1.0),
        )  # fmt: skip
    claims = {
        "Wi-Fi beacon (SSID)": ("several", 2.0, 10.0, ""),
        "Bluetooth 4": ("several", 2.0, 10.0, "true of ten messages a second; the standard asks for one"),
        "FLARM": ("several hundred", 100.0, 1000.0, "one message a second, unless several in a row are lost"),
        "LoRa": ("several hundred", 100.0, 1000.0, ""),
    }
    for technology in COMPARED:
        if technology.label not in claims:
            continue
        printed, low, high, why = claims[technology.label]
        lines = [displacement_line(category, technology.period_s) for category in CATEGORIES.values()]
        holds = low <= min(lines) and max(lines) <= high
        yield Comparison(
            "VI-A", f"flown between two reports by {technology.label}", "m", printed, (min(lines), max(lines)),
            Verdict.EQUAL if holds else Verdict.DIFFERS, "" if holds else why,
        )  # fmt: skip


def _unmac() -> Iterator[Comparison]:
    for sigma in reversed(GPS_SIGMA_M):
        radius = unmac_radius_distribution(sigma, REPORT_INTERVAL_S)
        what = f"uNMAC radius, category 3, every {REPORT_INTERVAL_S:g} s, sigma {sigma:g}"
        yield compared("uNMAC figure", f"{what}: mean", "m", None, radius.mean)
        yield compared("uNMAC figure", f"{what}: 99.7 %", "m", None, float(radius.quantile(0.997)))


def _simulation() -> Iterator[Comparison]:
    yield compared(
        "VI-B", "flights: 500 runs, 4 definitions, 8 and 24 vehicles", "", "72000", 500.0 * 4 * (8 + 24),
        "as many as 36 vehicles would make",
    )  # fmt: skip


def excess_distances(etas: tuple[float, ...] = (0.95, 0.99, 0.999)) -> list[dict[str, float]]:
    """Distance [m] that a pair keeps beyond its airframes for the paper's errors, over eta, in the forms of
    `ChanceBound`.

    The paper's three sigma of both, which does not depend on eta, is included.
    """
    bound_m = 3.0 * PAPER_SIGMA_M
    rows = []
    for eta in etas:
        forms = {
            bound.value: float(np.asarray(chance_error_sum(bound_m, bound_m, eta=eta, bound=bound)))
            for bound in ChanceBound
        }
        rows.append({"eta": eta, **forms, "three_sigma": 2.0 * bound_m})
    return rows
