"""``ridlink avoid``: the avoidance daemon."""

from __future__ import annotations

import asyncio
import gc
import json
from typing import TYPE_CHECKING, Any

import click

from ridlink.cli import EXIT_DONE, EXIT_INTERNAL, EXIT_NEGATIVE
from ridlink.cli.flight_lines import FlightPrinter, HumanPrinter, JsonPrinter
from ridlink.cli.options import ACCURACY_CONVENTION, DEFINITION, NAME, eta_option, signing_options
from ridlink.cli.signals import ended_by_signals
from ridlink.words import counted

if TYPE_CHECKING:
    from ridlink.daemon.config import DaemonConfig
    from ridlink.daemon.summary import Summary


def _goal(_: click.Context, __: click.Parameter, value: str | None) -> tuple[float, ...] | None:
    if value is None:
        return None
    try:
        parts = tuple(float(part) for part in value.split(","))
    except ValueError:
        parts = ()
    if len(parts) not in (2, 3):
        raise click.BadParameter(f"{value!r} is not LAT,LON or LAT,LON,ALT, as in 47.39,8.54,540")
    return parts


@click.command(short_help="Keep one vehicle's distance: the daemon beside an autopilot.")
@click.option("--vehicle", metavar="URL", help="Link to the autopilot.  [default: udpin:127.0.0.1:14540]")
@click.option("--rid", metavar="URL", help="Link on which Remote ID is heard.  [default: udpout:127.0.0.1:14650]")
@click.option(
    "--goal",
    metavar="LAT,LON[,ALT]",
    callback=_goal,
    help="Where to fly; ALT in metres above mean sea level, the present altitude if left out.",
)
@click.option("--standby", is_flag=True, default=None, help="Do nothing until MAV_CMD_DO_REPOSITION names a goal.")
@click.option(
    "--guard",
    is_flag=True,
    default=None,
    help="Watch while the autopilot flies its own plan; take over for a conflict, then hand back mode and mission.",
)
@click.option(
    "--takeoff-aware",
    is_flag=True,
    default=None,
    help="Never interrupt a climb-out, unless a mid-air collision is predicted.",
)
@click.option(
    "--takeoff-height",
    type=float,
    metavar="M",
    help="Of --takeoff-aware: a climb below this height over home is a climb-out.  [default: 20]",
)
@click.option(
    "--definition",
    metavar="NAME",
    help=f"{DEFINITION}  [default: candidate2]",
)
@eta_option(None)
@click.option(
    "--chance-bound",
    metavar="NAME",
    help="Of chance: halfplane, covariance or contours, from tight to loose.  [default: halfplane]",
)
@click.option(
    "--accuracy-convention",
    metavar="NAME",
    help=f"{ACCURACY_CONVENTION}  [default: letter]",
)
@click.option(
    "--solver",
    metavar="NAME",
    help="What chooses the velocity: halfplane, graded (faster in traffic, promises no distance) or rotation (the "
    "paper's).  [default: halfplane]",
)
@click.option("--cruise", type=float, metavar="M/S", help="Speed towards the goal.  [default: 10]")
@click.option("--airframe", type=float, metavar="M", help="Own largest extent, rotors turning.  [default: 0.6]")
@click.option("--airframe-height", type=float, metavar="M", help="Own vertical extent.  [default: as --airframe]")
@click.option("--v-max", type=float, metavar="M/S", help="Horizontal speed limit of setpoints.  [default: 15]")
@click.option("--vz-max", type=float, metavar="M/S", help="Vertical speed limit of setpoints.  [default: 2]")
@click.option("--a-max", type=float, metavar="M/S2", help="Largest change of setpoints per second.  [default: 5]")
@click.option(
    "--response-time",
    type=float,
    metavar="S",
    help="How long the vehicle flies on before it obeys, whatever response_time_s of a solver says; 0: it obeys at "
    "once.  [default: 1]",
)
@click.option("--vertical", is_flag=True, default=None, help="Climb or descend, too, where turning is not enough.")
@click.option(
    "--vertical-cost",
    type=float,
    metavar="SHARE",
    help="Of --vertical: climb or descend where turning and slowing cost more than this share of the cruise speed.  "
    "[default: 0.25]",
)
@click.option(
    "--vertical-band",
    type=float,
    metavar="M",
    help="Of --vertical: stay this near to the altitude of the goal.  [default: 40]",
)
@click.option("--min-height", type=float, metavar="M", help="Of --vertical: least height over home.  [default: 20]")
@click.option("--max-height", type=float, metavar="M", help="Of --vertical: largest height over home.  [default: 120]")
@click.option(
    "--vehicle-sysid",
    type=click.IntRange(1, 255),
    metavar="N",
    help="Listen to this system id only.  [default: the first autopilot heard]",
)
@click.option(
    "--broadcast", is_flag=True, default=None, help="Also transmit the vehicle's own Remote ID, from what it reports."
)
@click.option(
    "--broadcast-to", metavar="URL", help="Where --broadcast transmits.  [default: on the Remote ID link, --rid]"
)
@click.option(
    "--broadcast-form",
    metavar="NAME",
    help="air for receivers that speak MAVLink, module for a transmitter module.  [default: air]",
)
@click.option("--operator-id", metavar="ID", help="Identity of the operator in --broadcast.  [default: none]")
@signing_options
@click.option("--uas-id", metavar="ID", help="Own identity in Remote ID.  [default: as the vehicle says]")
@click.option(
    "--config",
    "config_file",
    type=NAME,
    metavar="FILE.toml",
    help="Keys as these options, with underscores; options win. Obstacles stand here only.",
)
@click.option("--log", type=NAME, metavar="FILE.tlog",
              help="Record everything received and sent; replaces the file.")  # fmt: skip
