"""What tests on the loopback share: a loop, a turn of it, and ports."""

from __future__ import annotations

import asyncio
import socket
import types
from collections.abc import Awaitable, Callable, Iterator


def run(test: Callable[[], Awaitable[None]]) -> None:
    """A test in a loop of its own."""

    async def main() -> None:
        await test()

    asyncio.run(main())


@types.coroutine
def turn() -> Iterator[None]:
    """One turn of the loop."""
    yield


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    """A port that is free now, for programs that must be told a number; whoever can asks the kernel for any."""
    with socket.socket(type=kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
