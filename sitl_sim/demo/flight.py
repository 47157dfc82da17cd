"""One flight from the first socket to the verdict."""

from __future__ import annotations

import asyncio
import os
import tempfile
from collections.abc import Sequence
from contextlib import AsyncExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ridlink.avoidance.types import SolverKind
from ridlink.captures.recorder import Recorder
from ridlink.companions import beside
from ridlink.compiled import how_often_compiled
from ridlink.daemon.warming import warm_up_unless
from ridlink.errors import ConfigError, LinkError
from ridlink.scenario import Scenario, resolve_scenario
from ridlink.words import counted
from sitl_sim.demo.conductors import Conductors
from sitl_sim.demo.daemons import Assignment, Daemons, assignments
from sitl_sim.demo.ground_station import GroundStation
from sitl_sim.demo.options import DemoOptions
from sitl_sim.demo.screen import Screen
from sitl_sim.fleet_config import HOST
from sitl_sim.pair_radius import pair_radius_under
from sitl_sim.server import FleetServer
from sitl_sim.vehicle import VehicleState

HAND_OVER_TIMEOUT_S = 20.0
LOOK_S = 0.2
WORTH_A_WORD_S = 1.0
LONGEST_NAME = 40
"""Characters of a scenario's name in the name of its log: in UTF-8 they fit into any file system."""


def scenario_of(options: DemoOptions) -> Scenario:
    """The scenario of a flight.

    Raises:
        ConfigError: If there is no such scenario, it is wrong, or it has no vehicles.
        OSError: If its file cannot be read.
    """
    scenario = resolve_scenario(options.scenario, options.count, speed_mps=options.speed_mps)
    options.fleet.autopilots_of(scenario)
    if all(vehicle.ghost for vehicle in scenario.vehicles):
        raise ConfigError(f"{scenario.name}: there is nobody to fly; 'ridlink sim' shows an empty sky and its ghosts")
    return scenario if options.interval_s is None else replace(scenario, interval_s=options.interval_s)


class Onlooker:
    """An observer of a flight; this base class does nothing."""

    def ready(self) -> None:
        """The fleet has its ports, so the flight can begin."""

    async def begin(self, fleet: FleetServer, title: str, options: DemoOptions) -> None:
        """The fleet is ready, and the solver has been loaded."""

    def hear(self, data: bytes) -> None:
        """A datagram of the air."""

    async def end(self) -> None:
        """The flight is over."""


async def fly(options: DemoOptions, screen: Screen, onlooker: Onlooker | None = None) -> dict[str, Any]:
    """Fly once; the result has the keys of ``ridlink demo --json``, and ``passed`` and ``details``.

    Raises:
        ConfigError: If the scenario is wrong.
        LinkError: If a port is in use, a daemon does not start or ends too early, or a vehicle is not handed over.
        OSError: If the scenario cannot be read or the log cannot be written.
    """
    scenario = scenario_of(options)
    title = _title(options, scenario)
    onlooker = onlooker or Onlooker()
    judged_by = pair_radius_under(options.definition, options.eta, options.accuracy_convention)
    server = FleetServer(scenario, options.fleet, pair_radius=judged_by)
    conductors: Conductors | None = None
    async with AsyncExitStack() as ends:  # what began last ends first
        await _open(server)
        ends.push_async_callback(server.close)
        log = _log_path(options, scenario)
        recorder = Recorder(log, overwrite=True)
        ends.push_async_callback(_end_recording, recorder, log, screen)
        onlooker.ready()
        await ends.enter_async_context(beside(server.run(asyncio.Event())))
        ends.push_async_callback(onlooker.end)
        ports = server.ports
        station = GroundStation(ports.vehicles, ports.air, recorder.receive, onlooker.hear)
        ends.push_async_callback(station.close)
        await station.open()
        await ends.enter_async_context(beside(station.say_hello()))
        assigned = assignments(
            scenario,
            options.definition,
            options.fleet,
            ports,
            options.eta,
            options.solver,
            vertical=options.vertical,
            accuracy_convention=options.accuracy_convention,
        )
        await _warm(screen, options.solver, options.processes, len(assigned))
        await onlooker.begin(server, title, options)
        daemons = Daemons(assigned, each_its_own=options.processes)
        ends.push_async_callback(daemons.stop)
        if options.from_ground and assigned:
            conductors = _conductors(scenario, assigned, ports.vehicles, screen)
            ends.push_async_callback(conductors.close)
            screen.say(f"{counted(len(assigned), 'vehicle')} to arm and climb, each with its conductor ...")
            await conductors.take_off()
        await daemons.start()
        if conductors is not None:
            await conductors.hand_over()
        else:
            await station.hand_over([each.system_id for each in assigned], HAND_OVER_TIMEOUT_S)
        if not server.mission_begun:  # the handover may have begun it
            server.begin_mission()
        slipped_ms = server.counters["slipped_ms"]
        await _watch(server, daemons, screen, title)
        slipped_ms = server.counters["slipped_ms"] - slipped_ms
        if conductors is not None and server.world.arrived.all():
            screen.say("All have arrived, and land ...")
            await conductors.wait_landed()
        summaries = await daemons.stop()
    return {
        **_result(options, server, summaries, log, None if conductors is None else len(conductors.landed)),
        "stood_still_ms": slipped_ms,
    }


