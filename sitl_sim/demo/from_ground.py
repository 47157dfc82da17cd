"""Conductors for a whole fleet, in a separate process: ``python -m sitl_sim.demo.from_ground URL=HEIGHT ...``.

Each vehicle has the conductor of ``ridlink fly``, all on one MAVSDK. They arm and climb. When a line comes on stdin,
they hand over together, wait until their daemons have arrived, and land. Lines of JSON on stdout say when all are `up`
and `handed_over`, which have `landed`, and why one has `failed`.
"""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Awaitable, Sequence
from functools import partial
from typing import Any

from ridlink.cli import EXIT_DONE, EXIT_IO, EXIT_USAGE
from ridlink.conductor import (
    Conductor,
    FlightError,
    mavsdk_ground_station,
    open_connection,
)
from ridlink.errors import LinkError, MissingExtraError, RidlinkError
from ridlink.links import parse_link_url
from ridlink.words import counted

HEALTHY_S = 60.0
DISCOVERY_S = 30.0
LOOK_S = 0.1


def _say(event: str, **facts: Any) -> None:
    sys.stdout.write(json.dumps({"event": event, **facts}) + "\n")
    sys.stdout.flush()


def _progress(system_id: int, text: str) -> None:
    _say("progress", vehicle=system_id, text=text)


async def _fleet(urls: Sequence[str], heights_m: Sequence[float]) -> None:
    ready = asyncio.StreamReader()  # no thread: a thread that waits for a line would delay the end and its error
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(ready), sys.stdin)
    async with mavsdk_ground_station() as mavsdk:
        for url in urls:
            await open_connection(mavsdk, parse_link_url(url))
        systems = await _systems(mavsdk, len(urls))
        conductors = {
            system_id: Conductor(system, partial(_progress, system_id)) for system_id, system in systems.items()
        }
        heights = dict(zip(sorted(conductors), heights_m, strict=True))
        try:
            await _together({each: _up(conductors[each], heights[each]) for each in conductors})
            _say("up")
            if not await ready.readline():
                return
            await _together({each: _over(conductor) for each, conductor in conductors.items()})
            _say("handed_over")
            await _together({each: _down(each, conductor) for each, conductor in conductors.items()})
        finally:
            for conductor in conductors.values():
                await conductor.close()


async def _systems(mavsdk: Any, count: int) -> dict[int, Any]:
    """Wait for all vehicles; returns them by system id.

    Raises:
        LinkError: If not all are heard.
    """
    found: dict[int, Any] = {}
    for _ in range(round(DISCOVERY_S / LOOK_S)):
        systems = [system for system in await mavsdk.get_systems() if await system.has_autopilot()]
        found = {await system.get_system_id(): system for system in systems}
        if len(found) == count:
            return found
        await asyncio.sleep(LOOK_S)
    raise LinkError(f"MAVSDK hears {len(found)} of {counted(count, 'vehicle')}")


async def _together(work: dict[int, Awaitable[None]]) -> None:
    """Run work for all vehicles; failures are reported, and the first one is raised when the others are done.

    Raises:
        FlightError: If one of them failed.
    """
    results = await asyncio.gather(*work.values(), return_exceptions=True)
    failures = [(each, result) for each, result in zip(work, results, strict=True) if result is not None]
    for each, result in failures:
        if not isinstance(result, RidlinkError):
            raise result
        _say("failed", vehicle=each, reason=str(result))
    if failures:
        raise FlightError("a vehicle did not come down as it should")


async def _up(conductor: Conductor, height_m: float) -> None:
    await conductor.open()
    await conductor.wait_healthy(HEALTHY_S)
    await conductor.take_off(height_m)


async def _over(conductor: Conductor) -> None:
    await conductor.find_daemon()
    await conductor.hand_over()


async def _down(system_id: int, conductor: Conductor) -> None:
    end = await conductor.follow(asyncio.Event())
    if not end.is_good:
        raise FlightError(end)
    await conductor.land()
    _say("landed", vehicle=system_id)


def main(vehicles: list[str]) -> int:
    """Run the conductors for vehicles given as links with heights."""
    urls, heights = zip(*(each.rsplit("=", 1) for each in vehicles), strict=True)
    try:
        asyncio.run(_fleet(urls, [float(height) for height in heights]))
    except FlightError:
        return EXIT_DONE
    except LinkError as error:
        print(f"ridlink: {error}", file=sys.stderr)
        return EXIT_IO
    except MissingExtraError as error:
        print(f"ridlink: {error}", file=sys.stderr)
        return EXIT_USAGE
    return EXIT_DONE


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
