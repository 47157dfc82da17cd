"""The options of ``ridlink campaign run``, and the types of their values."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import click

from ridlink.cli import options
from ridlink.cli.options import GNSS_MODELS, TECHNOLOGIES, Within, accuracy_convention, eta_option
from ridlink.words import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Command = TypeVar("Command", bound=Callable[..., Any])

BASELINE = "none"
DEFINITIONS = (*options.DEFINITIONS, BASELINE)
PAPER_DEFINITIONS = ("snmac", "remote-id", "candidate1", "candidate2")
SOLVERS = ("halfplane", "graded", "rotation", "g2", "g3", "k", "k2")
DYNAMICS = ("ideal", "px4", "ardupilot")
LARGEST = 2**63 - 1
"""Largest seed or run number: shards store them as integers of 64 bits."""


class Names(click.ParamType):  # type: ignore[type-arg]  # generic since click 8.4 only
    """Comma-separated names, each once; from a given set, or any."""

    name = "A,B,..."

    def __init__(self, known: Sequence[str] = ()) -> None:
        self._known = known

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, ...]:
        if isinstance(value, tuple):
            return value
        names = tuple(dict.fromkeys(part.strip() for part in value.split(",")))
        for name in names:
            if not name or (self._known and name not in self._known):
                hint = did_you_mean(name, self._known)
                known = f"{hint or ';'} known are {', '.join(self._known)}" if self._known else ""
                self.fail(f"{name!r} is not known{known}.", param, ctx)
        return names


class Points(Names):
    """Comma-separated definitions with their solvers, as `candidate2/rotation`."""

    name = "A/B,..."

    def __init__(self) -> None:
        super().__init__([f"{definition}/{solver}" for definition in DEFINITIONS for solver in SOLVERS])

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, ...]:
        if isinstance(value, tuple):
            return value
        for part in str(value).split(","):
            definition, slash, solver = part.strip().partition("/")
            if not slash:
                self.fail(f"{part.strip()!r} is not DEFINITION/SOLVER, such as candidate2/rotation.", param, ctx)
            Names(DEFINITIONS).convert(definition, param, ctx)
            Names(SOLVERS).convert(solver, param, ctx)
        return super().convert(value, param, ctx)


class Figures(click.ParamType):  # type: ignore[type-arg]  # generic since click 8.4 only
    """Comma-separated numbers, each once and within a range."""

    name = "X,Y,..."

    def __init__(self, low: float, high: float, *, above: bool = False, below: bool = False) -> None:
        self._one = Within(low, high, min_open=above, max_open=below)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        if isinstance(value, tuple):
            return value
        parts = str(value).split(",")
        return tuple(dict.fromkeys(self._one.convert(part.strip(), param, ctx) for part in parts))


class Span(click.ParamType):  # type: ignore[type-arg]  # generic since click 8.4 only
    """A time [s], or two with "-" between them."""

    name = "S[-S]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        if isinstance(value, tuple):
            return value
        first, dash, last = str(value).partition("-")
        kind = Within(0.0, 10.0)
        low = kind.convert(first, param, ctx)
        high = kind.convert(last, param, ctx) if dash else low
        if high < low:
            self.fail(f"{value!r}: the second time is before the first.", param, ctx)
        return low, high


def option_group(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """Combine several options into one decorator, in their order."""

    def decorate(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


cell_options = option_group(
    click.option("--preset", type=click.Choice(["paper"]), help="The paper's simulation, section VI-B."),
    click.option(
        "--scenario", "scenarios", type=Names(), default="circle8,square24", show_default=True,
        metavar="NAME|FILE.toml,...",
        help="circle8 and square24, with fleets drawn as the paper's; circleN[@RADIUS] and squareN[@SIDE], the same "
        "with other numbers [m]; head-on, crossing, overtake; files.",
    ),
    click.option(
        "--definition", "definitions", type=Names(DEFINITIONS),
        help=f"{options.DEFINITION[:-1]}; none: nobody avoids.  [default: all but none; paper: its four]",
    ),
    click.option(
        "--gnss", type=Names(GNSS_MODELS),
        help="How sigma becomes a position error: white, white-radial, gauss-markov or bias.  "
        "[default: gauss-markov; paper: white-radial]",
    ),
    click.option(
        "--solver", "solvers", type=Names(SOLVERS),
        help="What chooses the velocity: halfplane, graded (or g2, the same) or rotation; g3, k and k2 are graded with "
        "other constants.  [default: halfplane; paper: rotation]",
    ),
    click.option(
        "--point", "points", type=Points(), metavar="DEFINITION/SOLVER,...",
        help="These definitions with these solvers, instead of all definitions under all solvers.",
    ),
    click.option(
        "--dynamics", type=Names(DYNAMICS), default="ideal", show_default=True,
        help="How vehicles answer: at once (ideal), or as px4 or ardupilot.",
    ),
    click.option(
        "--sigma", "sigmas_m", type=Figures(0.0, 1000.0), default="10", show_default=True, metavar="M,...",
        help="Standard deviation per axis, for vehicles of which the scenario says nothing; 0 = exact.",
    ),
    click.option(
        "--interval", "intervals_s", type=Figures(0.02, 10.0), metavar="S,...",
        help="Time between two reports.  [default: the scenario's, 0.1 in built-in ones]",
    ),
    click.option(
        "--loss", "losses", type=Figures(0.0, 1.0, below=True), metavar="SHARE,...",
        help="Share of reports that a receiver close by misses; a technology's losses far away and among many come on "
        "top.  [default: the technology's; ideal: 0]",
    ),
)  # fmt: skip
"""Options that take several values; every combination of them is a cell."""

air_options = option_group(
    click.option(
        "--technology", type=click.Choice(TECHNOLOGIES), default="ideal", show_default=True,
        help="Period, range, latency and losses of a way to broadcast, where nothing else is said.",
    ),
    click.option(
        "--loss-burst", "burst", type=Within(1.0, 1e6), metavar="MEAN",
        help="Reports are lost so many in a row, in the mean.  [default: each by itself]",
    ),
    click.option(
        "--latency", "--age", "latency_s", type=Span(),
        help="Age of a report when it is heard, uniform between two times.  [default: the technology's; ideal: 0]",
    ),
    click.option(
        "--range", "range_m", type=Within(1.0, 1e6), metavar="M",
        help="Radio range.  [default: the technology's; ideal: 400]",
    ),
    click.option(
        "--stock", "stock_share", type=Within(0.0, 1.0), default=0.0, metavar="SHARE",
        help="Vehicles that send standard Remote ID only.",
    ),
    click.option(
        "--unresponsive", "unresponsive_share", type=Within(0.0, 1.0), default=0.0, metavar="SHARE",
        help="Vehicles that fly straight on and avoid nobody.",
    ),
)  # fmt: skip

fleet_options = option_group(
    click.option(
        "--category", type=click.IntRange(1, 4), metavar="1-4",
        help="Fleets of circleN and squareN as a category of Table III.  [default: the paper's fleet]",
    ),
    click.option(
        "--speed", "speed_mps", type=Within(0.5, 100.0), metavar="M/S",
        help="Cruise speed of everybody in circleN and squareN.  [default: drawn; 10 with px4 or ardupilot]",
    ),
    click.option(
        "--correlation", "--gnss-time", "correlation_s", type=Within(0.1, 1e6), default=10.0, show_default=True,
        metavar="S", help="Time constant of gauss-markov errors.",
    ),
    click.option(
        "--common-mode", "--gnss-common", "common_share", type=Within(0.0, 1.0), default=0.0, metavar="SHARE",
        help="Part of the variance of the errors that all vehicles share.",
    ),
    click.option(
        "--bias", "bias_m", type=Within(0.0, 1000.0), default=0.0, metavar="M",
        help="An offset on top, for the whole flight, that nobody knows of: its standard deviation per axis.",
    ),
    click.option(
        "--filter/--no-filter", "filtered", default=None,
        help="Smooth reported positions, own and others'.  [default: for graded only]",
    ),
    eta_option(),
    accuracy_convention,
)  # fmt: skip
