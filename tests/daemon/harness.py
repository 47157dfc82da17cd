"""A daemon, its vehicle and its air on real loopback sockets, under the eyes of an observer of the invariants."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from ridlink.daemon.config import DaemonConfig
from ridlink.daemon.service import AvoidDaemon
from ridlink.daemon.summary import Summary
from ridlink.engine import EngineConfig, Goal
from ridlink.failsafe import State
from ridlink.impair.model import Impairment
from ridlink.impair.proxy import open_proxy
from ridlink.links import Link, open_link, parse_link_url
from tests.daemon.emulated import PATIENCE_S, Emulated, LoopbackVehicle, at


class Air:
    """The other end of the Remote ID link: remembers who subscribed."""

    def __init__(self) -> None:
        self.link: Link | None = None
        self.heard: list[bytes] = []
        self.changed = asyncio.Event()

    async def __aenter__(self) -> Air:
        self.link = await open_link("udpin:127.0.0.1:0", self._hear)
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self.link is not None
        self.link.close()

    def _hear(self, data: bytes, _: object) -> None:
        self.heard.append(data)
        self.changed.set()

    @property
    def port(self) -> int:
        assert self.link is not None
        return self.link.local_address[1]


class Running:
    """A daemon, its vehicle and its air."""

    def __init__(self, daemon: AvoidDaemon, vehicle: LoopbackVehicle, air: Air, events: list[dict[str, Any]]) -> None:
        self.daemon, self.vehicle, self.air, self.events = daemon, vehicle, air, events
        self.stop = asyncio.Event()
        self.task: asyncio.Task[Summary] | None = None

    async def end(self) -> Summary:
        assert self.task is not None
        self.stop.set()
        async with asyncio.timeout(PATIENCE_S):
            return await self.task


@asynccontextmanager
async def _impaired(port: int, impairment: Impairment | None) -> AsyncIterator[int]:
    """Where to speak to a port behind a bad network; the port itself without one."""
    if impairment is None:
        yield port
        return
    near, far = parse_link_url("udpin:127.0.0.1:0"), parse_link_url(f"udpout:127.0.0.1:{port}")
    proxy = await open_proxy(near, far, back=impairment)
    try:
        yield proxy.near.local_address[1]
    finally:
        proxy.close()


@asynccontextmanager
async def running(
    *, emulated: Emulated | None = None, impairment: Impairment | None = None, **options: Any
) -> AsyncIterator[Running]:
    """A daemon that flies.

    Args:
        emulated: The vehicle.
        impairment: What becomes of the Remote ID on its way to the daemon.
        options: Of `DaemonConfig`.
    """
    engine = options.pop("engine", EngineConfig(goal=Goal(*at(300.0))))
    events: list[dict[str, Any]] = []
    async with Air() as air, _impaired(air.port, impairment) as air_port:
        config = DaemonConfig(
            vehicle="udpin:127.0.0.1:0", remote_id=f"udpout:127.0.0.1:{air_port}", engine=engine, **options
        )
        daemon = AvoidDaemon(config, on_event=events.append)
        stop = asyncio.Event()
        task = asyncio.create_task(daemon.run(stop))
        async with asyncio.timeout(60.0):  # a cold cache of compiled kernels
            await daemon.ready.wait()
        assert daemon.vehicle_address is not None
        async with LoopbackVehicle(emulated or Emulated(), daemon.vehicle_address[1]) as vehicle:
            run = Running(daemon, vehicle, air, events)
            run.stop, run.task = stop, task
            try:
                yield run
            finally:
                stop.set()
                await asyncio.gather(task, return_exceptions=True)


def state(flight: Running) -> State:
    return flight.daemon.engine.rung.state


def holds(flight: Running, reason: str) -> bool:
    """Whether it holds for that reason: on a busy machine it also holds for a step after its loop paused."""
    return state(flight) is State.HOLD and reason in flight.daemon.engine.rung.reason
