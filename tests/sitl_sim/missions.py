"""Missions as a client writes, reads and starts them."""

from __future__ import annotations

import math
from typing import Any

from ridlink.geodesy import geodetic_from_ned
from ridlink.mavlink.codec import Message
from sitl_sim.autopilot import Start
from tests.sitl_sim.flight import HOME, START_NED_M, Flight

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
ARM, SET_CURRENT, MISSION_START, PAUSE_CONTINUE = 400, 224, 300, 193
WAYPOINT, LOITER_TIME, RETURN, LAND, TAKEOFF, DELAY, CONDITION_YAW, JUMP, SPEED = 16, 19, 20, 21, 22, 93, 115, 177, 178
CAMERA = 2000
NAN = math.nan
AUTO, BRAKE = 3, 17


def item(command: int = WAYPOINT, north: float = 0.0, east: float = 0.0, height: float = 50.0, **more: Any) -> Any:
    """Fields of an item; places count from the vehicle's start."""
    latitude, longitude, _ = geodetic_from_ned((START_NED_M[0] + north, START_NED_M[1] + east, 0.0), HOME)
    place = {"x": round(float(latitude) * 1e7), "y": round(float(longitude) * 1e7), "z": height}
    return {"command": command, "frame": 3, "autocontinue": 1, **place, **more}


def at_once(command: int, **more: Any) -> Any:
    return {"command": command, "frame": 2, "autocontinue": 1, **more}


def to_vehicle(flight: Flight, name: str, **fields: Any) -> list[Message]:
    return flight.send(name, target_system=1, target_component=1, **fields)


def upload(flight: Flight, items: list[Any], name: str = "MISSION_ITEM_INT") -> int:
    """Write a mission as a client does; the MAV_MISSION_RESULT."""
    return give(flight, to_vehicle(flight, "MISSION_COUNT", count=len(items)), dict(enumerate(items)), name)


def give(flight: Flight, answers: list[Message], items: dict[int, Any], name: str = "MISSION_ITEM_INT") -> int:
    """Give the items that are asked for; the MAV_MISSION_RESULT."""
    while answers[-1].name == ("MISSION_REQUEST_INT" if flight.flavour == "px4" else "MISSION_REQUEST"):
        seq = answers[-1].seq
        answers = to_vehicle(flight, name, seq=seq, **items[seq])
    assert (answers[-1].name, answers[-1].target_system, answers[-1].target_component) == ("MISSION_ACK", 255, 190)
    return int(answers[-1].type)


def download(flight: Flight) -> list[Message]:
    (count,) = to_vehicle(flight, "MISSION_REQUEST_LIST")
    return [to_vehicle(flight, "MISSION_REQUEST_INT", seq=seq)[0] for seq in range(count.count)]


def planned(flavour: str, items: list[Any]) -> list[Any]:
    """As clients write it: ArduPilot's item 0 is home."""
    return items if flavour == "px4" else [at_once(WAYPOINT, frame=0), *items]


def start(flight: Flight) -> int:
    return flight.set_mode(4, 4) if flight.flavour == "px4" else flight.set_mode(AUTO)


def advance_until(flight: Flight, what: Any, patience_s: float = 60.0) -> None:
    for _ in range(round(patience_s / 0.1)):
        if what():
            return
        flight.advance(0.1)
    raise AssertionError(f"not within {patience_s} s")


def reached(flight: Flight) -> list[int]:
    return [message.seq for _, message in flight.messages("MISSION_ITEM_REACHED")]


def holding(flavour: str) -> Flight:
    flight = Flight(flavour, Start.HOLDING)
    flight.advance(0.1)
    return flight
