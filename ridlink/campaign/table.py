"""The table of a campaign: one row per cell, with its outcomes and their confidence intervals.

Units: metres, seconds; shares within 0 and 1. None where a figure is undefined, such as the ratio to a definition that
was not flown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ridlink.campaign.cell import BASELINE, Cell
from ridlink.campaign.statistics import (
    Flights,
    Interval,
    Medians,
    bootstrap_medians,
    clopper_pearson,
    collided_share,
    risk_ratio,
)
from ridlink.campaign.worlds import Outcomes
from ridlink.separation.definitions import Definition


@dataclass(frozen=True, slots=True)
class Row:
    """One cell.

    Attributes:
        scenario: Name of the scene.
        definition: Separation definition.
        gnss: Error model: how sigma became a position error.
        solver: Name of the solver.
        dynamics: How vehicles respond to commands.
        runs: Runs flown.
        flights: Number of vehicles in all runs.
        arrived: Vehicles that arrived.
        unfinished: Vehicles that neither arrived nor collided.
        macs: Vehicles in a mid-air collision; two per collision.
        mac_rate: Share of these vehicles.
        mac_rate_ci95: Clopper-Pearson interval of it, as if flights were independent.
        median_s: Median time of flights without a collision; the cut-off counts for those that did not arrive.
        median_ci95: Bootstrap interval of it.
        max_time_s: Longest time.
        ratio_to_snmac: Median divided by that under sNMAC with the same scene, errors and solver.
        min_separation_m: Smallest true distance of two centres.
        min_margin_m: The same less the MAC radius of the pair, the smallest over all pairs.
        infeasible_share: Share of decisions in which no velocity met every constraint.
        sigma_m: Standard deviation of the errors, if the scene has none.
        interval_s: Time between two reports.
        loss: Share of reports that a receiver misses.
        risk_ratio: Share in a collision divided by that without avoidance (definition `none`) in the same runs.
        risk_ratio_ci95: Interval of it.
        mac_rate_pairs_ci95: Interval of `mac_rate` for vehicles that collide two at a time: `collided_share`.
    """

    scenario: str
    definition: str
    gnss: str
    solver: str
    dynamics: str
    runs: int
    flights: int
    arrived: int
    unfinished: int
    macs: int
    mac_rate: float
    mac_rate_ci95: Interval
    median_s: float | None
    median_ci95: Interval | None
    max_time_s: float | None
    ratio_to_snmac: float | None
    min_separation_m: float | None
    min_margin_m: float | None
    infeasible_share: float
    sigma_m: float
    interval_s: float
    loss: float
    risk_ratio: float | None
    risk_ratio_ci95: Interval | None
    mac_rate_pairs_ci95: Interval

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


def table_rows(cells: Mapping[Cell, Outcomes], seed: int) -> list[tuple[Row, Flights]]:
    """Rows of all cells of a campaign, in their order, each with its flights.

    Args:
        cells: Outcomes of each cell.
        seed: Seed of the campaign.
    """
    flights = {cell: flights_of(outcomes, seed) for cell, outcomes in cells.items()}
    medians = {cell: each.medians for cell, each in flights.items()}
    found = []
    for cell, outcomes in cells.items():
        snmac, nobody = medians.get(cell.under(Definition.SNMAC)), cells.get(cell.under(BASELINE))
        found.append((_row(cell, outcomes, medians[cell], snmac, nobody, seed), flights[cell]))
    return found


def flights_of(outcomes: Outcomes, seed: int) -> Flights:
    """Flights of a cell; their median is resampled with the seed of the campaign, with the same runs in every cell."""
    time_s = np.minimum(outcomes.arrival_s, outcomes.duration_s)
    counted = ~outcomes.collided
    run = np.broadcast_to(np.arange(len(outcomes.run))[:, None], counted.shape)
    medians = bootstrap_medians(time_s[counted], run[counted], len(outcomes.run), seed)
    return Flights(time_s, outcomes.collided, medians)


def _row(
    cell: Cell, outcomes: Outcomes, medians: Medians, snmac: Medians | None, nobody: Outcomes | None, seed: int
) -> Row:  # fmt: skip
    times = outcomes.mission_s
    median_s = _finite(medians.median)
    ratio = None
    if median_s is not None and snmac is not None and _finite(snmac.median):
        ratio = median_s / snmac.median
    risk, risk_ci95 = (None, None)
    if nobody is not None and cell.definition != BASELINE:
        risk, risk_ci95 = risk_ratio(outcomes.collided, nobody.collided, seed)
    return Row(
        **asdict(cell), runs=len(outcomes.run), flights=outcomes.flights, arrived=outcomes.arrived,
        unfinished=outcomes.unfinished, macs=outcomes.macs, mac_rate=outcomes.macs / outcomes.flights,
        mac_rate_ci95=clopper_pearson(outcomes.macs, outcomes.flights), median_s=median_s,
        median_ci95=medians.interval, max_time_s=float(times.max()) if times.size else None, ratio_to_snmac=ratio,
        min_separation_m=_finite(float(outcomes.distance_m.min())),
        min_margin_m=_finite(float(outcomes.margin_m.min())),
        infeasible_share=int(outcomes.infeasible.sum()) / max(int(outcomes.decisions.sum()), 1),
        risk_ratio=risk, risk_ratio_ci95=risk_ci95,
        mac_rate_pairs_ci95=collided_share(outcomes.macs, outcomes.flights),
    )  # fmt: skip


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
