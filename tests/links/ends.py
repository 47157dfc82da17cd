"""Ends of links that tests hold: what comes can be waited for, and what was counted."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable

from ridlink.links import Address, Link
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.signing import EPOCH_UTC_S, Signing
from tests.loopback import PATIENCE_S

UTC_S = EPOCH_UTC_S + 400_000_000.0


class Inbox:
    """Collects what a link hands over, and can be waited for."""

    def __init__(self) -> None:
        self.datagrams: list[tuple[bytes, Address]] = []
        self._changed = asyncio.Event()

    @property
    def heard(self) -> list[bytes]:
        return [data for data, _ in self.datagrams]

    def __call__(self, data: bytes, address: Address) -> None:
        self.datagrams.append((data, address))
        self._changed.set()

    async def until(self, condition: Callable[[], bool], patience_s: float = PATIENCE_S) -> None:
        async with asyncio.timeout(patience_s):
            while not condition():
                self._changed.clear()
                await self._changed.wait()

    async def count(self, number: int, patience_s: float = PATIENCE_S) -> list[bytes]:
        await self.until(lambda: len(self.datagrams) >= number, patience_s)
        return self.heard


class Told(Counter[str]):
    """Counts that can be waited for."""

    def __init__(self, counts: Counter[str]) -> None:
        self.changed = asyncio.Event()
        super().__init__(counts)

    def __setitem__(self, cause: str, count: int) -> None:
        super().__setitem__(cause, count)
        self.changed.set()


async def counted(link: Link, cause: str) -> None:
    """Wait until a link has counted something."""
    told = link.counters = Told(link.counters)
    async with asyncio.timeout(PATIENCE_S):
        while not told[cause]:
            told.changed.clear()
            await told.changed.wait()


def heartbeat(seq: int = 0) -> bytes:
    encoder = Encoder(1, 1)
    encoder.seq = seq
    return encoder.encode("HEARTBEAT", type=2, autopilot=12)


def signed(encoder: Encoder, signing: Signing, utc_s: float = UTC_S) -> bytes:
    """A signed heartbeat of a vehicle."""
    return signing.sign(encoder.encode("HEARTBEAT", type=2, autopilot=12), CRC_EXTRAS[0], utc_s)
