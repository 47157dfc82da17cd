"""The conductor: takes one vehicle off with MAVSDK, hands it over to its daemon, and lands it at the end.

It does what an operator at a ground station does, through a library for ground stations. It trusts the mode and arming
that an autopilot reports, not its acknowledgements: PX4 acknowledges a change of mode twice, the second time perhaps
with a refusal. It knows the daemon by HEARTBEAT and RIDLINK_STATUS of component 196 on the vehicle's link, whoever
started it. It never sends a setpoint: two writers would contradict each other, and the daemon streams already while the
vehicle waits for OFFBOARD.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from importlib.resources import files
from typing import Any

from ridlink.conductor.daemon_words import AVOIDANCE_COMPONENT, DaemonWords
from ridlink.conductor.outcome import End, FlightError, SilentError, TakenError
from ridlink.errors import MissingExtraError
from ridlink.geodesy import Geodetic
from ridlink.remote_id.text import display_name

try:
    from mavsdk.asyncio.plugins.action import ActionAsync
    from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
    from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
    from mavsdk.autopilot import Autopilot
    from mavsdk.exceptions import MavsdkError
    from mavsdk.plugins.mavlink_direct import MavlinkMessage
    from mavsdk.plugins.telemetry import FlightMode, StatusTextType
except ImportError as error:
    raise MissingExtraError("mavsdk", "the conductor") from error

AUTOPILOT_COMPONENT = 1
MAV_CMD_DO_SET_MODE = 176
PX4_OFFBOARD, PX4_HOLD = (6.0, 0.0), (4.0, 3.0)
ARDUCOPTER_GUIDED, ARDUCOPTER_BRAKE = (4.0, 0.0), (17.0, 0.0)
"""Main and sub mode. ArduPilot's LOITER reads the throttle stick, and sinks if nobody holds it: hence BRAKE."""

LOOK_S = 0.1
ASK_AGAIN_S = 1.0
SILENT_S = 5.0
"""How long to wait for a silent vehicle when the flight is to end; otherwise the usual limit applies."""
DAEMON_HEARD_S = 20.0
HAND_OVER_S = 90.0
"""How long a daemon may take to engage: the first one on a machine compiles for this long, while the vehicle hovers."""
SLOWEST_CLIMB_MPS = 0.5
SLOWEST_DESCENT_MPS = 0.3
MANOEUVRE_S = 20.0
"""Margin added to the time of a climb or a landing."""

HEALTH = {
    "is_gyrometer_calibration_ok": "gyroscope",
    "is_accelerometer_calibration_ok": "accelerometer",
    "is_magnetometer_calibration_ok": "magnetometer",
    "is_local_position_ok": "local position",
    "is_global_position_ok": "global position",
    "is_home_position_ok": "home position",
}

PX4_MODES = (FlightMode.TAKEOFF, FlightMode.HOLD, FlightMode.OFFBOARD)
"""Modes of a conducted PX4, in order. An ArduPilot is in GUIDED from the beginning, which MAVSDK calls OFFBOARD."""

Say = Callable[[str], None]


