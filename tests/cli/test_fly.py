"""``ridlink fly`` as a process of its own, with MAVSDK's real library, against emulated vehicles."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import os
import signal
import subprocess
import sys
from asyncio.subprocess import PIPE
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import Any

import pytest
from click.testing import CliRunner

from ridlink.avoidance.solver import warm_up
from ridlink.avoidance.types import SolverKind
from ridlink.cli import cli
from ridlink.errors import ConfigError
from ridlink.links import open_link, parse_link_url
from ridlink.mavlink.codec import Encoder
from ridlink.scenario import Event, Scenario, VehicleSpec, built_in
from sitl_sim.autopilot import streams
from sitl_sim.autopilot.modes import Mode
from sitl_sim.autopilot.results import Severity
from sitl_sim.fleet_config import FleetConfig, Start
from sitl_sim.server import FleetServer
from tests.loopback import turn
from tests.sitl_sim.fleets import ANY_PORT, fly, fly_both_autopilots, run

pytestmark = pytest.mark.programs
needs_mavsdk = pytest.mark.skipif(
    importlib.util.find_spec("mavsdk") is None, reason="the extra mavsdk is not installed"
)

NEAR = "47.398668,8.545594"
"""Three metres north of where the only vehicle of a circle takes off."""


FAR = "47.401742,8.545594"
"""Four hundred metres north of its circle's middle."""

POSITION = {"px4": 3.0, "ardupilot": 16.0}
"""Modes in which a pilot steers."""

MOMENTS = ("at 2 m", "handed over")
"""Words of the conductor upon which the pilot takes over."""


def vehicle_of(server: FleetServer) -> str:
    return f"udpout:127.0.0.1:{server.ports.vehicles[0]}"


def daemon_options(server: FleetServer, goal: str) -> list[str]:
    links = ["--vehicle", vehicle_of(server), "--rid", f"udpout:127.0.0.1:{server.ports.air}"]
    return [*links, "--goal", goal, "--cruise", "3"]


