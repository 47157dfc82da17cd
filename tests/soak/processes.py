"""Flights of programs: `ridlink sim --no-rid` with two PX4s and two ArduPilots, and an `avoid --broadcast` for each.

    python -m tests.soak.processes [--flights 20] [--only crossing] [--together 2]

Head-on and crossing in real time, one vehicle of each autopilot in every encounter. Each flight is five processes that
know nothing of each other but ports, which the kernel chooses, so that flights may go on side by side; the emulator's
referee judges.
Ends with 1 if two vehicles collided, one did not arrive, or a program failed.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import tempfile
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

from ridlink.geodesy import geodetic_from_ned
from ridlink.scenario import Scenario, resolve_scenario
from sitl_sim.fleet_config import HOST, FleetConfig
from tests.soak.flights import MIXED, Cell, Flown, concluded, mixed

SCENARIOS = ("head-on", "crossing")
STOP_S = 10.0
"""For a program that was asked to end."""

LATE = 2.0
"""A fleet that has not ended by itself after so many times the scenario's duration never will."""


def as_toml(scenario: Scenario) -> str:
    """A scenario as `--scenario` reads it, as far as `mixed` fills one."""
    lines = [f"name = '{scenario.name}'", f"duration_s = {scenario.duration_s}"]
    for vehicle in scenario.vehicles:
        lines += ["[[vehicle]]", f"autopilot = '{vehicle.autopilot}'", f"speed_mps = {vehicle.speed_mps}"]
        lines += [f"start_ned_m = {list(vehicle.start_ned_m)}", f"goal_ned_m = {list(vehicle.goal_ned_m)}"]
    return "\n".join(lines) + "\n"


def goals(scenario: Scenario) -> list[str]:
    """Of every vehicle, as `--goal` reads it; each keeps its height."""
    home = FleetConfig().home_of(scenario)
    places = [geodetic_from_ned(vehicle.goal_ned_m, home) for vehicle in scenario.vehicles]
    return [f"{float(latitude):.7f},{float(longitude):.7f}" for latitude, longitude, _ in places]


@asynccontextmanager
async def program(*arguments: str, said: Path) -> AsyncIterator[asyncio.subprocess.Process]:
    """A command of ridlink, which does not outlive the block: asked to end, then made to. What it says to people goes
    into a file, which is shown if it fails."""
    with said.open("w") as file:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "ridlink", *arguments, stdout=asyncio.subprocess.PIPE, stderr=file
        )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.terminate()
            try:
                await asyncio.wait_for(process.wait(), STOP_S)
            except TimeoutError:
                process.kill()
                await process.wait()
        if process.returncode:
            print(f"ridlink {' '.join(arguments)}: {process.returncode}\n{said.read_text()}", flush=True)


async def fly(cell: Cell, seed: int, folder: Path) -> Flown:
    """One flight, from the first process to the verdict; a program that fails is an error of it."""
    scenario = mixed(resolve_scenario(cell.scenario, None))
    flight = f"{cell.scenario}-{seed}"
    file = folder / f"{flight}.toml"
    file.write_text(as_toml(scenario))
    fleet = ["sim", "--no-rid", "--airborne", "--until-arrived", "--json", "--seed", str(seed), "--scenario", str(file)]
    any_port = [word for kind in ("vehicle", "companion", "air") for word in (f"--{kind}-port", "0")]
    async with AsyncExitStack() as daemons, program(*fleet, *any_port, said=folder / f"{flight}-sim") as sim:
        assert sim.stdout is not None
        if not (first := await sim.stdout.readline()):
            raise SystemExit("the fleet did not start")
        ports = json.loads(first)["ports"]
        air = f"udpout:{HOST}:{ports['air']}"
        pilots = []
        for port, goal in zip(ports["vehicles"], goals(scenario), strict=True):
            avoid = ["avoid", "--broadcast", "--vehicle", f"udpout:{HOST}:{port}", "--rid", air, "--goal", goal]
            pilots.append(await daemons.enter_async_context(program(*avoid, said=folder / f"{flight}-{port}")))
        async with asyncio.timeout(LATE * scenario.duration_s):
            verdict = json.loads([line async for line in sim.stdout][-1])
            await sim.wait()
    flown = Flown.of(verdict, verdict["internal_errors"] + sum(process.returncode != 0 for process in pilots))
    if flown.arrived < flown.vehicles:
        words = [f"{path.name}:\n{path.read_text()}" for path in sorted(folder.glob(f"{flight}-*"))]
        print(f"{cell}, seed {seed}: not all arrived. What the programs said:", *words, sep="\n", flush=True)
    return flown


async def fly_all(cells: list[Cell], flights: int, first_seed: int, together: int) -> dict[Cell, list[Flown]]:
    """All cells, so many flights at a time; a line for each flight as it ends."""
    flown: dict[Cell, list[Flown]] = {cell: [] for cell in cells}
    room = asyncio.Semaphore(together)

    async def one(cell: Cell, seed: int, folder: Path) -> None:
        async with room:
            result = await fly(cell, seed, folder)
        flown[cell].append(result)
        words = f", {result.errors} programs or steps FAILED" if result.errors else ""
        print(f"{cell}, seed {seed}: {result}{words}", flush=True)

    with tempfile.TemporaryDirectory(prefix="ridlink-flights-") as folder:
        async with asyncio.TaskGroup() as group:
            for cell in cells:
                for seed in range(first_seed, first_seed + flights):
                    group.create_task(one(cell, seed, Path(folder)))
    return flown


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=20, help="flights of each scenario, about a minute each")
    parser.add_argument("--only", default="", help="scenarios whose name contains this")
    parser.add_argument("--seed", type=int, default=1, help="of the first flight")
    parser.add_argument("--together", type=int, default=2, help="flights at a time; each takes a third of a core")
    asked = parser.parse_args()
    cells = [Cell(scenario, MIXED, broadcast=True) for scenario in SCENARIOS if asked.only in scenario]
    try:
        flown = asyncio.run(fly_all(cells, asked.flights, asked.seed, asked.together))
    except KeyboardInterrupt:
        return 130
    stranded = any(result.arrived < result.vehicles for results in flown.values() for result in results)
    return concluded(flown) or int(stranded)


if __name__ == "__main__":
    sys.exit(main())
