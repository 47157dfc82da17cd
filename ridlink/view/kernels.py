"""Loads the kernels of the solver, which velocity spaces need, while the page is already served."""

from __future__ import annotations

import asyncio

from ridlink.avoidance.solver import is_warm, warm_up
from ridlink.daemon.warming import compile_apart
from ridlink.view.show import Show


async def load_kernels(show: Show) -> None:
    """Load the kernels, then let a show compute velocity spaces.

    The first time after an installation, another process compiles the kernels for up to half a minute: the compiler
    would keep this one from serving.
    """
    if not is_warm():
        await compile_apart()
    await asyncio.to_thread(warm_up)
    show.look_at_vehicles()
