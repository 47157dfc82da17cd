"""Cells of a campaign as if they had been flown."""

from dataclasses import asdict

import numpy as np

from ridlink.analysis.campaign import FlownCell
from ridlink.campaign.cell import Cell
from ridlink.campaign.statistics import Flights, bootstrap_medians, collided_share

RUNS, VEHICLES = 10, 8


def flown(definition, median_s, macs=0, snmac_s=7.0, **world):
    """A cell of ten runs of eight, whose times lie evenly about a median; the first flights are those that collide."""
    time_s = (median_s + np.linspace(-0.1, 0.1, RUNS * VEHICLES)).reshape(RUNS, VEHICLES)
    collided = (np.arange(RUNS * VEHICLES) < macs).reshape(RUNS, VEHICLES)
    run = np.repeat(np.arange(RUNS), VEHICLES)
    cell = Cell(**{
        "scenario": "circle8", "definition": definition, "gnss": "white-radial", "solver": "rotation",
        "dynamics": "ideal", "sigma_m": 10.0, "interval_s": 0.1, "loss": 0.0, **world,
    })  # fmt: skip
    row = {
        **asdict(cell), "runs": RUNS, "flights": 80, "unfinished": 0,
        "macs": macs, "mac_rate": macs / 80, "mac_rate_pairs_ci95": collided_share(macs, 80),
        "median_s": median_s, "median_ci95": (median_s, median_s), "ratio_to_snmac": median_s / snmac_s,
    }  # fmt: skip
    return FlownCell(row, Flights(time_s, collided, bootstrap_medians(time_s.ravel(), run, RUNS, 1)), 1)
