"""Clients of pymavlink's mavutil, run as a process of their own because its dialect is a matter of the whole process.

    python mavutil_client.py fly ardupilot 127.0.0.1:PORT    arm, take off, fly north at 3 m/s, land
    python mavutil_client.py listen 127.0.0.1:PORT SYSTEMS   hear LOCATIONs on the air until all system ids have spoken

The last line on stdout is a JSON object with what was seen.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil

PATIENCE_S = 15.0


def connect(address: str, dialect: str) -> Any:
    link = mavutil.mavlink_connection(f"udpout:{address}", source_system=255, source_component=190, dialect=dialect)
    link.mav.heartbeat_send(6, 8, 0, 0, 4)
    return link


def until(link: Any, kind: str, wanted: Callable[[Any], bool], every: Callable[[], None] | None = None) -> Any:
    """The next message that is wanted; `every` is done ten times a second meanwhile."""
    deadline = time.monotonic() + PATIENCE_S
    next_s = time.monotonic()
    while time.monotonic() < deadline:
        if every is not None and time.monotonic() >= next_s:
            every()
            next_s += 0.1
        message = link.recv_match(type=kind, blocking=True, timeout=0.05)
        if message is not None and wanted(message):
            return message
    raise SystemExit(f"no such {kind} within {PATIENCE_S} s")


def fly(flavour: str, address: str) -> dict[str, Any]:
    link = connect(address, "ardupilotmega")
    assert link.wait_heartbeat(timeout=PATIENCE_S) is not None
    results = {}

    def acknowledged(command: int) -> None:
        results[command] = until(link, "COMMAND_ACK", lambda message: message.command == command).result

    def stream() -> None:
        link.mav.set_position_target_local_ned_send(0, 1, 1, 1, 0x0DC7, 0, 0, 0, 3.0, 0, 0, 0, 0, 0, 0, 0)

    if flavour == "ardupilot":
        link.set_mode("GUIDED")
        acknowledged(176)
    link.arducopter_arm()
    acknowledged(400)
    link.motors_armed_wait()
    height = 2.0 if flavour == "ardupilot" else float("nan")
    link.mav.command_long_send(1, 1, 22, 0, 0, 0, 0, 0, 0, 0, height)
    acknowledged(22)
    up = until(link, "LOCAL_POSITION_NED", lambda message: message.z < -1.5)
    if flavour == "px4":
        stream()
        link.set_mode("OFFBOARD")
        acknowledged(176)
    moving = until(link, "LOCAL_POSITION_NED", lambda message: message.vx > 2.0, stream)
    link.mav.command_long_send(1, 1, 21, 0, 0, 0, 0, 0, 0, 0, 0)
    acknowledged(21)
    link.motors_disarmed_wait()
    link.param_fetch_one("RTL_ALT" if flavour == "ardupilot" else "RTL_RETURN_ALT")
    value = until(link, "PARAM_VALUE", lambda message: True)
    return {
        "results": results,
        "mode": link.flightmode,
        "height": -up.z,
        "speed": moving.vx,
        "parameter": [value.param_id, value.param_value],
        "packet_loss": link.packet_loss(),
    }


def listen(address: str, systems: int) -> dict[str, Any]:
    link = connect(address, "common")
    heard: dict[int, list[int]] = {}

    def note(message: Any) -> bool:
        heard[message.get_srcSystem()] = [message.latitude, message.longitude, message.status]
        return len(heard) == systems

    until(link, "OPEN_DRONE_ID_LOCATION", note)
    return {"heard": heard, "dialect": mavutil.current_dialect}


if __name__ == "__main__":
    seen = fly(sys.argv[2], sys.argv[3]) if sys.argv[1] == "fly" else listen(sys.argv[2], int(sys.argv[3]))
    print(json.dumps(seen))
