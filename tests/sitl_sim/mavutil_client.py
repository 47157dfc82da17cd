"""Clients of pymavlink's mavutil, run as a process of their own because its dialect is a matter of the whole process.

    python mavutil_client.py fly ardupilot 127.0.0.1:PORT    arm, take off, fly north at 3 m/s, land
    python mavutil_client.py plan ardupilot 127.0.0.1:PORT   all parameters, a mission up and down, velocities by mask
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


MASKS = ((0x0DC7, 1), (0x05C7, 1), (0x0FC7, 8))
"""Velocity as ArduPilot's documents, its velocity with a yaw rate, and MAVProxy write it, with the frame."""


def plan(flavour: str, address: str) -> dict[str, Any]:
    """With a vehicle that hovers and obeys setpoints."""
    link = connect(address, "ardupilotmega")
    assert link.wait_heartbeat(timeout=PATIENCE_S) is not None
    link.param_fetch_all()
    names: set[str] = set()

    def note(message: Any) -> bool:
        names.add(message.param_id)
        return len(names) == message.param_count

    until(link, "PARAM_VALUE", note)
    name = "RTL_ALT" if flavour == "ardupilot" else "RTL_RETURN_ALT"
    link.param_set_send(name, 45)  # as REAL32, whatever the parameter is
    value = until(link, "PARAM_VALUE", lambda message: message.param_id == name and message.param_value == 45)

    moved = []
    for mask, frame in MASKS:

        def at_speed(speed: float, mask: int = mask, frame: int = frame) -> float:
            def stream() -> None:
                link.mav.set_position_target_local_ned_send(0, 1, 1, frame, mask, 0, 0, 0, speed, 0, 0, 0, 0, 0, 0, 0)

            vx: float = until(link, "LOCAL_POSITION_NED", lambda message: abs(message.vx - speed) < 0.35, stream).vx
            return vx

        moved.append([mask, round(at_speed(2.0)), round(at_speed(0.0))])

    items = [
        (16, 0, 47.3977, 8.5456, 0.0),
        (16, 3, 47.39771, 8.5456, 50.0),
        (178, 2, 0, 0, 0),
        (21, 3, 47.3977, 8.5456, 0),
    ]
    link.waypoint_count_send(len(items))
    dialogue = ["MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK"]
    while True:
        asked = link.recv_match(type=dialogue, blocking=True, timeout=PATIENCE_S)
        if asked.get_type() == "MISSION_ACK":
            break
        command, in_frame, latitude, longitude, height = items[asked.seq]
        place = round(latitude * 1e7), round(longitude * 1e7), height
        link.mav.mission_item_int_send(1, 1, asked.seq, in_frame, command, 0, 1, 1, 2, 0, 0, *place)
    result = asked.type
    link.waypoint_request_list_send()
    count = until(link, "MISSION_COUNT", lambda message: True).count
    back = []
    for seq in range(count):
        link.mav.mission_request_int_send(1, 1, seq)
        back.append(until(link, "MISSION_ITEM_INT", lambda _: True).command)
    link.mav.mission_ack_send(1, 1, 0)
    link.waypoint_clear_all_send()
    cleared = until(link, "MISSION_ACK", lambda message: True).type
    return {"parameters": len(names), "set": value.param_value, "moved": moved, "mission": [result, back, cleared]}


def listen(address: str, systems: int) -> dict[str, Any]:
    link = connect(address, "common")
    heard: dict[int, list[int]] = {}

    def note(message: Any) -> bool:
        heard[message.get_srcSystem()] = [message.latitude, message.longitude, message.status]
        return len(heard) == systems

    until(link, "OPEN_DRONE_ID_LOCATION", note)
    return {"heard": heard, "dialect": mavutil.current_dialect}


if __name__ == "__main__":
    act, *arguments = sys.argv[1:]
    if act == "listen":
        print(json.dumps(listen(arguments[0], int(arguments[1]))))
    else:
        print(json.dumps({"fly": fly, "plan": plan}[act](*arguments)))
