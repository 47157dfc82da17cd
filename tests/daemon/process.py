"""``ridlink avoid`` as a process of its own."""

from __future__ import annotations

import asyncio
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from ridlink.avoidance.solver import warm_up
from ridlink.avoidance.types import SolverKind
from tests.loopback import free_port

START_S = 60.0
"""A busy machine."""


@asynccontextmanager
async def daemon(*arguments: str) -> AsyncIterator[tuple[Process, int]]:
    """The process, and the port on which it waits for its vehicle. It loads kernels, and compiles none."""
    warm_up(SolverKind.HALFPLANE)
    port = free_port()
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "ridlink", "avoid", "--vehicle", f"udpin:127.0.0.1:{port}",
        "--rid", f"udpout:127.0.0.1:{free_port()}", *arguments, stdout=PIPE, stderr=PIPE,
    )  # fmt: skip
    try:
        yield process, port
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()


async def line(stream: asyncio.StreamReader | None) -> str:
    """The next line of its output."""
    assert stream is not None
    async with asyncio.timeout(START_S):
        return (await stream.readline()).decode()
