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
    ends has done its work.

    Args:
        companions: What runs beside the block.
    """
    failed: BaseExceptionGroup[BaseException] | None = None
    try:
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(each) for each in companions]
            yield
            for task in tasks:
                task.cancel()
    except BaseExceptionGroup as failures:
        failed = failures
    if failed is not None:
        raise failed.exceptions[0]  # nothing comes before what failed first; outside, so that it keeps its own context