@asynccontextmanager
async def a_daemon(server: FleetServer, goal: str, *options: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """`ridlink avoid`, started by somebody else."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "ridlink", "avoid", *daemon_options(server, goal), *options), stdout=PIPE
    )
    try:
        yield process
    finally:
        process.terminate()
        await process.communicate()
    assert process.returncode == 0


def fly_command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "ridlink", "fly", "--json", *arguments]


async def conduct(*arguments: str) -> tuple[int, list[dict[str, Any]], str]:
    """Exit code, lines of JSON, and what was said on standard error."""
    process = await asyncio.create_subprocess_exec(*fly_command(*arguments), stdout=PIPE, stderr=PIPE)
    output, said = await process.communicate()
    assert process.returncode is not None
    return process.returncode, [json.loads(line) for line in output.splitlines()], said.decode()


@needs_mavsdk
def test_it_takes_off_hands_over_arrives_and_lands_with_either_autopilot() -> None:
    """With MAVSDK and a daemon as processes, so it lasts as long as such a flight. The ArduPilot is handed over to a
    daemon that runs already, and that it leaves running."""
    warm_up(SolverKind.HALFPLANE)  # else both daemons compile while they hover

    async def act(server: FleetServer) -> None:
        ardupilot = server.config.autopilot == "ardupilot"
        async with AsyncExitStack() as beside:
            running = await beside.enter_async_context(a_daemon(server, NEAR)) if ardupilot else None
            options = "running" if ardupilot else " ".join(daemon_options(server, NEAR))
            code, lines, said = await conduct(
                "--vehicle", vehicle_of(server), "--takeoff", "2", "--land", "--daemon", options
            )
            assert running is None or running.returncode is None, "it is not ours to end"
        final = lines[-1]
        assert code == 0, said
        assert (final["event"], final["outcome"]) == ("final", "done")
        assert final["took_off"] and final["arrived"] and final["landed"]
        pilot = server.autopilots[0].pilot
        assert not pilot.armed and not pilot.navigation.in_air
        assert "handed over: the daemon steers" in said and ("engaged: avoiding" in said) is not ardupilot
        position = server.world.position_ned_m[0]
        assert position[0] == pytest.approx(100.0 + 3.0, abs=2.0)
        if not ardupilot:  # what it took off with is not left behind
            assert server.autopilots[0].pilot.speeds._parameters["MIS_TAKEOFF_ALT"] == 2.5

    fly_both_autopilots(act)


@needs_mavsdk
def test_a_pilot_who_takes_over_keeps_the_vehicle_that_should_have_landed() -> None:
    """While a daemon steers, and while it waits for one that does not; all four flights at once."""
    warm_up(SolverKind.HALFPLANE)

    async def take_over(when: str, server: FleetServer) -> None:
        # Without an operator's request it lets PX4 have its stream, and steers nothing.
        async with a_daemon(server, FAR, *(["--standby"] if when == "at 2 m" else [])):
            conducted = await asyncio.create_subprocess_exec(
                *fly_command("--vehicle", vehicle_of(server), "--takeoff", "2", "--land", "--daemon", "running"),
                stdout=PIPE, stderr=PIPE,
            )  # fmt: skip
            assert conducted.stderr is not None
            while when not in (line := (await conducted.stderr.readline()).decode()):
                assert line, "it ended"
            remote = await open_link(vehicle_of(server), lambda _, __: None)
            mode = POSITION[server.config.autopilot]
            remote.send(
                Encoder(255, 190).encode(
                    "COMMAND_LONG", target_system=1, target_component=1, command=176, param1=1.0, param2=mode
                )
            )
            remote.close()
            output, said = await conducted.communicate()
            final = json.loads(output.splitlines()[-1])
            assert conducted.returncode == 1 and "somebody else changed the mode" in said.decode()
            assert final["outcome"] == "failed" and final["took_off"] and not final["landed"]
            pilot = server.autopilots[0].pilot
            assert pilot.mode is Mode.POSITION and pilot.armed  # an ArduPilot sinks: nobody holds its stick

    async def fly_them() -> None:
        one = built_in("circle8", 1)
        configs = [FleetConfig(autopilot=flavour, sigma_m=0.0, **ANY_PORT) for flavour in POSITION]
        await asyncio.gather(
            *(run(FleetServer(one, config), partial(take_over, when)) for config in configs for when in MOMENTS)
        )

    asyncio.run(fly_them())


@needs_mavsdk
def test_whoever_has_read_enough_of_its_lines_ends_no_flight() -> None:
    """It left the vehicle where it was, with exit code 0."""

    async def act(server: FleetServer) -> None:
        process = await asyncio.create_subprocess_exec(
            *fly_command("--vehicle", vehicle_of(server), "--takeoff", "2", "--land"), stdout=PIPE, stderr=PIPE
        )
        assert process.stdout is not None and await process.stdout.readline()
        process.stdout._transport.close()  # type: ignore[attr-defined]
        assert process.stderr is not None
        said = (await process.stderr.read()).decode()
        assert await process.wait() == 0 and "landed and disarmed" in said

    fly(built_in("circle8", 1), act, sigma_m=0.0, **ANY_PORT)


@needs_mavsdk
@pytest.mark.parametrize("cause", ["Ctrl-C", "daemon killed"])
def test_what_ends_the_climb_leaves_nobody_up_there(cause: str) -> None:
    """A terminal gives Ctrl-C to all that it runs: the daemon ended first, which was no reason to land."""

    async def act(server: FleetServer) -> None:
        arguments = ["--vehicle", vehicle_of(server), "--takeoff", "6", "--land"]
        daemon = " ".join(daemon_options(server, FAR))
        process = await asyncio.create_subprocess_exec(
            *fly_command(*arguments, "--daemon", daemon), stdout=PIPE, stderr=PIPE, start_new_session=True
        )
        assert process.stdout is not None
        async for line in process.stdout:
            if json.loads(line)["text"].startswith("armed, climbing"):
                break
        while not server.world.in_air[0]:
            await turn()
        if cause == "Ctrl-C":
            os.killpg(process.pid, signal.SIGINT)
        else:
            children = subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True, text=True)
            os.kill(int(children.stdout), signal.SIGKILL)
        output, said = await process.communicate()
        final = json.loads(output.splitlines()[-1])
        assert process.returncode == 1, said
        assert final["outcome"] == ("stopped" if cause == "Ctrl-C" else "failed") and final["landed"], said
        assert not server.autopilots[0].pilot.armed

    fly(built_in("circle8", 1), act, sigma_m=0.0, **ANY_PORT)


@needs_mavsdk
@pytest.mark.parametrize(
    ("arguments", "moment", "words"),
    [
        (["--takeoff", "200", "--land"], "armed, climbing", "not at 200 m: the vehicle has been silent for "),
        (["--takeoff", "2", "--land"], "landing from", "not landed: the vehicle has been silent for "),
        (
            ["--takeoff", "2", "--daemon", "running"],
            "the daemon steers",
            "not holding: the vehicle has been silent for ",
        ),
        (
            ["--takeoff", "2", "--land", "--daemon", "running"],
            "the daemon steers",
            "landing has no answer from the vehi",
        ),
    ],
    ids=["climb", "landing", "daemon", "daemon-and-landing"],
)
def test_a_vehicle_that_has_fallen_silent_is_not_waited_for_after_a_signal(
    arguments: list[str], moment: str, words: str
) -> None:
    """It was for as long as the climb and the landing may take, minutes, and then 'landing refused: timeout'."""
    if "--daemon" in arguments:
        warm_up(SolverKind.HALFPLANE)

    async def act(server: FleetServer) -> None:
        async with AsyncExitStack() as beside:
            if "--daemon" in arguments:
                await beside.enter_async_context(a_daemon(server, FAR))
            command = fly_command("--vehicle", vehicle_of(server), *arguments)
            process = await asyncio.create_subprocess_exec(*command, stdout=PIPE, stderr=PIPE)
            assert process.stdout is not None
            async for line in process.stdout:
                if moment in json.loads(line)["text"]:
                    break
            while not server.world.in_air[0]:  # the climb is told of before it is asked for
                await turn()
            server.world.inject(Event(0.0, 0, "link-off", {"duration_s": 0.0}))
            while server.autopilots[0].pilot.navigation.link_on:  # autopilots know it from the next tick on
                await turn()
            process.send_signal(signal.SIGTERM)
            output, said = await process.communicate()
            final = json.loads(output.splitlines()[-1])
            assert process.returncode == 1 and words in said.decode().splitlines()[-1]
            assert final["outcome"] == "failed" and words in final["reason"] and not final["landed"]

    fly(built_in("circle8", 1), act, sigma_m=0.0, start=Start.GROUND, **ANY_PORT)


@needs_mavsdk
def test_a_handover_that_does_not_come_about_is_not_waited_for_after_a_signal() -> None:
    """It was for a minute and a half, and ended as a failure."""
    warm_up(SolverKind.HALFPLANE)

    async def act(server: FleetServer) -> None:
        async with a_daemon(server, FAR, "--standby"):
            command = fly_command("--vehicle", vehicle_of(server), "--takeoff", "2", "--land", "--daemon", "running")
            process = await asyncio.create_subprocess_exec(*command, stdout=PIPE, stderr=PIPE)
            assert process.stdout is not None
            async for line in process.stdout:
                if "offboard refused" in json.loads(line)["text"]:
                    break
            process.send_signal(signal.SIGTERM)
            output, said = await process.communicate()
        final = json.loads(output.splitlines()[-1])
        assert process.returncode == 1 and final["outcome"] == "stopped" and final["landed"], said
        assert not server.autopilots[0].pilot.armed

    fly(built_in("circle8", 1), act, sigma_m=0.0, start=Start.GROUND, **ANY_PORT)


@needs_mavsdk
def test_a_conductor_that_hears_no_more_says_so() -> None:
    """Its words go to somebody who takes none of the vehicle's: nobody would know what the vehicle warns of."""
    from ridlink.conductor import Conductor, FlightError, connect, mavsdk_ground_station

    def say(text: str) -> None:
        if text.startswith("vehicle: "):
            raise ValueError("not today")

    async def act(server: FleetServer) -> None:
        async with mavsdk_ground_station() as mavsdk:
            conductor = Conductor(await connect(mavsdk, parse_link_url(vehicle_of(server))), say)
            await conductor.open()
            try:
                await conductor.wait_healthy(30.0)
                server.autopilots[0].pilot._board.say(Severity.WARNING, "strong wind")
                with pytest.raises(FlightError, match="the vehicle is heard no more: not today"):
                    await conductor.take_off(30.0)
                await conductor.land()
            finally:
                await conductor.close()

    fly(built_in("circle8", 1), act, sigma_m=0.0, start=Start.GROUND, **ANY_PORT)


@needs_mavsdk
def test_a_px4_that_was_landed_from_offboard_flies_again() -> None:
    """It is in OFFBOARD again when it has disarmed, where it does not arm without setpoints; nobody sends any yet."""

    async def act(server: FleetServer) -> None:
        pilot = server.autopilots[0].pilot
        pilot.enter_offboard()
        code, lines, said = await conduct("--vehicle", vehicle_of(server), "--takeoff", "2", "--land")
        assert code == 0 and lines[-1]["landed"], said
        assert pilot.mode is Mode.HOLD and not pilot.armed

    fly(built_in("circle8", 1), act, sigma_m=0.0, start=Start.GROUND, **ANY_PORT)


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
        assert "not healthy after 1 s: no " in said and "no global position" in said and "Traceback" not in said

    fly(lost, act, **ANY_PORT)


@needs_mavsdk
@pytest.mark.parametrize("step", ["looking for an autopilot", "waiting for"])
def test_before_the_take_off_a_signal_waits_for_nothing(step: str) -> None:
    """Neither for an autopilot that nobody hears nor for one that is never healthy."""
    event = Event(0.0, 0, "gnss-outage", {"duration_s": 0.0})
    lost = Scenario("lost", 60.0, (VehicleSpec((0.0, 0.0, -50.0), (9.0, 0.0, -50.0)),), events=(event,))

    async def act(server: FleetServer) -> None:
        server.begin_mission()
        port = server.ports.vehicles[0] if step == "waiting for" else server.ports.air
        command = fly_command("--vehicle", f"udpout:127.0.0.1:{port}", "--takeoff", "2", "--health-timeout", "3600")
        process = await asyncio.create_subprocess_exec(*command, stdout=PIPE, stderr=PIPE)
        assert process.stdout is not None
        async for line in process.stdout:
            if json.loads(line)["text"].startswith(step):
                break
        process.send_signal(signal.SIGINT)
        output, said = await process.communicate()
        assert process.returncode == 1 and said.decode().endswith("stopped before the take-off\n")
        final = json.loads(output.splitlines()[-1])
        assert (final["outcome"], final["took_off"]) == ("stopped", False)

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
def test_a_vehicle_that_does_not_tell_its_position_stays_on_the_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was armed, and nobody knew whether it climbed; with a goal, that was nan km away."""
    usual = streams.default_intervals
    monkeypatch.setattr(
        streams,
        "default_intervals",
        lambda flavour: {name: s for name, s in usual(flavour).items() if name != "GLOBAL_POSITION_INT"},
    )

    async def act(server: FleetServer) -> None:
        code, lines, said = await conduct("--vehicle", vehicle_of(server), "--takeoff", "2", "--health-timeout", "4")
        assert code == 1 and not lines[-1]["took_off"] and not server.autopilots[0].pilot.armed
        assert "not healthy after 4 s: " in said and said.endswith("no GLOBAL_POSITION_INT\n")

    fly(built_in("circle8", 1), act, sigma_m=0.0, **ANY_PORT)


@needs_mavsdk
def test_a_goal_with_latitude_and_longitude_swapped_keeps_the_vehicle_on_the_ground() -> None:
    """It took off, and hovered for 90 s under a daemon that does not fly there."""

    async def act(server: FleetServer) -> None:
        daemon = " ".join(daemon_options(server, "8.545594,47.398668"))
        code, lines, said = await conduct("--vehicle", vehicle_of(server), "--takeoff", "2", "--daemon", daemon)
        assert code == 1 and not lines[-1]["took_off"] and not server.autopilots[0].pilot.armed
        assert "not flown to: is 47.39867,8.545594 meant? Latitude comes first" in said.splitlines()[-1]

    fly(built_in("circle8", 1), act, sigma_m=0.0, **ANY_PORT)


@needs_mavsdk
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--takeoff", "5", "--daemon", "--goal 1,2 --cruise 900"], "cruise"),
        (["--takeoff", "0"], "takeoff must lie between 0.5 and 1000 m, got 0"),
        (["--takeoff", "5000"], "takeoff must lie between 0.5 and 1000 m, got 5000"),
        (["--takeoff", "nan"], "takeoff must lie between 0.5 and 1000 m, got nan"),
        (["--takeoff", "5", "--vehicle", "udp:127.0.0.1:14580"], "udpin:127.0.0.1:14580"),
        (["--takeoff", "5", "--vehicle", "udpin:0.0.0.0:0"], "udpin:0.0.0.0:0: MAVSDK listens on no port but"),
        (["--takeoff", "5", "--daemon", "--gaol 1,2"], "such as '--goal 47.39,8.54': No such option '--gaol'"),
        (
            ["--takeoff", "5", "--daemon", '--goal "1,2'],
            "--daemon, options of 'ridlink avoid' such as '--goal 47.39,8.54': No closing quotation",
        ),
        ([], "Missing option '--takeoff'"),
    ],
)
def test_what_cannot_be_flown_is_refused_before_anything_is_opened(arguments: list[str], words: str) -> None:
    result = CliRunner().invoke(cli, ["fly", *arguments])
    assert result.exit_code == 2 or isinstance(result.exception, ConfigError)
    assert words in result.output or words in str(result.exception)


def test_without_the_extra_one_line_names_the_remedy() -> None:
    program = "import sys; sys.modules['mavsdk'] = None; sys.argv = ['ridlink', 'fly', '--takeoff', '5']; "
    program += "from ridlink.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr == "ridlink: the conductor needs the extra 'mavsdk': pip install 'ridlink[mavsdk]'\n"
