"""The transmitter alone, on real sockets, in this process; as a program it is in `tests/cli/test_broadcast.py`."""

from __future__ import annotations

import asyncio
import socket
from typing import Any

import pytest

from ridlink.daemon.transmitter import Transmitter, TransmitterConfig
from ridlink.links import open_link, parse_link_url
from ridlink.mavlink.codec import CRC_EXTRAS, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.own_ship.broadcast import BroadcastSettings, Form
from tests.daemon.emulated import PATIENCE_S, Emulated
from tests.loopback import run

BASIC_ID = 12900


def test_what_the_network_did_not_take_is_not_counted_as_sent() -> None:
    async def test() -> None:
        said: asyncio.Queue[dict[str, Any]] = asyncio.Queue()

        async def not_taken(least: int) -> dict[str, Any]:
            """The first summary that tells of so many datagrams that did not leave."""
            async with asyncio.timeout(PATIENCE_S):
                while True:
                    told = await said.get()
                    if told["rejects"].get("transmitter_link_no_peer", 0) >= least:
                        return told

        with socket.create_server(("127.0.0.1", 0)) as module:
            config = TransmitterConfig(
                vehicle=parse_link_url("udpin:127.0.0.1:0"),
                to=parse_link_url(f"tcpout:127.0.0.1:{module.getsockname()[1]}"),
                settings=BroadcastSettings(airframe_m=0.6, airframe_height_m=0.3),
            )
            transmitter, stop = Transmitter(config, on_event=said.put_nowait), asyncio.Event()
            task = asyncio.create_task(transmitter.run(stop))
            await asyncio.wait_for(transmitter.ready.wait(), PATIENCE_S)
            module.accept()[0].close()
        assert transmitter.vehicle_address is not None
        vehicle = await open_link(f"udpout:127.0.0.1:{transmitter.vehicle_address[1]}", lambda data, address: None)
        vehicle.send(Emulated().telemetry(0.0))
        before = await not_taken(1)
        after = await not_taken(before["rejects"]["transmitter_link_no_peer"] + 5)
        assert after["sent"] == before["sent"]
        vehicle.close()
        stop.set()
        assert (await asyncio.wait_for(task, PATIENCE_S))["sent"] == before["sent"]

    run(test)


def test_a_vehicle_goes_by_its_serial_number_and_the_next_one_not_by_that_of_the_last(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("ridlink.own_ship.telemetry.HEARTBEAT_LOST_S", 0.0)

    async def test() -> None:
        named: asyncio.Queue[tuple[int, bytes]] = asyncio.Queue()

        def hear(data: bytes, _: object) -> None:
            for frame in parse_datagram(data, CRC_EXTRAS):
                if isinstance(frame, Frame) and frame.msgid == BASIC_ID:
                    named.put_nowait((frame.sysid, bytes(decode_message(frame).uas_id).rstrip(b"\0")))

        air = await open_link(parse_link_url("udpin:127.0.0.1:0"), hear)
        config = TransmitterConfig(
            vehicle=parse_link_url("udpin:127.0.0.1:0"),
            to=parse_link_url(f"udpout:127.0.0.1:{air.local_address[1]}"),
            settings=BroadcastSettings(airframe_m=0.6, airframe_height_m=0.3, form=Form.MODULE),
        )
        transmitter, stop = Transmitter(config), asyncio.Event()
        task = asyncio.create_task(transmitter.run(stop))
        async with asyncio.timeout(PATIENCE_S):
            await transmitter.ready.wait()
            assert transmitter.vehicle_address is not None
            vehicle = await open_link(f"udpout:127.0.0.1:{transmitter.vehicle_address[1]}", lambda data, address: None)
            first, second = Emulated(1), Emulated(2)
            names = [(1, b"SERIAL"), (2, b"REGISTRATION"), (0, b"NOTHING")]
            told = b"".join(
                first.encoder.encode("OPEN_DRONE_ID_BASIC_ID", id_type=id_type, uas_id=name.ljust(20, b"\0"))
                for id_type, name in names
            )
            vehicle.send(first.heartbeat() + told)
            assert await named.get() == (1, b"SERIAL")
            vehicle.send(second.heartbeat())
            while (said := await named.get())[0] == 1:
                continue
            assert said == (2, b"")
            vehicle.close()
            stop.set()
            await task
        air.close()

    run(test)


def test_each_link_counts_its_own_messages() -> None:
    async def test() -> None:
        numbers: dict[str, list[int]] = {"vehicle": [], "air": []}
        enough = asyncio.Event()

        def hear(where: str, data: bytes) -> None:
            numbers[where] += [found.seq for found in parse_datagram(data, CRC_EXTRAS) if isinstance(found, Frame)]
            if min(map(len, numbers.values())) >= 7:  # two heartbeats, and what is asked for in between
                enough.set()

        air = await open_link("udpin:127.0.0.1:0", lambda data, _: hear("air", data))
        config = TransmitterConfig(
            vehicle=parse_link_url("udpin:127.0.0.1:0"),
            to=parse_link_url(f"udpout:127.0.0.1:{air.local_address[1]}"),
            settings=BroadcastSettings(airframe_m=0.6, airframe_height_m=0.3),
            vehicle_sysid=1,
        )
        transmitter, stop = Transmitter(config), asyncio.Event()
        task = asyncio.create_task(transmitter.run(stop))
        await asyncio.wait_for(transmitter.ready.wait(), PATIENCE_S)
        assert transmitter.vehicle_address is not None
        port = transmitter.vehicle_address[1]
        vehicle = await open_link(f"udpout:127.0.0.1:{port}", lambda data, _: hear("vehicle", data))
        vehicle.send(Emulated(autopilot=3).heartbeat())
        await asyncio.wait_for(enough.wait(), PATIENCE_S)
        stop.set()
        await asyncio.wait_for(task, PATIENCE_S)
        for link in (air, vehicle):
            link.close()
        for heard in numbers.values():
            assert heard == list(range(heard[0], heard[0] + len(heard)))

    run(test)


def test_whoever_watches_cannot_end_the_transmission() -> None:
    async def test() -> None:
        told: list[dict[str, Any]] = []

        def watch(event: dict[str, Any]) -> None:
            told.append(event)
            raise OSError("the screen has gone")

        heard: asyncio.Queue[bytes] = asyncio.Queue()
        air = await open_link(parse_link_url("udpin:127.0.0.1:0"), lambda data, address: heard.put_nowait(data))
        config = TransmitterConfig(
            vehicle=parse_link_url("udpin:127.0.0.1:0"),
            to=parse_link_url(f"udpout:127.0.0.1:{air.local_address[1]}"),
            settings=BroadcastSettings(airframe_m=0.6, airframe_height_m=0.3),
            vehicle_sysid=9,
        )
        transmitter, stop = Transmitter(config, on_event=watch), asyncio.Event()
        task = asyncio.create_task(transmitter.run(stop))
        for _ in range(2):
            await asyncio.wait_for(heard.get(), PATIENCE_S)
        stop.set()
        await asyncio.wait_for(task, PATIENCE_S)
        air.close()
        assert len(told) == transmitter.counters["event_sink_failed"] == 1

    run(test)
