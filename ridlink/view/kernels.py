"""The kernels of the solver, which velocity spaces need, loaded while the page is served already."""

from __future__ import annotations

import asyncio
import sys

from ridlink.avoidance.halfplane import avoid_one
from ridlink.avoidance.solver import warm_up
from ridlink.compiled import is_compiled
from ridlink.view.show import Show

COMPILE = "from ridlink.avoidance.solver import warm_up; warm_up()"


async def load_kernels(show: Show) -> None:
    """Let a show look at vehicles as soon as it can.

    The first time of an installation the kernels are compiled, for up to half a minute, and by another process: the
    compiler would keep this one from serving.
    """
    if not is_compiled(avoid_one):
        compiler = await asyncio.create_subprocess_exec(
            sys.executable, "-c", COMPILE,
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
        try:
            await compiler.wait()
        finally:
            if compiler.returncode is None:
                compiler.kill()
                await compiler.wait()
    await asyncio.to_thread(warm_up)
    show.look_at_vehicles()
