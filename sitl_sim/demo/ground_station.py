"""The ground station of a demonstration: hands every vehicle over to its daemon, and receives everything for the log.

It does what a person at a ground station does, by the same MAVLink: it sends DO_SET_MODE to OFFBOARD (PX4) or GUIDED
(ArduPilot) until the vehicle's heartbeat confirms the mode. Only the heartbeat is proof: PX4 acknowledges twice, and
the second acknowledgement may be a refusal.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Sequence

from ridlink.errors import LinkError
from ridlink.links import Link, open_link
from ridlink.mavlink.codec import CRC_EXTRAS, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.mavlink.ground_station import HEARTBEAT_EVERY_S, ground_station, heartbeat

MAV_AUTOPILOT_ARDUPILOTMEGA = 3
MAV_CMD_DO_SET_MODE = 176
ARDUCOPTER_GUIDED = 4
PX4_OFFBOARD = 6
RETRY_S = 0.25

Hear = Callable[[bytes], None]


class GroundStation:
    """One ground station for a whole fleet.

    Args:
        vehicle_ports: UDP port of each vehicle on loopback, in order of their system ids from 1.
        air_port: UDP port of the air.
        hear: Called with every received datagram, for the log.
        hear_air: Called, too, with datagrams of the air, for observers.
    """

    def __init__(self, vehicle_ports: Sequence[int], air_port: int, hear: Hear, hear_air: Hear) -> None:
        self._vehicle_ports = vehicle_ports
        self._air_port = air_port
        self._hear = hear
        self._hear_air = hear_air
        self._encoder = ground_station()
        self._links: list[Link] = []
        self._ardupilot: set[int] = set()
        self._external: set[int] = set()
        self._changed = asyncio.Event()

    async def open(self) -> None:
        """Connect to every vehicle and to the air."""
        for index, port in enumerate(self._vehicle_ports):
            self._links.append(await open_link(f"udpout:127.0.0.1:{port}", self._vehicle_handler(index + 1)))
        self._links.append(await open_link(f"udpout:127.0.0.1:{self._air_port}", self._take_from_air))

    async def say_hello(self) -> None:
        """Keep sending heartbeats to every vehicle and to the air, until cancelled, so that they send to this
        station."""
        while True:
            for link in self._links:
                link.send(heartbeat(self._encoder))
            await asyncio.sleep(HEARTBEAT_EVERY_S)

    async def close(self) -> None:
        """Close all links."""
        for link in self._links:
            link.close()

    async def hand_over(self, system_ids: Sequence[int], timeout_s: float) -> None:
        """Switch vehicles to the mode in which they obey their daemons.

        Raises:
            LinkError: If one of them does not confirm in time.
        """
        deadline = asyncio.get_running_loop().time() + timeout_s
        wanted = set(system_ids)
        while not wanted <= self._external:
            if asyncio.get_running_loop().time() > deadline:
                missing = ", ".join(map(str, sorted(wanted - self._external)))
                raise LinkError(f"no handover within {timeout_s:g} s: vehicle {missing} did not change its mode")
            for system_id in sorted(wanted - self._external):
                self._links[system_id - 1].send(self._set_mode(system_id))
            self._changed.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(RETRY_S):
                    await self._changed.wait()

    def _set_mode(self, system_id: int) -> bytes:
        main_mode = ARDUCOPTER_GUIDED if system_id in self._ardupilot else PX4_OFFBOARD
        return self._encoder.encode(
            "COMMAND_LONG",
            target_system=system_id,
            target_component=1,
            command=MAV_CMD_DO_SET_MODE,
            param1=129.0,  # armed, custom mode
            param2=float(main_mode),
        )

    def _vehicle_handler(self, system_id: int) -> Callable[[bytes, object], None]:
        def take(data: bytes, _: object) -> None:
            self._hear(data)
            if system_id in self._external:
                return
            for frame in parse_datagram(data, CRC_EXTRAS):
                if isinstance(frame, Frame) and frame.msgid == 0 and frame.sysid == system_id and frame.compid == 1:
                    self._see_heartbeat(frame)

        return take

    def _take_from_air(self, data: bytes, _: object) -> None:
        self._hear(data)
        self._hear_air(data)

    def _see_heartbeat(self, frame: Frame) -> None:
        said = decode_message(frame)
        if said.autopilot == MAV_AUTOPILOT_ARDUPILOTMEGA:
            self._ardupilot.add(frame.sysid)
            external = said.custom_mode == ARDUCOPTER_GUIDED
        else:
            external = (said.custom_mode >> 16) & 0xFF == PX4_OFFBOARD
        if external:
            self._external.add(frame.sysid)
            self._changed.set()
