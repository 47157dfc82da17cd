"""Whoever sends to the Remote ID port of a daemon that flies: anything at all, and then looks what became of it."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np

from ridlink.engine import EngineConfig, Goal
from ridlink.engine.decision import DecisionRecord
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.crc import checksum
from ridlink.traffic.picture import TrafficPicture
from ridlink.traffic.snapshot import Snapshot
from tests.daemon.emulated import PATIENCE_S, Emulated, LoopbackVehicle, at
from tests.daemon.harness import Running, running
from tests.loopback import run


class Hostile:
    """Whoever sends to the Remote ID port of a flying daemon."""

    def __init__(self, flight: Running) -> None:
        self.flight, self.engine = flight, flight.daemon.engine
        self.other = Emulated(9, ned_m=(150.0, 60.0, -50.0))

    @property
    def vehicle(self) -> LoopbackVehicle:
        return self.flight.vehicle

    @property
    def last(self) -> DecisionRecord:
        """What the last step saw and decided."""
        record = self.engine._last_record
        assert record is not None
        return record

    @property
    def picture(self) -> TrafficPicture:
        return self.engine.picture

    def counted(self, cause: str) -> int:
        return self.engine.counters[cause]

    async def send(self, *datagrams: bytes) -> None:
        """Send, and wait until a datagram sent last was read: a message that nobody knows."""
        link = self.flight.air.link
        assert link is not None
        before = self.counted("mavlink_1_frame")
        for datagram in datagrams:
            assert link.send(datagram)
        link.send(v1_frame())
        await self.flight.vehicle.until(lambda: self.counted("mavlink_1_frame") > before)

    def snapshot(self) -> Snapshot:
        loop_s = self.engine._last_step_s
        assert loop_s is not None
        own = self.engine.telemetry.state(loop_s)
        assert own is not None
        return self.picture.snapshot(own, loop_s)

    def radius_m(self) -> np.ndarray:
        """Radii of the discs now, without what age adds."""
        loop_s, snapshot = self.engine._last_step_s, self.snapshot()
        own = self.engine.telemetry.state(loop_s or 0.0)
        assert own is not None
        return self.engine.steering.decider.discs.against(own, 0.0, snapshot).radius_m


def v1_frame() -> bytes:
    """A MAVLink 1 HEARTBEAT."""
    body = bytes((9, 0, 9, 1, 0)) + struct.pack("<IBBBBB", 0, 2, 12, 0, 0, 3)
    return b"\xfe" + body + checksum(body, CRC_EXTRAS[0]).to_bytes(2, "little")


def location(**fields: Any) -> bytes:
    """A LOCATION of vehicle 9 with any integers at all."""
    north = at(150.0, 60.0)
    plain: dict[str, Any] = {
        "status": 2, "latitude": round(north[0] * 1e7), "longitude": round(north[1] * 1e7), "direction": 18000,
        "speed_horizontal": 500, "altitude_geodetic": 597.0, "timestamp": 65535.0,
    }  # fmt: skip
    return Encoder(9, 1).encode("OPEN_DRONE_ID_LOCATION", **(plain | fields))


def flown(test: Callable[[Hostile], Awaitable[None]], engine: EngineConfig | None = None, **options: Any) -> None:
    """Flies a daemon, runs the test beside it, and sees that it flies on; options as of `running`."""

    async def main() -> None:
        config = engine or EngineConfig(goal=Goal(*at(300.0)), vehicle_sysid=1)
        async with running(engine=config, **options) as flight:
            await flight.vehicle.until(lambda: len(flight.vehicle.setpoints()) >= 2)
            async with asyncio.timeout(PATIENCE_S):
                await flight.air.changed.wait()  # it knows us by our HEARTBEAT
            await test(Hostile(flight))
            count = len(flight.vehicle.setpoints())
            await flight.vehicle.until(lambda: len(flight.vehicle.setpoints()) > count)

    run(main)
