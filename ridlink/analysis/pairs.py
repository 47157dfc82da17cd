"""Compares cells of a campaign run by run: all cells of a scene fly the same fleets with the same errors.

It answers three questions: how a setting compares with the paper's points (Candidates 1 and 2 under rotation), what
lost reports cost, and how many flights of all scenes together ended in a collision.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ridlink.analysis.campaign import FlownCell
from ridlink.campaign.cell import Cell
from ridlink.campaign.statistics import Difference, Interval, collided_share, paired_difference

SETTING = ("definition", "solver")
"""Keys of a cell that can be chosen; all others describe the world."""

PAPERS_POINTS = (("candidate1", "rotation"), ("candidate2", "rotation"))

TICK_S = 1e-6
"""Times are multiples of a step; times that differ by less count as equal."""

ALPHA = 0.05


@dataclass(frozen=True, slots=True)
class Pair:
    """Comparison of one cell with another, with equal draws.

    Attributes:
        cell: The one.
        against: The other cell.
        macs: Collided flights of the one cell.
        macs_against: Collided flights of the other cell.
        flights: Number of flights of each.
        difference: The one cell less the other.
    """

    cell: Cell
    against: Cell
    macs: int
    macs_against: int
    flights: int
    difference: Difference

    @property
    def is_no_slower(self) -> bool:
        """Whether its median is not above that of the other; false if one has no median."""
        slower_s = self.difference.median_s
        return slower_s is not None and slower_s <= TICK_S

    @property
    def has_no_more_macs(self) -> bool:
        """Whether no more of its flights collided."""
        return self.macs <= self.macs_against

    @property
    def time_verdict(self) -> str:
        """`faster` or `slower` if the interval of the medians says so, else `level`; empty without medians."""
        interval = self.difference.median_ci95
        if interval is None:
            return ""
        if interval[1] < -TICK_S:
            return "faster"
        return "slower" if interval[0] > TICK_S else "level"

    @property
    def mac_verdict(self) -> str:
        """`fewer` or `more` if the sign test of the runs says so at 5 %, else `level`."""
        found = self.difference
        if found.p_value >= ALPHA:
            return "level"
        return "fewer" if found.fewer_runs > found.more_runs else "more"

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        verdicts = {"time_verdict": self.time_verdict, "mac_verdict": self.mac_verdict}
        return {**asdict(self), **verdicts}


@dataclass(frozen=True, slots=True)
class Dominance:
    """Comparison of two settings over all scenes and error models that both flew.

    Attributes:
        setting: Definition and solver of the one.
        against: Definition and solver of the other.
        world: Common values of the cells: dynamics, sigma, interval, loss.
        cells: Number of compared cells.
        no_slower: Number of cells in which the median is not above that of the other.
        no_more_macs: Number of cells in which no more flights collided.
        slower: Number of cells in which it is significantly slower.
        more_macs: Number of cells in which significantly more flights collided.
    """

    setting: tuple[str, str]
    against: tuple[str, str]
    world: dict[str, Any]
    cells: int
    no_slower: int
    no_more_macs: int
    slower: int
    more_macs: int

    @property
    def dominates(self) -> bool:
        """Whether it is no slower and has no more collisions in every cell, as counted."""
        return self.no_slower == self.no_more_macs == self.cells

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "dominates": self.dominates}


@dataclass(frozen=True, slots=True)
class Pooled:
    """Flights of one setting over all scenes.

    Attributes:
        conditions: Common values of these cells, by the names of `Cell`.
        scenarios: The scenes.
        flights: Flights in all of them.
        macs: Collided flights.
        mac_rate_ci95: Interval of their share, computed for pairs of vehicles.
    """

    conditions: dict[str, Any]
    scenarios: tuple[str, ...]
    flights: int
    macs: int
    mac_rate_ci95: Interval

    @property
    def said(self) -> str:
        """Text with the counts and the interval."""
        low, high = self.mac_rate_ci95
        if not self.macs:
            return f"0 of {self.flights:,}, so below {high:.1e} at 95 %"
        return f"{self.macs} of {self.flights:,}, so {low:.1e} to {high:.1e} at 95 %"

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "said": self.said}


def against_points(cells: Sequence[FlownCell]) -> list[Pair]:
    """Compare every cell with the paper's own settings in the same world, if they were flown."""
    return list(_pairs(cells, [dict(zip(SETTING, point, strict=True)) for point in PAPERS_POINTS]))


def against_lossless(cells: Sequence[FlownCell]) -> list[Pair]:
    """Compare every cell with lost reports with the same cell without."""
    return list(_pairs(cells, [{"loss": 0.0}]))


def _pairs(cells: Sequence[FlownCell], changes: Sequence[dict[str, Any]]) -> Iterator[Pair]:
    """Compare cells with those that differ only in the given changes."""
    known = {Cell.of_row(cell.row): cell for cell in cells}
    for cell, flown in known.items():
        for change in changes:
            wanted = Cell(**{**asdict(cell), **change})
            other = known.get(wanted)
            if other is not None and wanted != cell:
                difference = paired_difference(flown.flights, other.flights, flown.seed)
                yield Pair(cell, wanted, flown.row["macs"], other.row["macs"], flown.row["flights"], difference)


def dominance(pairs: Sequence[Pair]) -> list[Dominance]:
    """Compare settings over all scenes and error models of one world; pairs as from `against_points`."""
    groups: dict[tuple[Any, ...], list[Pair]] = {}
    for pair in pairs:
        world = _common(pair.cell, ("scenario", "gnss", *SETTING))
        groups.setdefault((_setting(pair.cell), _setting(pair.against), *world.values()), []).append(pair)
    return [
        Dominance(
            _setting(found[0].cell), _setting(found[0].against),
            _common(found[0].cell, ("scenario", "gnss", *SETTING)), len(found),
            sum(pair.is_no_slower for pair in found), sum(pair.has_no_more_macs for pair in found),
            sum(pair.time_verdict == "slower" for pair in found), sum(pair.mac_verdict == "more" for pair in found),
        )
        for found in groups.values()
    ]  # fmt: skip


def pooled(cells: Sequence[FlownCell]) -> list[Pooled]:
    """Collisions of every setting over all scenes; empty if there is only one scene."""
    groups: dict[tuple[Any, ...], list[FlownCell]] = {}
    for cell in cells:
        groups.setdefault(tuple(_common(Cell.of_row(cell.row), ("scenario",)).values()), []).append(cell)
    found = []
    for group in groups.values():
        if len(group) > 1:
            flights, macs = (sum(cell.row[name] for cell in group) for name in ("flights", "macs"))
            found.append(
                Pooled(
                    _common(Cell.of_row(group[0].row), ("scenario",)), tuple(cell.row["scenario"] for cell in group),
                    flights, macs, collided_share(macs, flights),
                )
            )  # fmt: skip
    return found


def _setting(cell: Cell) -> tuple[str, str]:
    return cell.definition, cell.solver


def _common(cell: Cell, without: Sequence[str]) -> dict[str, Any]:
    return {name: value for name, value in asdict(cell).items() if name not in without}
