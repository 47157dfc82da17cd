"""What a conductor says when something does not come about."""

from __future__ import annotations

import asyncio
import socket

import pytest

pytest.importorskip("mavsdk")

from ridlink.conductor import vehicle
from ridlink.conductor.daemon_words import DaemonWords
from ridlink.conductor.station import connect, mavsdk_ground_station
from ridlink.errors import LinkError
from ridlink.links import parse_link_url


async def refused(url: str) -> str:
    """Why no autopilot is found on a link."""
    async with mavsdk_ground_station() as mavsdk:
        with pytest.raises(LinkError) as told:
            await connect(mavsdk, parse_link_url(url), timeout_s=0.1)
    return str(told.value)


def test_a_link_that_cannot_be_opened_is_told_as_of_every_command() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        said = asyncio.run(refused(f"udpin:127.0.0.1:{port}"))
    assert f"port {port} is in use by another program; stop it" in said and "choose another port" in said
    assert "there is no such device" in asyncio.run(refused("serial:/dev/absent:57600"))


def test_where_nobody_is_heard_it_is_told_what_to_look_at() -> None:
    said = asyncio.run(refused("udpout:127.0.0.1:9"))
    assert said.endswith("within 0.1 s: does anything answer there? --vehicle names another link")


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
