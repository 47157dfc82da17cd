"""Options of all commands with a fleet: scenario, autopilot, receiver, radio, place."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from ridlink.cli.options import GNSS_MODELS, TECHNOLOGIES, Within

if TYPE_CHECKING:
    from sitl_sim.autopilot import Start
    from sitl_sim.fleet_config import FleetConfig

AUTOPILOTS = ("px4", "ardupilot", "ideal")
ACCURACY_CLASSES = {"zero-age": 1.9, "all-ages": 3.5, "any-age": 4.85, "worst-case": 10.0}
"""GPS standards of Table II by short names: one sigma per axis [m]."""


class Sigma(Within):
    """Metres, or the name of one of the accuracy classes of the paper's Table II."""

    name = "M|CLASS"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        metres = ACCURACY_CLASSES.get(value, value)
        try:
            float(metres)
        except ValueError:
            self.fail(f"{value!r} is neither metres nor one of {', '.join(ACCURACY_CLASSES)}.", param, ctx)
        return super().convert(metres, param, ctx)


class Home(click.ParamType):  # type: ignore[type-arg]  # generic since click 8.4 only
    """LAT,LON,ALT in degrees and metres above mean sea level."""

    name = "LAT,LON,ALT"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        try:
            latitude, longitude, altitude = (float(part) for part in value.split(","))
        except ValueError:
            self.fail(f"{value!r} is not LAT,LON,ALT, as in 47.397742,8.545594,488.", param, ctx)
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and -500.0 <= altitude <= 9000.0):
            self.fail(f"{value!r} is no place on Earth.", param, ctx)
        return latitude, longitude, altitude


_OPTIONS = (
    click.option("--scenario", default="circle8", show_default=True, metavar="NAME|FILE",
                 help="circle8, square24, head-on, crossing, overtake, or a file: TOML, or GeoJSON tracks."),
    click.option("-n", "--vehicles", "count", type=click.IntRange(0, 250), metavar="N",
                 help="Number of vehicles.  [default: the scenario's]"),
    click.option("--seed", type=click.IntRange(0), default=1, show_default=True, metavar="N",
                 help="Of errors, radio and fleet. In real time, flights of one seed differ a little."),
    click.option("--autopilot", type=click.Choice(AUTOPILOTS), default="px4", show_default=True,
                 help="Whose response and whose MAVLink."),
    click.option("--speed", "speed_mps", type=Within(0.0, 60.0, min_open=True), default=10.0, show_default=True,
                 metavar="M/S", help="Cruise speed of vehicles of which the scenario says nothing."),
    click.option("--gnss", type=click.Choice(GNSS_MODELS), default="gauss-markov", show_default=True,
                 help="How sigma becomes a position error."),
    click.option("--sigma", "sigma_m", type=Sigma(0.0, 1000.0), default=3.5, show_default=True, metavar="M|CLASS",
                 help="Standard deviation per axis, for vehicles of which the scenario says nothing; 0 = exact; or "
                 f"one of the paper's classes: {', '.join(ACCURACY_CLASSES)}."),
    click.option("--gnss-common", type=Within(0.0, 1.0), default=0.0, show_default=True, metavar="SHARE",
                 help="Share of the variance of position errors that all vehicles have in common."),
    click.option("--gnss-time", "gnss_time_s", type=Within(0.0, 1e6, min_open=True), default=10.0, show_default=True,
                 metavar="S", help="Correlation time of gauss-markov."),
    click.option("--airframe", metavar="TYPE|FILE.toml",
                 help="Type of the vehicles of which the scenario says nothing.  [default: the one that was measured]"),
    click.option("--interval", "interval_s", type=Within(0.02, 10.0), metavar="S",
                 help="Time between two Remote ID updates.  [default: the scenario's, 0.1]"),
    click.option("--technology", type=click.Choice(TECHNOLOGIES), default="ideal", show_default=True,
                 help="Way of broadcasting: shortest interval, range, delay and loss."),
    click.option("--loss", type=Within(0.0, 1.0), metavar="SHARE",
                 help="Share lost, at any distance within the range.  [default: the technology's]"),
    click.option("--range", "range_m", type=Within(0.0, 1e6, min_open=True), metavar="M",
                 help="Radio range.  [default: the technology's; ideal: 400]"),
    click.option("--home", type=Home(), help="Where the scenario's origin lies.  [default: as the scenario says, else "
                 "47.397742,8.545594,488]"),
)  # fmt: skip

_NAMES = ("scenario", "count", "seed", "autopilot", "speed_mps", "gnss", "sigma_m", "gnss_common", "gnss_time_s",
          "airframe", "interval_s", "technology", "loss", "range_m", "home")  # fmt: skip


def fleet_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator that adds the options, and passes their values as one dictionary, the argument ``fleet``."""

    @functools.wraps(command)
    def collected(**given: Any) -> Any:
        return command(fleet={name: given.pop(name) for name in _NAMES}, **given)

    for option in reversed(_OPTIONS):
        collected = option(collected)
    return collected


def fleet_config(fleet: dict[str, Any], start: Start, **ports_and_more: Any) -> FleetConfig:
    """The configuration that the options describe.

    Args:
        fleet: Values from `fleet_options`.
        start: Initial state of the fleet.
        ports_and_more: Further fields of `FleetConfig`.

    Raises:
        ConfigError: If a figure is out of range.
    """
    from ridlink.geodesy import Geodetic
    from sitl_sim.fleet_config import FleetConfig

    return FleetConfig(
        seed=fleet["seed"],
        autopilot=fleet["autopilot"],
        gnss=fleet["gnss"],
        sigma_m=fleet["sigma_m"],
        gnss_common_share=fleet["gnss_common"],
        gnss_time_constant_s=fleet["gnss_time_s"],
        airframe=fleet["airframe"],
        start=start,
        technology=fleet["technology"],
        range_m=fleet["range_m"],
        loss=fleet["loss"],
        home=None if fleet["home"] is None else Geodetic(*fleet["home"]),
        **ports_and_more,
    )
