"""A UDP proxy between two programs that acts as a bad network.

Each peer that sends to its port gets its own port towards the far end, so that it gets its own answers, as with a
router with address translation.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
from collections import Counter
from dataclasses import dataclass, field, replace

from ridlink.errors import ConfigError, LinkError
from ridlink.impair.model import Impairer, Impairment
from ridlink.links import Address, Link, LinkUrl, Scheme, open_link

FORGOTTEN_AFTER_S = 60.0
"""The port of a peer may be closed if nothing was sent or answered for this long."""

MOST_SPEAKERS = 256

MOST_WAITING = 100_000
"""Most delayed datagrams at a time; further ones are dropped and counted."""

NO_IMPAIRMENT = Impairment()


@dataclass(slots=True)
class _Speaker:
    there: Impairer
    back: Impairer
    heard_at_s: float
    link: Link | None = None
    before_open: list[bytes] = field(default_factory=list)


class Proxy:
    """Forwards datagrams both ways; made by `open_proxy`.

    Attributes:
        counters: Failures of the proxy itself: ``unroutable``, ``too_many_speakers``, ``too_many_waiting``.
    """

    def __init__(self, far: LinkUrl, there: Impairment, back: Impairment, seed: int) -> None:
        self.counters: Counter[str] = Counter()
        self.near: Link
        self._far = far
        self._there = there
        self._back = back
        self._seed = seed
        self._loop = asyncio.get_running_loop()
        self._speakers: dict[Address, _Speaker] = {}
        self._numbers = itertools.count()
        self._opening: set[asyncio.Task[None]] = set()
        self._waiting: list[tuple[float, int, bool, Address, bytes]] = []
        self._order = itertools.count()
        self._timer: asyncio.TimerHandle | None = None
        self._past: tuple[Counter[str], Counter[str]] = (Counter(), Counter())

    @property
    def speakers(self) -> int:
        """Number of peers that have a port towards the far end now."""
        return len(self._speakers)

    def totals(self) -> tuple[Counter[str], Counter[str]]:
        """Counters of datagrams to the far end, and back, over all peers."""
        there, back = self._past[0].copy(), self._past[1].copy()
        for speaker in self._speakers.values():
            there.update(speaker.there.counters)
            back.update(speaker.back.counters)
        return there, back

    def receive(self, data: bytes, address: Address) -> None:
        """Take a datagram for the far end."""
        now_s = self._loop.time()
        speaker = self._speakers.get(address) or self._meet(address, now_s)
        if speaker is None:
            self.counters["too_many_speakers"] += 1
            return
        speaker.heard_at_s = now_s
        self._schedule(speaker.there.take(data, now_s), True, address, now_s)

    def close(self) -> None:
        """Close all ports; delayed datagrams are dropped."""
        if self._timer is not None:
            self._timer.cancel()
        for task in self._opening:
            task.cancel()
        for speaker in self._speakers.values():
            if speaker.link is not None:
                speaker.link.close()
        self.near.close()

    def _meet(self, address: Address, now_s: float) -> _Speaker | None:
        if len(self._speakers) >= MOST_SPEAKERS:
            self._forget_silent(now_s)
        if len(self._speakers) >= MOST_SPEAKERS:
            return None
        number = next(self._numbers)
        speaker = _Speaker(
            Impairer(self._there, (self._seed, number, 0)), Impairer(self._back, (self._seed, number, 1)), now_s
        )
        self._speakers[address] = speaker
        task = self._loop.create_task(self._open(address, speaker))
        self._opening.add(task)
        task.add_done_callback(self._opening.discard)
        return speaker

    def _forget_silent(self, now_s: float) -> None:
        for address, speaker in list(self._speakers.items()):
            if speaker.link is not None and now_s - speaker.heard_at_s > FORGOTTEN_AFTER_S:
                speaker.link.close()
                self._part_with(address)

    def _part_with(self, address: Address) -> None:
        speaker = self._speakers.pop(address)
        self._past[0].update(speaker.there.counters)
        self._past[1].update(speaker.back.counters)

    async def _open(self, address: Address, speaker: _Speaker) -> None:
        def answer(data: bytes, _: Address) -> None:
            now_s = self._loop.time()
            speaker.heard_at_s = now_s
            self._schedule(speaker.back.take(data, now_s), False, address, now_s)

        try:
            speaker.link = await open_link(self._far, answer)
        except LinkError:
            self.counters["unroutable"] += len(speaker.before_open)
            self._part_with(address)
            return
        for data in speaker.before_open:
            speaker.link.send(data)
        speaker.before_open.clear()

    def _schedule(self, leaving: list[tuple[float, bytes]], there: bool, address: Address, now_s: float) -> None:
        for due_s, data in leaving:
            if due_s <= now_s:
                self._send(there, address, data)
            elif len(self._waiting) >= MOST_WAITING:
                self.counters["too_many_waiting"] += 1
            else:
                heapq.heappush(self._waiting, (due_s, next(self._order), there, address, data))
        self._wake()

    def _wake(self) -> None:
        if not self._waiting:
            return
        due_s = self._waiting[0][0]
        if self._timer is not None:
            if self._timer.when() <= due_s:
                return
            self._timer.cancel()
        self._timer = self._loop.call_at(due_s, self._send_due)

    def _send_due(self) -> None:
        self._timer = None
        now_s = self._loop.time()
        while self._waiting and self._waiting[0][0] <= now_s:
            _, _, there, address, data = heapq.heappop(self._waiting)
            self._send(there, address, data)
        self._wake()

    def _send(self, there: bool, address: Address, data: bytes) -> None:
        if not there:
            self.near.send(data, address)
            return
        speaker = self._speakers.get(address)
        if speaker is None:
            self.counters["unroutable"] += 1
        elif speaker.link is None:
            speaker.before_open.append(data)
        else:
            speaker.link.send(data)


async def open_proxy(
    near: LinkUrl, far: LinkUrl, *, there: Impairment = NO_IMPAIRMENT, back: Impairment = NO_IMPAIRMENT, seed: int = 1
) -> Proxy:
    """Open a proxy that listens, and forwards all peers to the far end.

    Args:
        near: Link to listen on (``udpin``).
        far: Link to the far end (``udpout``).
        there: Impairment of datagrams to the far end.
        back: Impairment of its answers.
        seed: Seed of all draws: the same datagrams in the same order from each peer meet the same faults.

    Raises:
        ConfigError: If a link has another scheme, or ``far`` leads to ``near``.
        LinkError: If the port is in use, or the far end has no address.
    """
    if near.scheme is not Scheme.UDPIN:
        raise ConfigError(f"{near}: the proxy listens on UDP; write {_udp('udpin', near)}")
    if far.scheme is not Scheme.UDPOUT:
        raise ConfigError(f"{far}: the proxy speaks UDP to the far end; write {_udp('udpout', far)}")
    if far.leads_to(near):
        raise ConfigError(f"{far}: is the near end itself; what comes would go round for ever")
    (await open_link(far, lambda *_: None)).close()  # says now why nobody would get through
    proxy = Proxy(far, there, back, seed)
    proxy.near = await open_link(near, proxy.receive)
    return proxy


def _udp(scheme: str, url: LinkUrl) -> str:
    return f"{scheme}:HOST:PORT" if url.scheme is Scheme.SERIAL else str(replace(url, scheme=Scheme(scheme)))
