"""``ridlink sim``: a fleet of emulated vehicles on loopback."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ridlink.cli.options import Within
from ridlink.cli.printing import PAGING_S, Printer
from ridlink.cli.signals import end_by_interrupts, stopped_by_signals
from ridlink.words import counted
from sitl_sim.cli.options import fleet_config, fleet_options

if TYPE_CHECKING:
    from sitl_sim.server import FleetServer

REPORT_S = 1.0
LONGEST_LINE = 65536
REFUSED_ON_AIR = ("malformed", "no_position", "refused", "overflow")
"""Counters of the air for datagrams that no receiver, or only observers, got."""


@click.command(short_help="Emulate a fleet that MAVSDK, mavutil and MAVProxy take for real.")
@fleet_options
@click.option("--airborne", is_flag=True, help="Hover at the start and obey setpoints, instead of standing unarmed.")
@click.option(
    "--duration",
    "duration_s",
    type=Within(0.0, min_open=True),
    metavar="S",
    help="Stop after this time.  [default: Ctrl-C, SIGTERM, or when the terminal goes]",
)
@click.option(
    "--until-arrived",
    is_flag=True,
    help="End when all have arrived or collided, or the scenario's time is up, which from the ground begins when all "
    "fly by setpoints; exit code 1 unless all arrived and none collided.",
)
@click.option("--no-rid", is_flag=True, help="Vehicles do not broadcast Remote ID; their daemons may.")
@click.option(
    "--vehicle-port",
    type=click.IntRange(0, 65535),
    default=14580,
    show_default=True,
    metavar="PORT",
    help="Port of the first vehicle, the others follow; 0 = any.",
)
@click.option(
    "--companion-port",
    type=click.IntRange(0, 65535),
    default=14540,
    show_default=True,
    metavar="PORT",
    help="Where the first vehicle sends telemetry unasked, the others follow; 0 = nowhere.",
)
@click.option(
    "--air-port",
    type=click.IntRange(0, 65535),
    default=14650,
    show_default=True,
    metavar="PORT",
    help="Port of the broadcast medium; 0 = any.",
)
@click.option("--any-ports", is_flag=True, help="As these three with 0: the kernel chooses, the first line tells.")
@click.option("--rid-on-bus", is_flag=True, help="Each vehicle's bus carries the Remote ID it hears (component 236).")
@click.option("--gcs", metavar="URL", help="Show the ten vehicles nearest to vehicle 1 there, as in udpout:HOST:14550.")
@click.option(
    "--speedup",
    type=Within(0.0, 100.0, min_open=True),
    default=1.0,
    show_default=True,
    metavar="X",
    help="Fly so many times as fast, for clients that follow SYSTEM_TIME.",
)
@click.option("--stdin", "from_stdin", is_flag=True, help="Faults from stdin, one JSON object a line.")
@click.option("--list", "lists", is_flag=True, help="List scenarios, airframes, technologies and faults, and end.")
@click.option("--explain", is_flag=True, help="Print what the scenario contains, and end.")
@click.option(
    "--daemon-config",
    "daemon_of",
    type=int,
    metavar="N",
    help="Print what 'ridlink avoid --config' needs to fly vehicle N: goal, obstacles, links, speed; and end.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object a second, the verdict last; or one of --list.")
def sim(
    fleet: dict[str, Any],
    airborne: bool,
    duration_s: float | None,
    until_arrived: bool,
    no_rid: bool,
    vehicle_port: int,
    companion_port: int,
    air_port: int,
    any_ports: bool,
    rid_on_bus: bool,
    gcs: str | None,
    speedup: float,
    from_stdin: bool,
    lists: bool,
    explain: bool,
    daemon_of: int | None,
    as_json: bool,
) -> int:
    """Emulate a fleet that MAVSDK, mavutil and MAVProxy take for real.

    Vehicle i has system id i, listens on UDP 127.0.0.1:14580+i-1 and sends its telemetry to 127.0.0.1:14540+i-1. Remote
    ID is broadcast on the air, 127.0.0.1:14650: send a HEARTBEAT there and hear what that vehicle would hear, or
    everything with system id 255.

    \b
    Examples:
      ridlink sim -n 1
      ridlink sim --scenario head-on --airborne --autopilot ardupilot
      ridlink sim --scenario crossing --airborne --no-rid --until-arrived --json
      ridlink sim -n 0                    # the air alone, for your own vehicles
      ridlink sim --scenario tracks.geojson --explain
      echo '{"vehicle":1,"what":"gnss-outage","duration_s":10}' | ridlink sim --airborne --stdin
    """
    import asyncio
    import json
    import logging
    from dataclasses import replace

    from ridlink.scenario import resolve_scenario
    from sitl_sim.autopilot import Start
    from sitl_sim.cli import explained
    from sitl_sim.server import FleetServer

    if lists:
        click.echo(json.dumps(explained.choices()) if as_json else explained.everything())
        return 0
    chosen = resolve_scenario(fleet["scenario"], fleet["count"], speed_mps=fleet["speed_mps"])
    if fleet["interval_s"] is not None:
        chosen = replace(chosen, interval_s=fleet["interval_s"])
    if any_ports:
        vehicle_port = companion_port = air_port = 0
    config = fleet_config(
        fleet,
        Start.AIRBORNE if airborne else Start.GROUND,
        remote_id=not no_rid,
        vehicle_port=vehicle_port,
        companion_port=companion_port,
        air_port=air_port,
        rid_on_bus=rid_on_bus,
        ground_station=gcs,
        speedup=speedup,
    )
    if explain:
        click.echo(explained.scenario_text(chosen, config))
        return 0
    if daemon_of is not None:
        from sitl_sim.demo.daemons import daemon_toml

        click.echo(daemon_toml(chosen, config, daemon_of), nl=False)
        return 0
    server = FleetServer(chosen, config)
    end_by_interrupts()
    printer = Printer()
    logging.basicConfig(format="ridlink sim: %(message)s", level=logging.WARNING, stream=printer.stream(error=True))
    try:
        return asyncio.run(_run(server, printer, duration_s, until_arrived, as_json, from_stdin))
    finally:
        printer.close()


async def _run(
    server: FleetServer,
    printer: Printer,
    duration_s: float | None,
    until_arrived: bool,
    as_json: bool,
    from_stdin: bool,
) -> int:
    """Fly until time is up, the flight is over, the reader of the lines has gone, or a signal comes. A second signal
    ends the process at once."""
    import asyncio
    import json

    from ridlink.companions import beside
    from sitl_sim.cli.notices import Notices
    from sitl_sim.server import PortError

    loop = asyncio.get_running_loop()
    stop = stopped_by_signals(loop)
    notices = Notices(server)

    def notify() -> None:
        for line in notices.fresh():
            printer.put(f"ridlink sim: {line}\n", error=True)

    def end() -> None:
        printer.patience_s = PAGING_S  # nobody asked for the end, so the reader may take longer
        stop.set()

    try:
        await server.start()
    except PortError as error:
        others = "choose other ports with --vehicle-port and --air-port, or leave them to the kernel with --any-ports"
        raise PortError(f"{error}; stop it, or {others}") from error
    printer.put(f"{_greeting(server)}\n", error=True)
    if duration_s is not None:
        loop.call_later(duration_s / server.config.speedup, end)
    if from_stdin:
        _read_faults(server, printer)
    try:
        async with beside(server.run(stop)):
            while not stop.is_set():
                try:
                    await asyncio.wait_for(stop.wait(), REPORT_S)
                except TimeoutError:
                    notify()
                    if as_json:
                        facts = {"ports": _ports(server), **server.snapshot()}
                        printer.put(json.dumps(facts, separators=(",", ":")) + "\n")
                    if printer.reader_has_gone or (until_arrived and server.world.finished):
                        end()
    finally:
        await server.close()
    notify()
    printer.put((json.dumps(_verdict(server), separators=(",", ":")) if as_json else _verdict_line(server)) + "\n")
    return int(until_arrived and not (server.mission_begun and server.world.verdict().passed))


def _read_faults(server: FleetServer, printer: Printer) -> None:
    """Inject events from stdin, one JSON object a line; a wrong line is reported and skipped.

    Runs in a thread: an event loop can wait only for pipes and terminals, and stdin may also be a file or /dev/null.
    """
    import asyncio
    import contextlib
    import json
    import os
    import sys
    import threading

    from ridlink.errors import ConfigError
    from ridlink.scenario import event_of

    def tell(text: str) -> None:
        printer.put(f"ridlink sim: {text}\n", error=True)

    def take(line: bytes) -> None:
        try:
            try:
                values = json.loads(line)
            except (ValueError, RecursionError):
                values = None
            if not isinstance(values, dict):
                begin = json.dumps(line[:40].decode(errors="backslashreplace"), ensure_ascii=True)
                raise ConfigError(f'stdin: {begin} is no JSON object, as in {{"vehicle":1,"what":"gnss-outage"}}')
            server.world.inject(event_of(values, "stdin", at_s=0.0))
        except ValueError as error:
            tell(str(error))

    loop = asyncio.get_running_loop()

    def read() -> None:
        rest = b""
        with contextlib.suppress(OSError, RuntimeError):  # closed, or the loop has ended before it
            while chunk := os.read(sys.stdin.fileno(), LONGEST_LINE):
                *lines, rest = (rest + chunk).split(b"\n")
                for line in filter(bytes.strip, lines):
                    loop.call_soon_threadsafe(take, line)
                if len(rest) > LONGEST_LINE:
                    rest = b""
                    loop.call_soon_threadsafe(tell, "stdin: a line without an end was dropped")
            if rest.strip():
                loop.call_soon_threadsafe(take, rest)

    threading.Thread(target=read, name="stdin", daemon=True).start()


def _greeting(server: FleetServer) -> str:
    ports, config, vehicles = server.ports, server.config, len(server.autopilots)
    if not vehicles:
        return f"ridlink sim: 0 vehicles, air {ports.air}"  # no vehicle flies the scenario
    text = f"ridlink sim: {server.scenario.name}, {counted(vehicles, 'vehicle')}"
    text += f" ({config.autopilot}, {config.start}) on UDP {_range(ports.vehicles)}"
    if config.companion_port:
        companions = tuple(range(config.companion_port, config.companion_port + vehicles))
        text += f", telemetry to {_range(companions)}"
    return f"{text}, air {ports.air}"


def _ports(server: FleetServer) -> dict[str, Any]:
    return {"vehicles": list(server.ports.vehicles), "air": server.ports.air}


def _range(ports: tuple[int, ...]) -> str:
    if len(ports) > 1 and ports == tuple(range(ports[0], ports[0] + len(ports))):
        return f"{ports[0]}-{ports[-1]}"
    return ",".join(map(str, ports))


def _verdict(server: FleetServer) -> dict[str, Any]:
    return {
        "scenario": server.scenario.name,
        "seed": server.config.seed,
        "time_s": round(server.world.time_s, 2),
        "mission_begun": server.mission_begun,
        "internal_errors": server.counters["error"],
        "stood_still_ms": server.counters["slipped_ms"],
        "refused": {
            cause: sum(autopilot.counters[cause] for autopilot in server.autopilots)
            for cause in ("bad_frame", "refused_peer", "not_passed_on")
        },
        "air": {cause: server.air.counters[cause] for cause in ("broadcast", "delivered", *REFUSED_ON_AIR)},
        **server.world.verdict().as_dict(),
    }


def _verdict_line(server: FleetServer) -> str:
    if not server.autopilots:
        return f"0 vehicles: {server.world.time_s:.1f} s"
    if not server.mission_begun:
        return f"{server.scenario.name}: {server.world.time_s:.1f} s, no mission was flown"
    verdict = server.world.verdict()
    nearest = "" if verdict.min_separation_m is None else f", nearest {verdict.min_separation_m:.1f} m"
    flown = f"{server.scenario.name}: {server.world.mission_time_s:.1f} s"
    hits = f", {verdict.obstacle_hits} flew into an obstacle" if verdict.obstacle_hits else ""
    collided = f"{counted(verdict.macs, 'collision')}{hits}"
    return f"{flown}, {verdict.arrived} of {verdict.vehicles} arrived, {collided}{nearest}"
