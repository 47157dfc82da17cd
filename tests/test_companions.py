"""Tasks beside a block: whatever fails first ends both, and is seen."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

import pytest

from ridlink.companions import beside


class Fault(Exception):
    pass


def run(body: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(body, 20.0))


async def for_ever(ended: list[str], name: str = "companion") -> None:
    try:
        await asyncio.Event().wait()
    finally:
        ended.append(name)


async def fails() -> None:
    raise Fault("broken") from KeyError("why")


def test_companions_end_with_the_block_and_one_that_is_done_does_not_end_it() -> None:
    ended: list[str] = []

    async def body() -> None:
        async with beside(for_ever(ended), asyncio.sleep(0)):
            await asyncio.sleep(0.01)
            assert not ended
        assert ended == ["companion"]

    run(body())


def test_a_companion_that_fails_ends_the_block_and_the_others_and_is_raised_with_its_cause() -> None:
    ended: list[str] = []

    async def body() -> None:
        with pytest.raises(Fault, match="broken") as raised:
            async with beside(for_ever(ended), fails()):
                await for_ever(ended, "block")
        assert sorted(ended) == ["block", "companion"] and isinstance(raised.value.__cause__, KeyError)
        await asyncio.sleep(0)  # the one that ran it is not cancelled any more

    run(body())


def test_what_the_block_raises_is_raised_as_it_is() -> None:
    ended: list[str] = []

    async def body() -> None:
        with pytest.raises(Fault, match="of its own"):
            async with beside(for_ever(ended)):
                await asyncio.sleep(0)
                raise Fault("of its own")
        assert ended == ["companion"]

    run(body())


def test_what_the_block_makes_of_its_end_hides_no_failure() -> None:
    async def body() -> None:
        with pytest.raises(Fault, match="broken"):
            async with beside(fails()):
                try:
                    await asyncio.Event().wait()
                finally:
                    raise SystemError("in its clearing up")

    run(body())


def test_what_a_companion_makes_of_its_end_hides_no_failure() -> None:
    async def fails_as_it_ends() -> None:
        try:
            await asyncio.Event().wait()
        finally:
            raise SystemError("in its clearing up")

    async def body() -> None:
        with pytest.raises(Fault, match="of the block"):
            async with beside(fails_as_it_ends()):
                await asyncio.sleep(0)
                raise Fault("of the block")

    run(body())


def test_whoever_is_cancelled_from_outside_is_cancelled() -> None:
    ended: list[str] = []

    async def block() -> None:
        async with beside(for_ever(ended)):
            await asyncio.Event().wait()

    async def body() -> None:
        task = asyncio.create_task(block())
        await asyncio.sleep(0.01)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert ended == ["companion"]

    run(body())
