"""A vehicle for the tests of the engine and the daemon: a point that obeys at once, and speaks as an autopilot does.

It stands in for no measured response; what matters here are the bytes and the order of events.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ridlink.geodesy import Geodetic, geodetic_from_ned, moved
from ridlink.links import Address, Link, open_link
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, Message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import Location, Separation, SeparationFlags
from tests.daemon.invariants import Observer, messages
from tests.loopback import PATIENCE_S

HOME = Geodetic(47.3977, 8.5456, 500.0)
GEOID_M = 47.0
OFFBOARD, POSITION_MODE = 6 << 16, 3 << 16
GUIDED, LOITER = 4, 5
ON_GROUND, IN_AIR, TAKING_OFF = 1, 2, 3
"""MAV_LANDED_STATE."""
PERIOD_S = 0.02
"""Between two of the vehicle's words, as PX4's onboard link has it."""


__all__ = ["GUIDED", "HOME", "IN_AIR", "LOITER", "OFFBOARD", "ON_GROUND", "PATIENCE_S", "POSITION_MODE", "TAKING_OFF",
           "Emulated", "LoopbackVehicle", "Observer", "at", "messages"]  # fmt: skip


def at(north_m: float, east_m: float = 0.0, up_m: float = 50.0) -> tuple[float, float, float]:
    """Latitude, longitude, altitude above mean sea level of a point about home."""
    return tuple(float(value) for value in geodetic_from_ned((north_m, east_m, -up_m), HOME))  # type: ignore[return-value]


class Emulated:
    """A point mass with an autopilot's voice."""

    def __init__(self, sysid: int = 1, *, ned_m: tuple[float, float, float] = (0.0, 0.0, -50.0), autopilot: int = 12,
                 error_m: float = 3.0, airframe_m: float = 0.6) -> None:  # fmt: skip
        self.sysid, self.autopilot = sysid, autopilot
        self.position, self.velocity = np.array(ned_m), np.zeros(3)
        self.mode = OFFBOARD if autopilot == 12 else GUIDED
        self.armed, self.fix_type, self.mav_type = True, 3, 2
        self.error_m, self.airframe_m = error_m, airframe_m
        self.landed_state: int | None = IN_AIR
        self.receiver_silent = False
        self.knows_ellipsoid, self.ellipsoid_wrong_m = True, 0.0
        self.observer = Observer(target=sysid)
        self.obeyed = False
        self.heard: list[Message] = []
        self.encoder = Encoder(sysid, 1)

    def _place(self) -> tuple[float, float, float]:
        """Latitude, longitude, altitude; within a few hundred metres flat coordinates are as good as exact ones."""
        north, east, down = (float(value) for value in self.position)
        return *moved(HOME.latitude_deg, HOME.longitude_deg, north, east), HOME.altitude_m - down

    def heartbeat(self) -> bytes:
        base_mode = 1 | (128 if self.armed else 0)
        return self.encoder.encode(
            "HEARTBEAT", type=self.mav_type, autopilot=self.autopilot, base_mode=base_mode, custom_mode=self.mode
        )

    def position_messages(self, now_s: float) -> bytes:
        latitude, longitude, altitude = self._place()
        place = {"lat": round(latitude * 1e7), "lon": round(longitude * 1e7), "alt": round(altitude * 1e3)}
        vx, vy, vz = (round(100 * value) for value in self.velocity)
        ellipsoid = round((altitude + GEOID_M + self.ellipsoid_wrong_m) * 1e3) if self.knows_ellipsoid else 0
        relative = round((altitude - HOME.altitude_m) * 1e3)
        encode = self.encoder.encode
        receiver = encode(
            "GPS_RAW_INT", fix_type=self.fix_type, h_acc=round(self.error_m / 3 * 1e3), v_acc=1000,
            alt_ellipsoid=ellipsoid, **place,
        )  # fmt: skip
        return (b"" if self.receiver_silent else receiver) + encode(
            "GLOBAL_POSITION_INT", time_boot_ms=round(1e3 * now_s) % 2**32, relative_alt=relative,
            vx=vx, vy=vy, vz=vz, **place,
        )  # fmt: skip

    def target_message(self, now_s: float) -> bytes:
        """What the vehicle flies after, as POSITION_TARGET_LOCAL_NED has it."""
        vx, vy, vz = (float(value) for value in self.velocity)
        mask = 0x0DC7 if self.obeyed else 0x0DF8
        return self.encoder.encode(
            "POSITION_TARGET_LOCAL_NED", time_boot_ms=round(1e3 * now_s) % 2**32, coordinate_frame=1, type_mask=mask,
            vx=vx, vy=vy, vz=vz,
        )  # fmt: skip

    def landed(self) -> bytes:
        """Whether it stands or flies; nothing where it does not tell."""
        if self.landed_state is None:
            return b""
        return self.encoder.encode("EXTENDED_SYS_STATE", landed_state=self.landed_state)

    def telemetry(self, now_s: float) -> bytes:
        return self.heartbeat() + self.landed() + self.position_messages(now_s)

    def remote_id(
        self, now_s: float, *, command: tuple[float, float, float] | None = None, extended: bool = True, **fields: Any
    ) -> bytes:
        latitude, longitude, altitude = self._place()
        north, east, down = (float(value) for value in self.velocity)
        location = Location(**({
            "status": 2, "latitude_deg": latitude, "longitude_deg": longitude,
            "altitude_geodetic_m": altitude + GEOID_M, "speed_horizontal_mps": math.hypot(north, east),
            "speed_vertical_mps": -down, "direction_deg": math.degrees(math.atan2(east, north)) % 360.0,
            "timestamp_s": now_s % 3600.0,
        } | fields))  # fmt: skip
        parts: list[Any] = [location]
        if extended:
            flags = SeparationFlags.AVOIDING
            flags |= SeparationFlags.COMMANDED_VELOCITY_GIVEN if command else SeparationFlags(0)
            vx, vy, vz = command or (None, None, None)
            parts.append(Separation(
                timestamp_s=location.timestamp_s, horizontal_error_m=self.error_m, vertical_error_m=3.0,
                velocity_error_mps=0.3, airframe_size_m=self.airframe_m, airframe_height_m=0.3, update_interval_s=0.1,
                commanded_vx_mps=vx, commanded_vy_mps=vy, commanded_vz_mps=vz, flags=flags,
                id_or_mac=location.id_or_mac,
            ))  # fmt: skip
        return b"".join(self.encoder.encode(name, **values) for name, values in map(to_mavlink, parts))

    def hear(self, data: bytes, observer: Observer | None = None) -> list[Message]:
        """Take what a daemon sends; setpoints are obeyed at once, in the right mode."""
        observer = observer or self.observer
        external = self.mode in (OFFBOARD, GUIDED)
        observer.steerable = self.armed and (external or (self.autopilot == 12 and not self.obeyed))
        found = observer.watch(data)
        self.heard += found
        for message in found:
            if message.name == "SET_POSITION_TARGET_LOCAL_NED" and self.armed and self.mode in (OFFBOARD, GUIDED):
                self.velocity = np.array([message.vx, message.vy, message.vz])
                self.obeyed = True
        return found

    def advance(self, elapsed_s: float) -> None:
        self.position = self.position + self.velocity * elapsed_s


