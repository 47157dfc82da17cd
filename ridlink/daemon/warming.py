"""Loads or compiles the kernels before the first deadline, without delaying the loop.

Loading kernels from the disk takes a fraction of a second, in a thread. Compiling takes many seconds, most of them in
Python: a thread that compiles makes the loop of its process wait for the interpreter's lock several times per tick; on
a busy machine that came to 0.4 s. So another process compiles the kernels that are not on the disk yet, and saves them
there.
"""

from __future__ import annotations

import asyncio
import contextlib
import sys
import threading
from typing import Any

from ridlink.avoidance.solver import is_warm, warm_up
from ridlink.avoidance.types import SolverKind
from ridlink.compiled import can_be_kept

THREAD = "warm-up"
COMPILE = "import sys; from ridlink.avoidance.solver import warm_up; warm_up(sys.argv[1])"


def is_compiling() -> bool:
    """Whether the compiler runs. A process that ends then must skip the cleanup (`os._exit`), or it may crash."""
    return any(thread.name == THREAD for thread in threading.enumerate())


async def warm_up_unless(stop: asyncio.Event, solver: SolverKind) -> None:
    """Compile and load a solver's kernels before the first deadline; it may take seconds, but a signal ends it.

    If compiled kernels cannot be saved, or no process can be started, this process compiles them after all.
    """
    stopped = asyncio.ensure_future(stop.wait())
    try:
        if not is_warm(solver):
            compiling = asyncio.ensure_future(compile_apart(solver))
            try:
                await asyncio.wait({compiling, stopped}, return_when=asyncio.FIRST_COMPLETED)
            finally:
                compiling.cancel()
                await asyncio.wait({compiling})
        if not stopped.done():
            await _load_unless(stopped, solver)
    finally:
        stopped.cancel()


async def compile_apart(solver: SolverKind = SolverKind.HALFPLANE) -> None:
    """Compile a solver's kernels in another process, which saves them on disk; cancelling the wait ends it.

    Failures are not reported: the caller loads the kernels afterwards and then sees any error. Nothing is done if
    kernels cannot be saved.
    """
    if not can_be_kept():
        return
    try:
        compiler = await asyncio.create_subprocess_exec(
            sys.executable, "-P", "-c", COMPILE, str(solver),
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
    except OSError:
        return
    try:
        await compiler.wait()
    finally:
        if compiler.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                compiler.kill()
            await compiler.wait()


async def _load_unless(stopped: asyncio.Future[Any], solver: SolverKind) -> None:
    loop = asyncio.get_running_loop()
    done = loop.create_future()

    def report(error: BaseException | None) -> None:
        if not done.done():
            done.set_result(error)

    def load_all() -> None:
        problem: BaseException | None = None
        try:
            warm_up(solver)
        except Exception as error:
            problem = error
        with contextlib.suppress(RuntimeError):  # the loop has ended in the meantime
            loop.call_soon_threadsafe(report, problem)

    threading.Thread(target=load_all, name=THREAD, daemon=True).start()
    await asyncio.wait({done, stopped}, return_when=asyncio.FIRST_COMPLETED)
    if done.done() and done.result() is not None:
        raise done.result()
