"""What tests on the loopback share: a loop, a turn of it, patience, and ports."""

from __future__ import annotations

import asyncio
import os
import socket
import types
from collections.abc import Awaitable, Callable, Iterator

from tests.conftest import QUICK

PATIENCE_S = 8.0 if QUICK in os.environ else 60.0
"""So long is waited for what comes at once on an idle machine. Where only failures are looked for, most of which are
something that never comes, less."""


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
