"""Starts MAVSDK as a ground station and opens its links."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from ridlink.errors import LinkError, MissingExtraError
from ridlink.links import LinkUrl, open_link

try:
    from mavsdk import log_subscribe
    from mavsdk.asyncio import ComponentType, Configuration, Mavsdk, MavsdkConnectionError
except ImportError as error:
    raise MissingExtraError("mavsdk", "the conductor") from error

DISCOVERY_S = 10.0


@asynccontextmanager
async def mavsdk_ground_station() -> AsyncIterator[Mavsdk]:
    """MAVSDK as a ground station whose log does not go to standard output, which is for results."""
    log_subscribe(lambda *_: True)
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        try:
            yield mavsdk
        finally:
            # MAVSDK aborts the process if one of its objects still exists when it ends, and an idle worker thread of
            # the loop keeps the object of its last call.
            await asyncio.get_running_loop().shutdown_default_executor()


def mavsdk_url(link: LinkUrl) -> str:
    """A link as a connection string of MAVSDK."""
    host = f"[{link.host}]" if ":" in link.host else link.host
    return f"{link.scheme}://{host}:{link.port}"


async def connect(mavsdk: Mavsdk, link: LinkUrl, timeout_s: float = DISCOVERY_S) -> Any:
    """The first autopilot on a link, a system of MAVSDK.

    Raises:
        LinkError: If the link cannot be opened, or no autopilot is heard.
    """
    await open_connection(mavsdk, link)
    system = await mavsdk.first_autopilot(timeout_s=timeout_s)
    if system is None:
        what = f"no autopilot is heard on {link} within {timeout_s:g} s"
        raise LinkError(f"{what}: {link.where_to_look} --vehicle names another link")
    return system


async def open_connection(mavsdk: Mavsdk, link: LinkUrl) -> None:
    """Open one more link.

    Raises:
        LinkError: If it cannot be opened.
    """
    try:
        await mavsdk.add_any_connection(mavsdk_url(link))
    except MavsdkConnectionError as error:
        (await open_link(link, lambda *_: None)).close()  # says why not, and what to do
        raise LinkError(f"{link} cannot be opened: {error}") from error
