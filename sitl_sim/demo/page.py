"""The page of a demonstration: shows received traffic with the true positions, flight after flight."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AsyncExitStack

from ridlink.companions import beside
from ridlink.errors import LinkError
from ridlink.observer import Sky
from ridlink.remote_id.text import display_text
from ridlink.view.kernels import load_kernels
from ridlink.view.live import Receiver
from ridlink.view.scenery import Pair, Scenery
from ridlink.view.server import DEFAULT_PORT, ViewServer
from ridlink.view.show import Show
from sitl_sim.broadcast import uas_id_of
from sitl_sim.demo.flight import Onlooker
from sitl_sim.demo.options import DemoOptions
from sitl_sim.fleet_config import HOST
from sitl_sim.server import FleetServer


class Page(Onlooker):
    """Shows one flight after another.

    Args:
        on_ready: Called once, when the first flight has its ports.

    Attributes:
        server: The server of the page.
    """

    def __init__(self, on_ready: Callable[[], None]) -> None:
        self._on_ready: Callable[[], None] | None = on_ready
        self._show = Show(Scenery("the flight is being prepared", "demo", live=True, truth=True))
        self._receiver: Receiver | None = None
        self._flight, self._served = AsyncExitStack(), AsyncExitStack()
        self.server = ViewServer(self._show, HOST, 0, health=self._health)

    async def open(self, port: int | None) -> bool:
        """Listen.

        Args:
            port: Port; None for the usual port, or any other if that is in use.

        Returns:
            False if the page is not at the usual port, because that is in use.

        Raises:
            LinkError: If the requested port is in use.
        """
        for attempt in (DEFAULT_PORT, 0) if port is None else (port,):
            self.server = ViewServer(self._show, HOST, attempt, health=self._health)
            try:
                await self._served.enter_async_context(self.server.serving())
            except LinkError:
                if port is None and attempt:
                    continue
                raise
            return port is not None or attempt == DEFAULT_PORT
        raise LinkError("no port for the page")

    def ready(self) -> None:
        """A flight has its ports."""
        if self._on_ready is not None:
            self._on_ready()
            self._on_ready = None

    async def begin(self, fleet: FleetServer, title: str, options: DemoOptions) -> None:
        """Show another flight; its kernels have been loaded."""
        await self.end()
        vehicles = fleet.scenario.vehicles
        names = [display_text(uas_id_of(row + 1)) for row in range(len(vehicles))]

        def truth(sky: Sky) -> Mapping[str, Pair]:
            position, real = fleet.world.position_ned_m, ~fleet.world.is_ghost
            rows = ((one.name, one.report.source[0] - 1) for one in sky.aircraft.values())
            return {name: _pair(position[row]) for name, row in rows if 0 <= row < len(position) and real[row]}

        scenery = Scenery(
            title,
            "demo",
            live=True,
            truth=True,
            utc0_s=time.time(),
            origin=fleet.home,
            obstacles=[[_pair(corner) for corner in one.polygon_ne_m] for one in fleet.scenario.obstacles],
            goals={name: _pair(one.goal_ned_m) for name, one in zip(names, vehicles, strict=True)},
            cruises={name: one.speed_mps for name, one in zip(names, vehicles, strict=True)},
        )
        self._show.definition = options.definition
        self._show.restart(scenery)
        sky = Sky(origin=fleet.home, convention=options.accuracy_convention)
        self._receiver = Receiver(self._show, sky=sky, truth=truth)
        await self._flight.enter_async_context(beside(self._receiver.run(self.server)))
        await load_kernels(self._show)

    def hear(self, data: bytes) -> None:
        """A datagram of the air."""
        if self._receiver is not None:
            self._receiver.hear(data)

    async def end(self) -> None:
        """The flight is over; its history stays."""
        if self._receiver is not None:
            self._receiver = None
            await self._flight.aclose()
            self._show.finish()
            self.server.publish()

    async def close(self) -> None:
        """Close the page."""
        await self.end()
        await self._served.aclose()

    def _health(self) -> Mapping[str, object]:
        return self._receiver.health() if self._receiver is not None else {}


def _pair(place: Sequence[float]) -> Pair:
    return round(float(place[0]), 3), round(float(place[1]), 3)
