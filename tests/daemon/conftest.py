"""Whatever a test of this folder is about, every daemon that it starts flies under the eyes of an observer.

It stands at the daemon's own end of the vehicle link and sees what is heard and said there, before signatures and
sockets. `LoopbackVehicle` has another one at the far end, which also sees daemons that are processes of their own.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from ridlink.daemon import service
from ridlink.daemon.service import AvoidDaemon
from ridlink.daemon.vehicle_link import open_vehicle_link
from ridlink.links import Address, Link, LinkUrl, SigningOptions
from ridlink.mavlink.codec import CRC_EXTRAS, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from tests.daemon.invariants import ASKED, GUARDING, LEAST_BETWEEN_WORDS_S, Observer

ARMED, PX4, AUTOPILOTS = 128, 12, (3, 12)
OFFBOARD_MAIN_MODE, GUIDED = 6, 4


class Watched:
    """One daemon, from its own end of the vehicle link."""

    def __init__(self, daemon: AvoidDaemon) -> None:
        engine = daemon.config.engine
        self.observer = Observer(
            engine.limits, engine.vehicle_sysid or 1, ASKED | GUARDING if engine.guard else ASKED, steerable=False
        )
        self.failures: list[AssertionError] = []
        self._pinned = engine.vehicle_sysid
        self._vehicle: int | None = None
        self._taken_back = False
        self._said_at_s: dict[str, float] = {}

    def hears(self, data: bytes) -> None:
        """What a heartbeat says of who may steer; the first autopilot is the one that counts."""
        for frame in parse_datagram(data, CRC_EXTRAS):
            if not isinstance(frame, Frame) or not frame.checked or (frame.msgid, frame.compid) != (0, 1):
                continue
            beat = decode_message(frame)
            if beat.autopilot not in AUTOPILOTS or self._pinned not in (None, frame.sysid):
                continue
            if self._vehicle is None:
                self._vehicle = self.observer.target = frame.sysid
            if frame.sysid == self._vehicle:
                self._mode(beat.autopilot == PX4, beat.custom_mode, bool(beat.base_mode & ARMED))

    def _mode(self, px4: bool, custom_mode: int, armed: bool) -> None:
        external = (custom_mode >> 16) & 0xFF == OFFBOARD_MAIN_MODE if px4 else custom_mode == GUIDED
        self._taken_back |= not external and any(each.vx or each.vy for each in self.observer.setpoints)
        # A PX4 that waits wants a stream before it is given its mode, and never after a pilot has taken over.
        self.observer.steerable = armed and (external or (px4 and not self._taken_back))

    def says(self, data: bytes) -> None:
        try:
            self.observer.watch(data)
        except AssertionError as failure:  # within the daemon it would only be counted
            self.failures.append(failure)

    def tells(self, event: str, facts: dict[str, Any], now_s: float) -> None:
        """A line of `--json`; no cause is told more often than once a second."""
        cause = f"{event} {facts.get('text', '')}"
        if event in ("warning", "recording_ended"):
            last_s = self._said_at_s.get(cause)
            if last_s is not None and now_s - last_s < LEAST_BETWEEN_WORDS_S:
                self.failures.append(AssertionError(f"I7: {cause!r} twice within {now_s - last_s:.2f} s"))
            self._said_at_s[cause] = now_s


@pytest.fixture(autouse=True)
def watched(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Watched]]:
    """Observers of all daemons of this test; it fails if one of them saw an invariant broken."""
    observers: list[Watched] = []

    async def opened(url: LinkUrl, on_datagram: Any, signing: SigningOptions | None) -> Link:
        daemon = on_datagram.__self__
        eyes = Watched(daemon)
        observers.append(eyes)

        def heard(data: bytes, address: Address) -> None:
            eyes.hears(data)
            on_datagram(data, address)

        link = await open_vehicle_link(url, heard, signing)
        send, emit = link.send, daemon._events.emit

        def observed(data: bytes, address: Address | None = None) -> bool:
            eyes.says(data)
            return send(data, address)

        def told(event: str, **facts: Any) -> None:
            eyes.tells(event, facts, daemon.engine._last_step_s or 0.0)
            emit(event, **facts)

        monkeypatch.setattr(link, "send", observed)
        monkeypatch.setattr(daemon._events, "emit", told)
        return link

    monkeypatch.setattr(service, "open_vehicle_link", opened)
    yield observers
    for eyes in observers:
        assert not eyes.failures, eyes.failures[0]
