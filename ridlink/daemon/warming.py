"""Compiled kernels before the first deadline."""

from __future__ import annotations

import asyncio
import contextlib
import threading

from ridlink.avoidance.solver import warm_up
from ridlink.avoidance.types import SolverKind

THREAD = "warm-up"


def is_compiling() -> bool:
    """The compiler is at work: who ends now must not tear down what it stands on (`os._exit`), or it may crash."""
    return any(thread.name == THREAD for thread in threading.enumerate())


async def warm_up_unless(stop: asyncio.Event, solver: SolverKind) -> None:
    """Compile a solver's kernels before the first deadline; cold that takes seconds, and a signal must not wait."""
    loop = asyncio.get_running_loop()
    done = loop.create_future()

    def report(error: BaseException | None) -> None:
        if not done.done():
            done.set_result(error)

    def compile_all() -> None:
        problem: BaseException | None = None
        try:
            warm_up(solver)
        except Exception as error:
            problem = error
        with contextlib.suppress(RuntimeError):  # the loop has ended meanwhile
            loop.call_soon_threadsafe(report, problem)

    threading.Thread(target=compile_all, name=THREAD, daemon=True).start()
    stopped = asyncio.ensure_future(stop.wait())
    await asyncio.wait({done, stopped}, return_when=asyncio.FIRST_COMPLETED)
    stopped.cancel()
    if done.done() and done.result() is not None:
        raise done.result()