@click.option("--metrics", metavar="HOST:PORT", help="Serve Prometheus metrics there (extra metrics).")
@click.option(
    "--input-log",
    type=NAME,
    metavar="FILE",
    help="Record what --replay needs to decide the flight again; replaces the file.",
)
@click.option(
    "--replay",
    "replayed",
    type=NAME,
    metavar="FILE",
    help="Decide the flight of an input log again, without any link: prints the decisions with --json, and their hash.",
)
@click.option(
    "--dry-run",
    is_flag=True,
    default=None,
    help="Decide and say what would be sent, but send no setpoint and change no mode.",
)
@click.option(
    "--config-reference", "as_reference", is_flag=True, help="Print what a configuration file may contain, and exit."
)
@click.option("--allow-v1", is_flag=True, default=None, help="Take MAVLink 1 frames as well, on both links.")
@click.option(
    "--filter-positions/--no-filter-positions",
    default=None,
    help="Smooth reported positions, own and others'.  [default: true]",
)
@click.option("--print-config", is_flag=True, help="Print the configuration that would be flown, and exit.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line on standard output.")
def avoid(
    config_file: str | None,
    replayed: str | None,
    as_reference: bool,
    print_config: bool,
    as_json: bool,
    **options: Any,
) -> int:
    """Keep one vehicle's distance: hear Remote ID, steer by velocity setpoints.

    Engages as soon as the vehicle is armed and in GUIDED or OFFBOARD, and ends when the pilot changes the mode. Never
    arms, takes off or, without --guard, changes a mode itself. SIGTERM, Ctrl-C and the loss of its terminal stop the
    vehicle and end the program.

    \b
        ridlink avoid --goal 47.39,8.54,540
        ridlink avoid --guard --takeoff-aware
        ridlink avoid --vehicle udpin:0.0.0.0:14540 --standby --config vehicle.toml --log flight.tlog
    """
    if as_reference:
        from ridlink.daemon.reference import reference

        helps = {
            param.name: param.help or "" for param in avoid.params if isinstance(param, click.Option) and param.name
        }
        click.echo(reference(helps), nl=False)
        return EXIT_DONE
    gc.disable()  # until the daemon runs: imports make no garbage, and looking for it takes a sixth
    try:
        return _avoid(config_file, replayed, print_config, as_json, options)
    finally:
        gc.enable()


def _avoid(
    config_file: str | None, replayed: str | None, print_config: bool, as_json: bool, options: dict[str, Any]
) -> int:
    from ridlink.daemon.config import as_toml, configured

    if replayed is not None:
        return _replay(replayed, as_json)
    config = configured(config_file, options)
    if print_config:
        click.echo(as_toml(config), nl=False)
        return EXIT_DONE
    if config.engine.goal is None and not config.engine.standby and not config.engine.guard:
        raise click.UsageError(
            "where to? Give --goal LAT,LON[,ALT], or --standby to wait for MAV_CMD_DO_REPOSITION, or --guard to watch"
        )
    return _fly(config, as_json)


def configuration(context: click.Context) -> DaemonConfig:
    """The configuration of a daemon that is started with the options of this context.

    Raises:
        ConfigError: If the daemon would refuse it.
        OSError: If its file cannot be read.
    """
    from ridlink.daemon.config import configured

    others = ("config_file", "replayed", "as_reference", "print_config", "as_json")
    options = {name: value for name, value in context.params.items() if name not in others}
    return configured(context.params["config_file"], options)


def _replay(path: str, as_json: bool) -> int:
    from ridlink.daemon.input_log import replay

    decisions, flown = replay(path, (lambda line: click.echo(line.decode())) if as_json else None)
    same = decisions.digest == flown
    if as_json:
        facts = {
            "event": "replayed",
            "steps": decisions.steps,
            "decision_log": decisions.digest,
            "flown": flown or None,
        }
        click.echo(json.dumps(facts))
    else:
        verdict = (
            "as flown" if same else f"flown was {flown}" if flown else "the log does not reach the end of the flight"
        )
        click.echo(f"{counted(decisions.steps, 'decision', 'd')}, {decisions.digest}: {verdict}")
    return EXIT_DONE if same or not flown else EXIT_NEGATIVE


def _fly(config: DaemonConfig, as_json: bool) -> int:
    from ridlink.daemon.service import DecisionError

    printer: FlightPrinter = JsonPrinter() if as_json else HumanPrinter(str(config.vehicle))
    code = EXIT_DONE
    try:
        summary = asyncio.run(_run(config, printer))
        printer.final(summary)
    except DecisionError as error:
        click.echo(f"ridlink: {error}", err=True)
        code = EXIT_INTERNAL
    finally:
        printer.close()
    return code


async def _run(config: DaemonConfig, printer: FlightPrinter) -> Summary:
    from ridlink.daemon.service import AvoidDaemon

    stop = asyncio.Event()
    ended_by_signals(asyncio.get_running_loop(), stop.set)
    return await AvoidDaemon(config, on_event=printer.event).run(stop)
