"""Compares a campaign with the printed figures of the paper's simulation (section VI-B): verdicts, and differences to
sNMAC.

Nothing is tuned towards a printed figure. Times are in seconds, shares within 0 and 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ridlink.campaign.cell import USUAL, Cell
from ridlink.campaign.statistics import LEAST_RUNS, Difference, Flights, Interval, paired_difference

TOLERANCE = 0.1
"""Relative difference up to which a time counts as reproduced. The paper prints neither the size of its scenes nor the
mean speed of its fleet, which determine all times."""

PRINTED = {
    "circle8": {"snmac": (6.7, None, 0.043), "remote-id": (11.3, 1.69, 0.0), "candidate1": (7.7, 1.15, 0.0),
                "candidate2": (6.9, 1.03, 0.0)},
    "square24": {"snmac": (20.9, None, 0.043), "remote-id": (50.8, 2.43, 0.0), "candidate1": (27.4, 1.31, 0.0),
                 "candidate2": (22.2, 1.06, 0.0)},
}  # fmt: skip
"""Median [s], ratio to sNMAC, share in a collision. The paper gives one collision rate for both scenes."""

TOO_NEAR = (
    "the discs of Candidate 2 are 3.7 m smaller than those of Candidate 1, in the mean: no reading was found under "
    "which that makes it as fast as sNMAC"
)
FROZEN = "eight discs of this size fill the circle: no reading was found that has both this time and sNMAC's"
NOT_REPRODUCIBLE = {
    ("circle8", "candidate2"): TOO_NEAR,
    ("square24", "candidate2"): TOO_NEAR,
    ("circle8", "remote-id"): FROZEN,
}
"""Printed times and ratios that no honest reading of the text reproduces."""

ONE_RATE = "one rate is printed for both scenes; it depends on how strongly vehicles prefer the right, which is not"
SCALE = "neither the size of the scene nor the mean speed of the fleet is printed, and every time follows from them"
RATIO = "more than the tolerance allows"
FEW = f"of fewer than {LEAST_RUNS} runs no interval says how far a figure can be trusted"
AS_IN_THE_PAPER = {"gnss": "white-radial", "solver": "rotation", **USUAL}
"""Values of the cells that are compared with printed figures."""

CONDITIONS_OF_THE_PAPER: dict[str, tuple[Any, ...]] = {
    "preset": ("paper",), "technology": ("ideal",), "range_m": (None, 400.0), "latency_s": (None, [0.0, 0.0]),
    "stock_share": (0.0,), "unresponsive_share": (0.0,), "category": (None,), "speed_mps": (None,),
    "common_share": (0.0,), "bias_m": (0.0,), "filtered": (None, False),
}  # fmt: skip
"""Allowed values of a campaign whose cells are compared with the paper; any other value makes it a different
campaign."""

DEFINITION_NAMES = {
    "snmac": "sNMAC",
    "remote-id": "Remote ID",
    "odid-accuracy": "ODID accuracy",
    "candidate1": "Candidate 1",
    "candidate2": "Candidate 2",
    "chance": "chance",
    "none": "no avoidance",
}


def setting_words(definition: str, solver: str) -> str:
    """Name of a definition with a solver, for tables."""
    return f"{DEFINITION_NAMES.get(definition, definition)}, {solver}"


class Verdict(StrEnum):
    """Result of comparing a figure with the printed one."""

    REPRODUCED = "reproduced"
    DIFFERS = "differs"
    NOT_REPRODUCIBLE = "not reproducible"
    NOT_PRINTED = "not printed"
    TOO_FEW_RUNS = "too few runs"


@dataclass(frozen=True, slots=True)
class Judged:
    """One printed figure and the computed one.

    Attributes:
        printed: As printed, None if it is not printed.
        ours: As flown.
        interval: 95 % interval of the computed figure.
        verdict: Result of the comparison.
        why: Reason for a difference or for a missing verdict; else empty.
    """

    printed: float | None
    ours: float | None
    interval: Interval | None
    verdict: Verdict
    why: str = ""


@dataclass(frozen=True, slots=True)
class FlownCell:
    """A row of the campaign's table with its flights.

    Attributes:
        row: The row, as written by `ridlink campaign run`.
        flights: The flights.
        seed: Seed of the campaign.
    """

    row: dict[str, Any]
    flights: Flights
    seed: int

    @property
    def key(self) -> tuple[Any, ...]:
        """Key that is equal for cells that differ only in their definition."""
        return tuple(self.row[item.name] for item in fields(Cell) if item.name != "definition")

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times of the flights without a collision, shape (n,)."""
        return self.flights.time_s[~self.flights.collided]


