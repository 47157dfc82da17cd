"""What tests on the loopback share: a loop, a turn of it, patience, and ports."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
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


BELOW_THE_KERNELS = range(20_000, 32_000)
"""Linux gives to whoever asks for any port those from 32768 on: a test beside this one is given none of these."""


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    """A port that is free until it is opened, for programs that must be told a number; whoever can asks the kernel."""
    while True:
        port = secrets.choice(BELOW_THE_KERNELS)
        with socket.socket(type=kind) as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port
