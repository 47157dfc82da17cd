"""``ridlink fly`` as a process of its own, with MAVSDK's real library, against emulated vehicles."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import subprocess
import sys
from asyncio.subprocess import PIPE
from typing import Any

import pytest
from click.testing import CliRunner

from ridlink.avoidance.solver import warm_up
from ridlink.avoidance.types import SolverKind
from ridlink.cli import cli
from ridlink.scenario import Event, Scenario, VehicleSpec
from sitl_sim.server import FleetServer
from tests.sitl_sim.test_server import ANY_PORT, fly, fly_both_autopilots

needs_mavsdk = pytest.mark.skipif(
    importlib.util.find_spec("mavsdk") is None, reason="the extra mavsdk is not installed"
)

NEAR = "47.398668,8.545594"
"""Three metres north of where the only vehicle of a circle takes off."""


async def conduct(*arguments: str) -> tuple[int, list[dict[str, Any]], str]:
    """Exit code, lines of JSON, and what was said on standard error."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "ridlink", "fly", "--json", *arguments, stdout=PIPE, stderr=PIPE
    )
    output, said = await process.communicate()
    assert process.returncode is not None
    return process.returncode, [json.loads(line) for line in output.splitlines()], said.decode()


@needs_mavsdk
def test_it_takes_off_hands_over_arrives_and_lands_with_either_autopilot() -> None:
    """With MAVSDK and a daemon as processes, so it lasts as long as such a flight."""
    warm_up(SolverKind.HALFPLANE)  # else both daemons compile while they hover

    async def act(server: FleetServer) -> None:
        url = f"udpout:127.0.0.1:{server.ports.vehicles[0]}"
        daemon = f"--vehicle {url} --rid udpout:127.0.0.1:{server.ports.air} --goal {NEAR} --cruise 3"
        code, lines, said = await conduct("--vehicle", url, "--takeoff", "2", "--land", "--daemon", daemon)
        final = lines[-1]
        assert code == 0, said
        assert (final["event"], final["outcome"]) == ("final", "done")
        assert final["took_off"] and final["arrived"] and final["landed"]
        pilot = server.autopilots[0].pilot
        assert not pilot.armed and not pilot.navigation.in_air
        assert "handed over: the daemon steers" in said and "engaged: avoiding" in said
        position = server.world.position_ned_m[0]
        assert position[0] == pytest.approx(100.0 + 3.0, abs=2.0)
        if server.config.autopilot == "px4":  # what it took off with is not left behind
            assert server.autopilots[0].pilot.speeds._parameters["MIS_TAKEOFF_ALT"] == 2.5

    fly_both_autopilots(act)


@needs_mavsdk
def test_a_vehicle_without_a_fix_is_not_armed_and_what_is_missing_is_said() -> None:
    event = Event(0.0, 0, "gnss-outage", {"duration_s": 0.0})
    lost = Scenario("lost", 60.0, (VehicleSpec((0.0, 0.0, -50.0), (9.0, 0.0, -50.0)),), events=(event,))

    async def act(server: FleetServer) -> None:
        server.begin_mission()
        url = f"udpout:127.0.0.1:{server.ports.vehicles[0]}"
        code, lines, said = await conduct("--vehicle", url, "--takeoff", "2", "--health-timeout", "1")
        assert code == 1 and not server.autopilots[0].pilot.armed
        assert lines[-1]["outcome"] == "failed" and not lines[-1]["took_off"]
        assert "not healthy after 1 s: no global position" in said and "Traceback" not in said

    fly(lost, act, **ANY_PORT)


@needs_mavsdk
def test_a_daemon_that_cannot_start_keeps_the_vehicle_on_the_ground() -> None:
    async def act(server: FleetServer) -> None:
        url = f"udpout:127.0.0.1:{server.ports.vehicles[0]}"
        daemon = f"--vehicle udpin:127.0.0.1:{server.ports.vehicles[0]} --goal {NEAR}"
        code, _, said = await conduct("--vehicle", url, "--takeoff", "2", "--daemon", daemon)
        assert code == 1 and not server.autopilots[0].pilot.armed
        assert "in use" in said and "ridlink: the daemon ended" in said

    fly(Scenario("one", 60.0, (VehicleSpec((0.0, 0.0, -50.0), (9.0, 0.0, -50.0)),)), act, **ANY_PORT)


@needs_mavsdk
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--takeoff", "0"], "must be a number above 0"),
        (["--takeoff", "5", "--vehicle", "udp:127.0.0.1:14580"], "udpin:127.0.0.1:14580"),
        (["--takeoff", "5", "--daemon", "--gaol 1,2"], "--daemon: No such option '--gaol'"),
        (["--takeoff", "5", "--daemon", '--goal "1,2'], "--daemon: No closing quotation"),
        ([], "Missing option '--takeoff'"),
    ],
)
def test_what_cannot_be_flown_is_refused_before_anything_is_opened(arguments: list[str], words: str) -> None:
    result = CliRunner().invoke(cli, ["fly", *arguments])
    assert result.exit_code == 2 or type(result.exception).__name__ == "ConfigError"
    assert words in result.output or words in str(result.exception)


def test_without_the_extra_one_line_names_the_remedy() -> None:
    program = "import sys; sys.modules['mavsdk'] = None; sys.argv = ['ridlink', 'fly', '--takeoff', '5']; "
    program += "from ridlink.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr == "ridlink: the conductor needs the extra 'mavsdk': pip install 'ridlink[mavsdk]'\n"