async def _end_recording(recorder: Recorder, log: Path, screen: Screen) -> None:
    """Write queued records, and report what is missing."""
    await asyncio.to_thread(recorder.close)
    if recorder.error is not None:
        screen.complain(f"{log}: the recording ended early: {recorder.error.strerror}")
    elif recorder.dropped:
        dropped = counted(recorder.dropped, "datagram")
        screen.complain(f"{log}: {dropped} came faster than they could be written")


def _conductors(scenario: Scenario, assigned: Sequence[Assignment], ports: Sequence[int], screen: Screen) -> Conductors:
    urls = [f"udpout:{HOST}:{ports[each.system_id - 1]}" for each in assigned]
    heights = [-scenario.vehicles[each.system_id - 1].start_ned_m[2] for each in assigned]
    return Conductors(urls, heights, screen.say)


async def _open(server: FleetServer) -> None:
    try:
        await server.start()
    except LinkError as error:
        raise LinkError(f"{error}; stop it, or let the kernel choose the ports with --any-ports") from error


def _log_path(options: DemoOptions, scenario: Scenario) -> Path:
    if options.log is not None:
        return options.log
    name = Path(scenario.name).stem[:LONGEST_NAME]
    stem = f"ridlink-{name}-{options.definition}-{options.fleet.seed}-"
    handle, name = tempfile.mkstemp(prefix=stem, suffix=".tlog")
    os.close(handle)
    return Path(name)


def _title(options: DemoOptions, scenario: Scenario) -> str:
    how = f"under {options.definition} by {options.solver}{', climbing too' if options.vertical else ''}"
    return f"{scenario.name}, {counted(len(scenario.vehicles), 'vehicle')} {how}, seed {options.fleet.seed}"


async def _warm(screen: Screen, solver: SolverKind, processes: bool, count: int) -> None:
    """Load the solver before the flight, and say so if that takes long; a signal must not wait for it."""
    warming = asyncio.create_task(warm_up_unless(asyncio.Event(), solver))
    done, _ = await asyncio.wait([warming], timeout=WORTH_A_WORD_S)
    if not done:
        screen.say(f"Compiling the solver ({how_often_compiled()}; up to half a minute) ...")
    await warming
    if processes:
        screen.say(f"Starting {counted(count, 'daemon')}, each a process of its own ...")


async def _watch(server: FleetServer, daemons: Daemons, screen: Screen, title: str) -> None:
    """Show the flight until there is nothing to wait for."""
    if not screen.has_table:
        screen.say(f"Flying {title} (at most {server.scenario.duration_s:.0f} s) ...")
    with screen.flight(title):
        while not (server.world.finished or _all_stand(server)):
            screen.update(server.world, title, daemons.status)
            await asyncio.sleep(LOOK_S)
            daemons.check()


def _all_stand(server: FleetServer) -> bool:
    """Whether all that have not arrived are on the ground and disarmed: daemons arm nobody, so they will not fly."""
    world = server.world
    waited_for = np.flatnonzero(~(world.arrived | world.is_ghost | (world.state == VehicleState.GONE))).tolist()
    return all(
        world.state[row] == VehicleState.GROUNDED and not server.autopilots[row].pilot.armed for row in waited_for
    )


def _result(
    options: DemoOptions, server: FleetServer, summaries: Sequence[dict[str, Any]], log: Path, landed: int | None
) -> dict[str, Any]:
    """The result of a flight; a fleet from the ground must have landed, too."""
    verdict = server.world.verdict()
    judged = verdict.as_dict()
    details = judged.pop("details", [])
    return {
        "scenario": server.scenario.name,
        "definition": str(options.definition),
        "accuracy_convention": str(options.accuracy_convention),
        "seed": options.fleet.seed,
        **judged,
        **({} if landed is None else {"landed": landed}),
        "setpoints": sum(summary["setpoints"] for summary in summaries),
        "reports_received": sum(summary["reports_received"] for summary in summaries),
        "decision_ms": _worst(summaries, "decision_ms", ("p50", "p99", "max")),
        "setpoint_gap_ms": _worst(summaries, "setpoint_gap_ms", ("p99", "max")),
        "infeasible_steps": sum(summary["infeasible_steps"] for summary in summaries),
        "solver": str(options.solver),
        "vertical": options.vertical,
        "autopilot": options.fleet.autopilot,
        "gnss": options.fleet.gnss,
        "passed": verdict.passed and landed in (None, len(summaries)),
        "details": details,
        "log": str(log),
    }


def _worst(summaries: Sequence[dict[str, Any]], quantity: str, figures: Sequence[str]) -> dict[str, float | None]:
    """For each figure the worst daemon's value, since an average would hide a stuttering one. None without daemons."""
    return {figure: max((s[quantity][figure] for s in summaries), default=None) for figure in figures}
