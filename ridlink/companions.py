"""Tasks that run beside a block of code; a failure of one ends the block."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Coroutine
from typing import Any


@contextlib.asynccontextmanager
async def beside(*companions: Coroutine[Any, Any, Any]) -> AsyncIterator[None]:
    """Run coroutines while the block runs; they are cancelled at its end.

    If one fails, the block is cancelled, and the error is raised in its place. If one simply returns, the block goes
    on. Of several failures the first is raised.

    Args:
        companions: Coroutines to run beside the block.
    """
    of_block: Exception | None = None
    failed: BaseExceptionGroup[BaseException] | None = None
    try:
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(each) for each in companions]
            try:
                yield
            except Exception as error:
                if not any(map(_has_failed, tasks)):
                    of_block = error  # the group lists it last, after what companions raise when cancelled
                raise
            for task in tasks:
                task.cancel()
    except BaseExceptionGroup as failures:
        failed = failures
    if failed is not None:
        raise of_block or failed.exceptions[0]  # the first failure; raised outside, so that it keeps its own context


def _has_failed(task: asyncio.Task[Any]) -> bool:
    return task.done() and not task.cancelled() and task.exception() is not None
