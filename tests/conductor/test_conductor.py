"""What a conductor says when something does not come about."""

from __future__ import annotations

import asyncio

import pytest

pytest.importorskip("mavsdk")

from ridlink.conductor import vehicle
from ridlink.conductor.daemon_words import DaemonWords


def test_a_daemon_that_is_not_heard_is_named_with_what_may_be_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    conductor = object.__new__(vehicle.Conductor)  # without MAVSDK's server: nobody is heard
    conductor._system_id, conductor._listening, conductor._last_text = 1, [], ""
    conductor._daemon, conductor._is_lost, conductor._is_to_end = DaemonWords(), lambda: False, lambda: False
    conductor._heard_s = 0.0
    monkeypatch.setattr(vehicle, "DAEMON_HEARD_S", 0.0)
    with pytest.raises(vehicle.FlightError) as told:
        asyncio.run(conductor.find_daemon())
    assert str(told.value) == (
        "no daemon (component 196 of system 1) through the vehicle, whose link its own --vehicle must name, within 0 s"
    )
