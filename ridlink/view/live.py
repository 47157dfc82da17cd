"""Live traffic: datagrams of a link become an instant every tenth of a second."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from ridlink.links import Link
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.mavlink.ground_station import HEARTBEAT_EVERY_S, ground_station, heartbeat
from ridlink.observer import Sky
from ridlink.view.scenery import Pair
from ridlink.view.server import ViewServer
from ridlink.view.show import Show
from ridlink.view.wire import STEP_S

Truth = Callable[[Sky], Mapping[str, Pair]]
"""True positions by the names of vehicles in a sky."""


class Receiver:
    """Fills a show with received traffic.

    Args:
        show: The show.
        sky: The aircraft in the air.
        truth: True positions, if known.
    """

    def __init__(self, show: Show, *, sky: Sky | None = None, truth: Truth | None = None) -> None:
        self.sky = sky or Sky()
        self._show = show
        self._truth = truth
        self._begun_s = time.monotonic()
        self._rejects: Counter[str] = Counter()
        self._frames = 0
        self._counted_s = self._begun_s
        self._lag_s = 0.0

    def hear(self, data: bytes, _: object = None) -> None:
        """Receive a datagram."""
        now_s = time.monotonic() - self._begun_s
        for found in parse_datagram(data, CRC_EXTRAS):
            if isinstance(found, Frame):
                self._frames += 1
                self.sky.receive(found, now_s)
            else:
                self._rejects[str(found.cause)] += 1

    def health(self) -> Mapping[str, Any]:
        """Figures since the last call."""
        now_s = time.monotonic()
        lasted_s, self._counted_s = max(now_s - self._counted_s, 1e-3), now_s
        frames, self._frames = self._frames, 0
        lag_s, self._lag_s = self._lag_s, 0.0
        rejects = {**self._rejects, **self.sky.rejects}
        return {
            "frames_per_s": round(frames / lasted_s, 1),
            "vehicles": len(self.sky.aircraft),
            "rejects": rejects,
            "lag_ms": round(1e3 * lag_s, 1),
        }

    async def run(self, server: ViewServer) -> None:
        """Add an instant every tenth of a second, until cancelled."""
        show, sky = self._show, self.sky
        step = 0
        while True:
            now_s = time.monotonic() - self._begun_s
            self._lag_s = max(self._lag_s, now_s - step * STEP_S)
            step = max(step, int(now_s / STEP_S + 1e-6))  # missed instants are not made up for
            sky.forget_silent(now_s)
            if show.scenery.origin is None and sky.origin is not None:
                show.locate(sky.origin)
            show.add(sky.at(now_s), self._truth(sky) if self._truth is not None else None)
            server.publish()
            step += 1
            await asyncio.sleep(max(0.0, step * STEP_S - (time.monotonic() - self._begun_s)))


async def subscribe(link: Link) -> None:
    """Send heartbeats to a link until cancelled, which subscribes to the air."""
    encoder = ground_station()
    while True:
        link.send(heartbeat(encoder))
        await asyncio.sleep(HEARTBEAT_EVERY_S)
