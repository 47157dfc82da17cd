"""Fleets on real loopback sockets while something is done with them, and those who speak to them."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, ClassVar

from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, Message, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.scenario import Scenario, built_in
from sitl_sim.autopilot import Start
from sitl_sim.fleet_config import FleetConfig
from sitl_sim.server import FleetServer
from tests.loopback import PATIENCE_S

FLIGHT_S = 60.0 + 4.0 * PATIENCE_S
"""So long may last what is done with a fleet."""

CLIENT = Path(__file__).with_name("mavutil_client.py")
ANY_PORT: dict[str, Any] = {"vehicle_port": 0, "companion_port": 0, "air_port": 0}


def fly(scenario: Scenario, act: Callable[[FleetServer], Awaitable[None]], **config: Any) -> FleetServer:
    """Run a fleet on ports of the kernel's choice while `act` lasts."""
    server = FleetServer(scenario, FleetConfig(**{**ANY_PORT, **config}))
    asyncio.run(run(server, act))
    assert server.counters["error"] == 0
    return server


def fly_both_autopilots(act: Callable[[FleetServer], Awaitable[None]], start: Start = Start.GROUND) -> None:
    """Run one vehicle of each autopilot at the same time: these flights take as long as flights take."""
    configs = [FleetConfig(autopilot=flavour, sigma_m=0.0, start=start, **ANY_PORT) for flavour in ("px4", "ardupilot")]

    async def fly_them() -> None:
        await asyncio.gather(*(run(FleetServer(built_in("circle8", 1), config), act) for config in configs))

    asyncio.run(fly_them())


async def run(server: FleetServer, act: Callable[[FleetServer], Awaitable[None]]) -> None:
    await server.start()
    stop = asyncio.Event()
    flying = asyncio.create_task(server.run(stop))
    try:
        await asyncio.wait_for(act(server), FLIGHT_S)
    finally:
        stop.set()
        await flying
        await server.close()
        Client.close_all()


class Client(asyncio.DatagramProtocol):
    """A socket whose messages are waited for."""

    opened: ClassVar[list[asyncio.DatagramTransport]] = []

    def __init__(self, sysid: int, compid: int) -> None:
        self.encoder = Encoder(sysid, compid)
        self.heard: list[tuple[int, Message]] = []
        self._more = asyncio.Event()

    @classmethod
    async def open(cls, port: int, sysid: int = 255, compid: int = 190) -> Client:
        loop = asyncio.get_running_loop()
        _, client = await loop.create_datagram_endpoint(lambda: cls(sysid, compid), remote_addr=("127.0.0.1", port))
        client.send("HEARTBEAT", type=18, autopilot=8, mavlink_version=3)
        return client

    def connection_made(self, transport: Any) -> None:
        self.transport = transport
        self.opened.append(transport)

    @classmethod
    def close_all(cls) -> None:
        while cls.opened:
            cls.opened.pop().close()

    def datagram_received(self, data: bytes, addr: Any) -> None:
        for frame in parse_datagram(data, CRC_EXTRAS):
            assert isinstance(frame, Frame)
            self.heard.append((frame.sysid, decode_message(frame)))
        self._more.set()

    def send(self, name: str, **fields: Any) -> None:
        self.transport.sendto(self.encoder.encode(name, **fields))

    async def until(self, wanted: Callable[[list[tuple[int, Message]]], Any]) -> Any:
        """Wait until something that was heard satisfies `wanted`."""

        async def wait() -> Any:
            while not (found := wanted(self.heard)):
                self._more.clear()
                await self._more.wait()
            return found

        return await asyncio.wait_for(wait(), PATIENCE_S)

    async def anything(self) -> None:
        """Wait for whatever comes next."""
        count = len(self.heard)
        await self.until(lambda heard: len(heard) > count)

    async def one(self, name: str, wanted: Callable[[Message], bool] = lambda _: True) -> Message:
        """Wait for a message."""
        found: Message = await self.until(
            lambda heard: next((m for _, m in heard if m.name == name and wanted(m)), None)
        )
        return found


async def run_client(*arguments: str, client: Path = CLIENT) -> dict[str, Any]:
    process = await asyncio.create_subprocess_exec(
        sys.executable, str(client), *arguments, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
    )
    output, complaints = await process.communicate()
    assert process.returncode == 0, complaints.decode()
    seen: dict[str, Any] = json.loads(output.splitlines()[-1])
    return seen