class Conductor:
    """Conducts one vehicle.

    Args:
        system: The vehicle as a system of MAVSDK.
        say: Called with a line for every step, and for every warning of the vehicle.
        is_lost: Whether the daemon has ended, if the caller started it.
        is_to_end: Whether the flight is to end.
    """

    def __init__(
        self,
        system: Any,
        say: Say,
        is_lost: Callable[[], bool] = lambda: False,
        is_to_end: Callable[[], bool] = lambda: False,
    ) -> None:
        self._system, self._say, self._is_lost, self._is_to_end = system, say, is_lost, is_to_end
        self._telemetry, self._action = TelemetryAsync(system), ActionAsync(system)
        self._direct = MavlinkDirectAsync(system)
        self._daemon = DaemonWords()
        self._system_id = 0
        self._ardupilot = False
        self._was_ours = False
        self._last_text = ""
        self._heard_s = time.monotonic()
        self._listening: list[asyncio.Task[None]] = []

    async def open(self) -> None:
        """Read system id and type of the autopilot, and begin to listen."""
        self._system_id = await self._system.get_system_id()
        self._ardupilot = await self._system.autopilot_type() == Autopilot.ARDUPILOT
        definition = files("message_spec").joinpath("ridlink.xml").read_text(encoding="utf-8")
        await self._direct.load_custom_xml(definition)
        for listen in (self._hear_texts(), self._hear_heartbeats(), self._hear_status()):
            self._listening.append(asyncio.create_task(listen))

    async def close(self) -> None:
        """Stop listening."""
        for task in self._listening:
            task.cancel()
        await asyncio.gather(*self._listening, return_exceptions=True)

    def _check_hearing(self) -> None:
        """Check that all tasks that listen to the vehicle still run.

        Raises:
            FlightError: If one of them has ended.
        """
        for task in self._listening:
            if task.done():
                why = task.exception()
                raise FlightError(f"the vehicle is heard no more: {why or 'MAVSDK has ended it'}") from why

    # --- on the ground, and up ----------------------------------------------------------------------------------------

    async def wait_healthy(self, timeout_s: float) -> None:
        """Wait until the vehicle can be armed.

        Raises:
            FlightError: If that takes longer; the text names what is missing.
        """
        deadline = time.monotonic() + timeout_s
        told: list[str] = []
        while missing := await self._missing():
            self._check_hearing()
            if time.monotonic() > deadline:
                raise FlightError(f"not healthy after {timeout_s:g} s: no {', no '.join(missing)}{self._because()}")
            if missing != told:
                self._say(f"waiting for {', '.join(missing)}")
                told = missing
            await asyncio.sleep(LOOK_S)
        self._say("healthy")

    async def _missing(self) -> list[str]:
        health, position = await self._telemetry.health(), await self.position()
        missing = [word for name, word in HEALTH.items() if not getattr(health, name)]
        return missing + ["GLOBAL_POSITION_INT"] * math.isnan(position.latitude_deg)  # which health says nothing of

    async def position(self) -> Geodetic:
        """Its position, with the altitude above mean sea level."""
        at = await self._telemetry.position()
        return Geodetic(at.latitude_deg, at.longitude_deg, at.absolute_altitude_m)

    async def take_off(self, height_m: float) -> None:
        """Arm, climb to a height above home, and wait until the vehicle is there.

        Raises:
            FlightError: If a command is refused, or the height is not reached in time.
            TakenError: If somebody else changes the mode during the climb.
        """
        usual_m = await self._asked("take-off height", self._action.get_takeoff_altitude())
        await self._asked("take-off height", self._action.set_takeoff_altitude(height_m))
        try:
            if not (self._ardupilot or await self._telemetry.armed()) and await self._obeys_setpoints():
                await self._leave_offboard()  # the last landing left it in OFFBOARD, where it arms only with a stream
            await self._asked("arming", self._action.arm())
            await self._until(self._telemetry.armed, "armed", MANOEUVRE_S)
            self._say(f"armed, climbing to {height_m:g} m")
            await self._asked("take-off", self._action.takeoff())
            await self._climb(height_m)
        finally:
            if not self._ardupilot:  # PX4 would keep it: it is a parameter
                with suppress(MavsdkError):
                    await self._action.set_takeoff_altitude(usual_m)
        self._say(f"at {height_m:g} m")

    async def is_armed(self) -> bool:
        """Whether the vehicle is armed, by its heartbeat."""
        return bool(await self._telemetry.armed())

    async def _climb(self, height_m: float) -> None:
        enough_m = height_m - max(0.5, 0.05 * height_m)

        async def is_up() -> bool:
            if not await self._telemetry.armed():
                raise FlightError(f"disarmed before it was up{self._because()}")
            await self._still_ours()
            return float((await self._telemetry.position()).relative_altitude_m) >= enough_m

        await self._until(is_up, f"at {height_m:g} m", MANOEUVRE_S + height_m / SLOWEST_CLIMB_MPS)

    # --- under the daemon ---------------------------------------------------------------------------------------------

    async def find_daemon(self) -> None:
        """Wait until the daemon is heard.

        Raises:
            FlightError: If no daemon is heard in time.
        """
        who = f"daemon (component {AVOIDANCE_COMPONENT} of system {self._system_id})"
        heard = f"{who} through the vehicle, whose link its own --vehicle must name,"
        await self._until(self._hears_daemon, heard, DAEMON_HEARD_S, denied="no")

    async def _hears_daemon(self) -> bool:
        return self._daemon.is_heard(time.monotonic())

    async def hand_over(self, timeout_s: float = HAND_OVER_S) -> None:
        """Switch the vehicle to the mode in which it obeys setpoints, and wait until the daemon steers, or the flight
        is to end.

        Raises:
            FlightError: If the mode is not confirmed, or the daemon does not engage.
            TakenError: If somebody else changes the mode meanwhile.
        """
        mode = ARDUCOPTER_GUIDED if self._ardupilot else PX4_OFFBOARD
        asked_s = -math.inf

        async def is_steered() -> bool:
            nonlocal asked_s
            await self._still_ours()
            if self._is_to_end():
                return True
            external = await self._obeys_setpoints()
            if not external and time.monotonic() - asked_s >= ASK_AGAIN_S:
                asked_s = time.monotonic()
                await self._set_mode(mode)
            return external and self._daemon.active

        await self._until(is_steered, "handed over", timeout_s)
        if not self._is_to_end():
            self._say("handed over: the daemon steers")

    async def follow(self, stop: asyncio.Event) -> End:
        """Watch until the flight under the daemon ends.

        Raises:
            FlightError: If a task that listens to the vehicle has ended.
        """
        while True:
            if self._is_lost():
                return End.DAEMON_LOST
            if not await self._obeys_setpoints():
                mode = await self._telemetry.flight_mode()
                landing = mode == FlightMode.LAND or not await self._telemetry.armed()
                return End.LANDING if landing else End.TAKEN
            self._check_hearing()
            if stop.is_set():
                return End.STOPPED
            if not self._daemon.is_heard(time.monotonic()):
                return End.DAEMON_LOST
            if self._daemon.has_arrived:
                return End.ARRIVED
            await asyncio.sleep(LOOK_S)

    async def _still_ours(self) -> None:
        """Check that between take-off and hand-over the vehicle has only had modes of this flight.

        Raises:
            TakenError: If it has another mode.
        """
        mode = await self._telemetry.flight_mode()
        if mode in ((FlightMode.OFFBOARD,) if self._ardupilot else PX4_MODES):
            self._was_ours = True
        elif self._was_ours:
            raise TakenError

    async def _obeys_setpoints(self) -> bool:
        """Whether the heartbeat says OFFBOARD, which is also MAVSDK's name of ArduPilot's GUIDED."""
        return bool(await self._telemetry.flight_mode() == FlightMode.OFFBOARD)

    # --- down ---------------------------------------------------------------------------------------------------------

    async def hold(self) -> None:
        """Stop here, in a mode that needs no commands.

        Raises:
            FlightError: If the mode is not confirmed.
        """
        await self._leave_offboard()
        self._say("holds")

    async def _leave_offboard(self) -> None:
        asked_s = -math.inf

        async def holds() -> bool:
            nonlocal asked_s
            if time.monotonic() - asked_s >= ASK_AGAIN_S:
                asked_s = time.monotonic()
                await self._set_mode(ARDUCOPTER_BRAKE if self._ardupilot else PX4_HOLD)
            return not await self._obeys_setpoints()

        await self._until(holds, "holding", MANOEUVRE_S, without_daemon=True)

    async def land(self) -> None:
        """Land here, and wait until the vehicle has disarmed itself.

        Raises:
            FlightError: If landing is refused or takes too long.
        """
        height_m = float((await self._telemetry.position()).relative_altitude_m)
        await self._asked("landing", self._action.land())
        self._say(f"landing from {height_m:.0f} m")

        async def is_down() -> bool:
            return not await self._telemetry.armed()

        limit_s = MANOEUVRE_S + max(height_m, 0.0) / SLOWEST_DESCENT_MPS
        await self._until(is_down, "landed", limit_s, without_daemon=True)
        self._say("landed and disarmed")

    # --- how ----------------------------------------------------------------------------------------------------------

    async def _asked(self, what: str, request: Awaitable[Any]) -> Any:
        try:
            return await request
        except MavsdkError as error:
            result = getattr(error, "result", None)
            word = getattr(result, "name", str(error)).lower().replace("_", " ")
            await asyncio.sleep(2 * LOOK_S)  # the vehicle sends its reason after its answer
            said = "has no answer from the vehicle" if word == "timeout" else f"refused: {word}"
            raise FlightError(f"{what} {said}{self._because()}") from error

    def _because(self) -> str:
        return f"; the vehicle said: {self._last_text}" if self._last_text else ""

    async def _until(
        self,
        question: Callable[[], Awaitable[bool]],
        what: str,
        timeout_s: float,
        *,
        denied: str = "not",
        without_daemon: bool = False,
    ) -> None:
        deadline = time.monotonic() + timeout_s
        while not await question():
            if not without_daemon:
                self._check_hearing()
                if self._is_lost():
                    raise FlightError("the daemon ended: its line above says why")
            silent_s = time.monotonic() - self._heard_s
            if self._is_to_end() and silent_s > SILENT_S:
                raise SilentError(f"{denied} {what}", silent_s)
            if time.monotonic() > deadline:
                raise FlightError(f"{denied} {what} within {timeout_s:.0f} s{self._because()}")
            await asyncio.sleep(LOOK_S)

    async def _set_mode(self, mode: tuple[float, float]) -> None:
        fields = {
            "target_system": self._system_id, "target_component": 1, "command": MAV_CMD_DO_SET_MODE,
            "confirmation": 0, "param1": 129.0, "param2": mode[0], "param3": mode[1],
            "param4": 0.0, "param5": 0.0, "param6": 0.0, "param7": 0.0,
        }  # fmt: skip
        message = MavlinkMessage("COMMAND_LONG", 0, 0, self._system_id, 1, json.dumps(fields))
        await self._asked("mode", self._direct.send_message(message))

    async def _hear_texts(self) -> None:
        async for text in self._telemetry.subscribe_status_text():
            words = display_name(text.text)
            if text.type >= StatusTextType.WARNING:
                self._last_text = words
            self._say(f"vehicle: {words}")

    async def _hear_heartbeats(self) -> None:
        async for heartbeat in self._direct.subscribe_message("HEARTBEAT"):
            if (heartbeat.system_id, heartbeat.component_id) == (self._system_id, AUTOPILOT_COMPONENT):
                self._heard_s = time.monotonic()
            elif heartbeat.component_id == AVOIDANCE_COMPONENT:
                self._daemon.take_heartbeat(json.loads(heartbeat.fields_json), time.monotonic())

    async def _hear_status(self) -> None:
        async for status in self._direct.subscribe_message("RIDLINK_STATUS"):
            if status.component_id == AVOIDANCE_COMPONENT:
                at = await self._telemetry.position()
                self._daemon.take_status(json.loads(status.fields_json), at.latitude_deg, at.longitude_deg)
