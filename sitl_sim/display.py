"""Traffic for a ground station: ADSB_VEHICLE of the nearest ten vehicles, once a second, from component 156.

Ground stations draw such contacts as traffic. They have the system id of one own-ship. Positions are the reported ones,
not the true ones.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence

from ridlink.mavlink.codec import Encoder
from ridlink.units import cmps_from_mps, dege7_from_deg, mm_from_m
from sitl_sim.autopilot.navigation import Navigation
from sitl_sim.vehicle import VehicleState

ADSB_COMPONENT = 156
NEAREST = 10
"""Limit of contacts, as in other tools that feed ground stations."""

_TYPE_ADSB, _AUTOPILOT_INVALID, _ACTIVE = 27, 8, 4
_GEOMETRIC, _EMITTER_UAV = 1, 14
_VALID = 1 | 2 | 4 | 8 | 16 | 128
"""Valid flags: coordinates, altitude, heading, velocity, callsign, vertical velocity."""


class TrafficDisplay:
    """The contacts of one own-ship.

    Args:
        system_id: System id of the own-ship; its row is one less.
    """

    def __init__(self, system_id: int = 1) -> None:
        self._own = system_id - 1
        self._encoder = Encoder(system_id, ADSB_COMPONENT)

    def frames(self, fleet: Sequence[Navigation]) -> list[bytes]:
        """A HEARTBEAT and one ADSB_VEHICLE per contact, the nearest first."""
        heartbeat = self._encoder.encode(
            "HEARTBEAT", type=_TYPE_ADSB, autopilot=_AUTOPILOT_INVALID, system_status=_ACTIVE, mavlink_version=3
        )
        if self._own >= len(fleet):
            return [heartbeat]
        here = fleet[self._own].position_ned_m
        contacts = [
            (math.dist(here, other.position_ned_m), index)
            for index, other in enumerate(fleet)
            if index != self._own and other.state is not VehicleState.GONE
        ]
        return [heartbeat, *(self._contact(index, fleet[index]) for _, index in sorted(contacts)[:NEAREST])]

    def _contact(self, index: int, navigation: Navigation) -> bytes:
        north, east, down = navigation.velocity_ned_mps
        callsign = f"RDLK{index + 1:04d}"
        return self._encoder.encode(
            "ADSB_VEHICLE",
            ICAO_address=icao_address(callsign),
            lat=dege7_from_deg(navigation.place().latitude_deg),
            lon=dege7_from_deg(navigation.place().longitude_deg),
            altitude_type=_GEOMETRIC,
            altitude=mm_from_m(navigation.place().altitude_m),
            heading=round(math.degrees(math.atan2(east, north)) * 100.0) % 36000,
            hor_velocity=min(cmps_from_mps(math.hypot(north, east)), 0xFFFF),
            ver_velocity=cmps_from_mps(-down),
            callsign=callsign,
            emitter_type=_EMITTER_UAV,
            tslc=0,
            flags=_VALID,
        )


def icao_address(name: str) -> int:
    """A 24-bit hash of a name, since contacts need an ICAO address, which drones do not have."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:3], "big")
