"""The ground station of a demonstration."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack

from ridlink.links import Address, open_link
from ridlink.mavlink.codec import Encoder
from sitl_sim.demo.ground_station import GroundStation

PX4, OFFBOARD = 12, 6 << 16


def test_a_stop_in_the_moment_of_an_answer_ends_the_handover() -> None:
    in_offboard = Encoder(1, 1).encode("HEARTBEAT", type=2, autopilot=PX4, custom_mode=OFFBOARD, mavlink_version=3)

    async def hand_over() -> bool:
        """To one vehicle that obeys and one that says nothing; whether the stop ended it."""

        def obey(_: bytes, station: Address) -> None:
            links[0].send(in_offboard, station)

        def stop(_: bytes) -> None:
            asyncio.get_running_loop().call_soon(handing_over.cancel)

        async with AsyncExitStack() as ends:
            links = [await open_link("udpin:127.0.0.1:0", hear) for hear in (obey, _ignore, _ignore)]
            for link in links:
                ends.callback(link.close)
            vehicles, air = [link.local_address[1] for link in links[:2]], links[2].local_address[1]
            station = GroundStation(vehicles, air, stop, lambda _: None)
            ends.push_async_callback(station.close)
            await station.open()
            handing_over = asyncio.create_task(station.hand_over([1, 2], 60.0))
            await asyncio.wait([handing_over], timeout=5.0)
            return handing_over.cancelled()

    assert asyncio.run(hand_over())


def _ignore(_: bytes, address: Address) -> None:
    pass
