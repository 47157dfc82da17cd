"""The kernels of the solver, which velocity spaces need, loaded while the page is served already."""

from __future__ import annotations

import asyncio

from ridlink.avoidance.solver import is_warm, warm_up
from ridlink.daemon.warming import compile_apart
from ridlink.view.show import Show


async def load_kernels(show: Show) -> None:
    """Let a show look at vehicles as soon as it can.

    The first time of an installation the kernels are compiled, for up to half a minute, and by another process: the
    compiler would keep this one from serving.
    """
    if not is_warm():
        await compile_apart()
    await asyncio.to_thread(warm_up)
    show.look_at_vehicles()
