"""``ridlink capacity``: how many drones a square kilometre holds, and how often they come into conflict."""

from __future__ import annotations

import json
from itertools import product
from typing import TYPE_CHECKING

import click

from ridlink.cli.campaign_options import Figures, Names
from ridlink.cli.options import DEFINITION, DEFINITIONS, Within, accuracy_convention, eta_option
from ridlink.words import counted

if TYPE_CHECKING:
    from ridlink.analysis.capacity import Capacity
    from ridlink.campaign.statistics import Interval

CATEGORIES = ("1", "2", "3", "4")


@click.command(short_help="How many drones per km2, and how many conflicts, for a definition.")
@click.option(
    "--definition", "definitions", type=Names(DEFINITIONS), help=f"{DEFINITION}  [default: all]",
)  # fmt: skip
@click.option(
    "--sigma", "sigmas_m", type=Figures(0.0, 1000.0), default="10", show_default=True, metavar="M,...",
    help="Standard deviation of the position error per axis; three of them are reported.",
)  # fmt: skip
@click.option(
    "--interval", "intervals_s", type=Figures(0.0, 60.0, above=True), default="0.1", show_default=True,
    metavar="S,...", help="Time between two reports.",
)  # fmt: skip
@click.option(
    "--category", "categories", type=Names(CATEGORIES), default="3", show_default=True, metavar="1-4,...",
    help="Of Table III: how fast they fly.",
)  # fmt: skip
@click.option(
    "--density", "density_per_km2", type=Within(1e-9, 1e5), default=1.0, show_default=True,
    metavar="N", help="Drones in a square kilometre at one height, for which conflicts are counted.",
)  # fmt: skip
@click.option(
    "--bearable", type=Within(0.0, 1e5, min_open=True), default=1.0, show_default=True, metavar="N",
    help="Conflicts that a drone may have in an hour of flight, which makes the capacity.",
)  # fmt: skip
@eta_option()
@accuracy_convention
@click.option("--worlds", type=click.IntRange(2, 100_000), default=400, show_default=True, metavar="N",
              help="Simulated worlds.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, metavar="N", help="Of all draws.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output instead of the table.")
def capacity(
    definitions: tuple[str, ...] | None, sigmas_m: tuple[float, ...], intervals_s: tuple[float, ...],
    categories: tuple[str, ...], density_per_km2: float, bearable: float, eta: float, accuracy_convention: str,
    worlds: int, seed: int, as_json: bool,
) -> None:  # fmt: skip
    """Drones per square kilometre and conflicts per hour: the gas model, and a simulation beside it.

    A conflict is an entry into the disc of another by drones that fly straight on in all directions, at one height:
    what avoidance has to solve, not what collides. A drone has 2 n E[R w] of them in a unit of time: n is the density,
    R the radius of a pair, w its relative speed (4/pi of the speed where all are equally fast). The simulation counts
    entries of 40 drones on a torus, without that formula. "Capacity" is the density at which a drone has --bearable
    conflicts in an hour; "packed" is how many fit, hovering, a mean radius apart.

    \b
        ridlink capacity
        ridlink capacity --definition candidate2,chance --sigma 1.9,3.5,10 --category 3
        ridlink capacity --definition candidate2 --interval 0.1,1,3 --density 20 --json
    """
    from rich.console import Console
    from rich.progress import track

    from ridlink.analysis.capacity import FEW, Airspace, capacities
    from ridlink.campaign.statistics import LEAST_RUNS
    from ridlink.errors import ConfigError
    from ridlink.separation.definitions import Definition

    airspaces = [
        Airspace(Definition(definition), sigma_m, interval_s, int(category), eta, accuracy_convention)
        for category, sigma_m, interval_s, definition in product(
            categories, sigmas_m, intervals_s, definitions or tuple(Definition)
        )
    ]
    try:
        found = capacities(airspaces, density_per_km2, bearable, seed, worlds)
        console = Console(stderr=True)
        if console.is_terminal and len(airspaces) > len(Definition):
            rows = list(track(found, "simulating", len(airspaces), console=console, transient=True))
        else:
            rows = list(found)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    note = FEW if worlds < LEAST_RUNS else None
    if as_json:
        click.echo(json.dumps({"rows": [row.as_dict() for row in rows], "worlds": worlds, "seed": seed, "note": note}))
        return
    _show(rows)
    if note:
        click.echo(note)


def _show(rows: list[Capacity]) -> None:
    """Print a table; values that are the same in all rows are above it."""
    columns: dict[str, list[str]] = {"definition": [str(row.airspace.definition) for row in rows]}
    above = [f"{counted(rows[0].density_per_km2, 'drone', 'g')} per km2 at one height"]
    for name, head, words in (
        ("category", "category", "category {:g}"), ("sigma_m", "sigma m", "sigma {:g} m"),
        ("interval_s", "every s", "every {:g} s"),
    ):  # fmt: skip
        values = [getattr(row.airspace, name) for row in rows]
        if len(set(values)) > 1:
            columns[head] = [f"{value:g}" for value in values]
        else:
            above.append(words.format(values[0]))
    told = [row.as_dict() for row in rows]
    columns |= {
        "radius m": [f"{row['radius_m']:.1f}" for row in told],
        "99.7 %": [f"{row['radius_quantile_m']:.1f}" for row in told],
        "conflicts/h": [f"{row['conflicts_per_flight_hour']:.3g}" for row in told],
        "simulated (95 %)": [_simulated(row["simulated_per_flight_hour"], row["simulated_ci95"]) for row in told],
        "per km2 h": [f"{row['conflicts_per_km2_hour']:.3g}" for row in told],
        "MACs/h": [f"{row['macs_per_flight_hour_unavoided']:.2g}" for row in told],
        "capacity/km2": [f"{row['capacity_per_km2']:.3g}" for row in told],
        "packed/km2": [f"{row['packed_per_km2']:.0f}" for row in told],
    }  # fmt: skip
    click.echo(f"{', '.join(above)}; capacity: {counted(rows[0].bearable, 'conflict', 'g')}/h each")
    lines = [list(columns), *map(list, zip(*columns.values(), strict=True))]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for first, *others in lines:
        right = (f"{cell:>{width}}" for cell, width in zip(others, widths[1:], strict=True))
        click.echo(f"{first:<{widths[0]}}  " + "  ".join(right))


def _simulated(rate: float, interval: Interval | None) -> str:
    return f"{rate:.3g}" + (f" ({interval[0]:.3g}-{interval[1]:.3g})" if interval else "")
