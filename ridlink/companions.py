"""Tasks that run beside something else, and do not fail unseen."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Coroutine
from typing import Any


@contextlib.asynccontextmanager
async def beside(*companions: Coroutine[Any, Any, Any]) -> AsyncIterator[None]:
    """Run these while the block does; they are cancelled at its end.

    One that fails ends the block, by cancelling it, and what it raised is raised in the block's place. One that just
    ends has done its work. Of several failures the first is raised.

    Args:
        companions: What runs beside the block.
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
                    of_block = error  # the group puts it last, after what companions make of their end
                raise
            for task in tasks:
                task.cancel()
    except BaseExceptionGroup as failures:
        failed = failures
    if failed is not None:
        raise of_block or failed.exceptions[0]  # what failed first; outside, so that it keeps its own context


def _has_failed(task: asyncio.Task[Any]) -> bool:
    return task.done() and not task.cancelled() and task.exception() is not None