def pass_heartbeats_on(data: bytes, link: Link) -> None:
    """As autopilots do with what they hear on one link."""
    for frame in parse_datagram(data, CRC_EXTRAS):
        if isinstance(frame, Frame) and frame.msgid == 0:
            link.send(frame.raw)


class LoopbackVehicle:
    """An `Emulated` on a real link, telling its state every 20 ms and its heartbeat at once when it changes.

    Args:
        port: UDP port on which the daemon listens.
        url: Another way to it.
    """

    def __init__(self, emulated: Emulated, port: int = 0, *, url: str | None = None) -> None:
        self.vehicle, self.port, self.url = emulated, port, url or f"udpout:127.0.0.1:{port}"
        self.began_s = 0.0
        self.silent = False
        self.passes_on = True
        self.frozen = False
        self.deaf = False
        self.words = 0
        self.last = b""
        self.sources: set[Address] = set()
        self.second = Observer(target=emulated.sysid)
        self._second_link: Link | None = None
        self._link: Link | None = None
        self._changed = asyncio.Event()
        self._spoken = asyncio.Event()
        self._ended = asyncio.Event()
        self._failure: BaseException | None = None

    async def __aenter__(self) -> LoopbackVehicle:
        self._link = await open_link(self.url, self._hear)
        self._task = asyncio.create_task(self._speak())
        return self

    async def __aexit__(self, *_: object) -> None:
        self._ended.set()
        await self._task
        for link in (self._link, self._second_link):
            if link is not None:
                link.close()
        if self._failure is not None:
            raise self._failure

    def _hear(self, data: bytes, address: Address) -> None:
        self.last = data
        if self._second_link is not None and self.passes_on:
            pass_heartbeats_on(data, self._second_link)
        try:
            if not self.deaf:
                self.vehicle.hear(data)
        except AssertionError as failure:  # the link would only count it
            self._failure = failure
        self.sources.add(address)
        self._changed.set()

    async def join(self, port: int) -> None:
        """Tell another daemon, too, and listen to it."""
        self._second_link = await open_link(f"udpout:127.0.0.1:{port}", self._hear_second)

    def _hear_second(self, data: bytes, _: Address) -> None:
        if self._link is not None and self.passes_on:
            pass_heartbeats_on(data, self._link)
        try:
            self.vehicle.hear(data, self.second)
        except AssertionError as failure:
            self._failure = failure
        self._changed.set()

    def send(self, data: bytes) -> None:
        assert self._link is not None
        self._link.send(data)
        if self._second_link is not None:
            self._second_link.send(data)

    async def _speak(self) -> None:
        loop = asyncio.get_running_loop()
        self.began_s = loop.time()
        while not self._ended.is_set():
            now_s = max(loop.time() - self.began_s, 0.0)
            if not self.silent:
                self.send(self.vehicle.heartbeat() + self.vehicle.landed())
                if not self.frozen:
                    self.send(self.vehicle.position_messages(now_s) + self.vehicle.target_message(now_s))
            self.vehicle.advance(PERIOD_S)
            self.words += 1
            self._spoken.set()
            # No grid: the clock of an autopilot drifts against that of the daemon.
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(PERIOD_S):
                    await self._ended.wait()

    def setpoints(self) -> list[Message]:
        return self.vehicle.observer.setpoints

    async def changed(self) -> None:
        """Wait for a datagram."""
        if self._failure is not None:
            raise self._failure
        self._changed.clear()
        await self._changed.wait()

    async def speaks(self, times: int) -> None:
        """Wait until it has told its state so many more times: how time passes while the daemon says nothing."""
        enough = self.words + times
        async with asyncio.timeout(PATIENCE_S):
            while self.words < enough:
                self._spoken.clear()
                await self._spoken.wait()

    async def until(self, condition: Callable[[], bool]) -> None:
        """Wait for something that comes with a datagram."""
        async with asyncio.timeout(PATIENCE_S):
            while not condition():
                await self.changed()