@dataclass(frozen=True, slots=True)
class JudgedCell:
    """A cell compared with the paper and with sNMAC.

    Attributes:
        row: The row, as written by `ridlink campaign run`.
        beside_snmac: Difference to the cell under sNMAC, run by run; None without sNMAC, and for sNMAC itself.
        median: Median time.
        ratio: Ratio of the median to that under sNMAC.
        mac_rate: Share of vehicles in a collision.
    """

    row: dict[str, Any]
    beside_snmac: Difference | None
    median: Judged
    ratio: Judged
    mac_rate: Judged

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def is_the_papers(configuration: Mapping[str, Any]) -> bool:
    """Whether a campaign contains the paper's simulation; it may have further cells.

    Args:
        configuration: Configuration in its folder.
    """
    as_printed = all(configuration.get(name) in known for name, known in CONDITIONS_OF_THE_PAPER.items())
    return as_printed and USUAL["sigma_m"] in configuration.get("sigma_m", ())


def judge_cells(cells: Sequence[FlownCell], *, as_printed: bool) -> list[JudgedCell]:
    """Compare every cell with the paper and with sNMAC.

    Args:
        cells: A complete campaign.
        as_printed: Whether the campaign is the paper's; its cells with the paper's errors and solver are then compared
            with it.
    """
    snmac = {cell.key: cell for cell in cells if cell.row["definition"] == "snmac"}
    return [_judge(cell, snmac.get(cell.key), as_printed) for cell in cells]


def _judge(cell: FlownCell, snmac: FlownCell | None, as_printed: bool) -> JudgedCell:
    row = cell.row
    is_the_papers = as_printed and all(row[name] == value for name, value in AS_IN_THE_PAPER.items())
    printed = PRINTED.get(row["scenario"], {}) if is_the_papers else {}
    seconds, ratio, rate = printed.get(row["definition"], (None, None, None))
    beside = None
    if snmac is not None and snmac is not cell:
        beside = paired_difference(cell.flights, snmac.flights, cell.seed)
    never = NOT_REPRODUCIBLE.get((row["scenario"], row["definition"]), "")
    figures: tuple[Judged, ...] = (
        _compared(seconds, row["median_s"], row["median_ci95"], never, SCALE),
        _compared(ratio, row["ratio_to_snmac"], beside and beside.median_ratio_ci95, never, RATIO),
        _compared_rate(rate, row["mac_rate"], row["mac_rate_pairs_ci95"]),
    )  # fmt: skip
    if row["runs"] < LEAST_RUNS:
        figures = tuple(
            each if each.verdict is Verdict.NOT_PRINTED else replace(each, verdict=Verdict.TOO_FEW_RUNS, why=FEW)
            for each in figures
        )
    return JudgedCell(row, beside, *figures)


def _compared(printed: float | None, ours: float | None, interval: Any, never: str, why: str) -> Judged:
    if printed is None or ours is None:
        return Judged(printed, ours, interval, Verdict.NOT_PRINTED)
    if abs(ours - printed) <= TOLERANCE * printed:
        return Judged(printed, ours, interval, Verdict.REPRODUCED)
    return Judged(printed, ours, interval, Verdict.NOT_REPRODUCIBLE if never else Verdict.DIFFERS, never or why)


def _compared_rate(printed: float | None, ours: float, interval: Interval) -> Judged:
    """Compare a rate: it is reproduced if the interval contains the printed one."""
    if printed is None:
        return Judged(None, ours, interval, Verdict.NOT_PRINTED)
    if interval[0] <= printed <= interval[1]:
        return Judged(printed, ours, interval, Verdict.REPRODUCED)
    return Judged(printed, ours, interval, Verdict.DIFFERS, ONE_RATE)
