"""The conductors of a fleet that starts on the ground, as seen by the demonstration: their process and its output."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import Callable, Sequence

from ridlink.errors import LinkError
from sitl_sim.demo.apart import end_with_parent

UP_S, HANDED_OVER_S = 180.0, 120.0
LANDED_S = 120.0
"""From 50 m, with a flare below 10 m, a landing takes 45 s."""


class Conductors:
    """A conductor for every cooperative vehicle, all in one process with one MAVSDK.

    Args:
        urls: Link to each vehicle, in order of system ids.
        heights_m: Take-off heights above home.
        say: Called with a line for every vehicle that failed at something.

    Attributes:
        landed: System ids of vehicles that have landed and disarmed.
    """

    def __init__(self, urls: Sequence[str], heights_m: Sequence[float], say: Callable[[str], None]) -> None:
        self._arguments = [f"{url}={height:g}" for url, height in zip(urls, heights_m, strict=True)]
        self._say = say
        self.landed: set[int] = set()
        self._failures: list[str] = []
        self._reached: set[str] = set()
        self._changed = asyncio.Event()
        self._process: asyncio.subprocess.Process | None = None
        self._reader: asyncio.Task[None] | None = None

    async def take_off(self) -> None:
        """Arm all vehicles, and wait until all are at their heights.

        Raises:
            LinkError: If one does not get there; the text says why.
        """
        self._process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "sitl_sim.demo.from_ground", *self._arguments,
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, preexec_fn=end_with_parent,
        )  # fmt: skip
        self._reader = asyncio.create_task(self._read())
        self._reader.add_done_callback(lambda _: self._changed.set())
        await self._until("up", UP_S)

    async def hand_over(self) -> None:
        """Hand all vehicles over to their daemons.

        Raises:
            LinkError: If one is not handed over.
        """
        assert self._process is not None and self._process.stdin is not None
        self._process.stdin.write(b"hand over\n")
        await self._until("handed_over", HANDED_OVER_S)

    async def wait_landed(self) -> None:
        """Wait until all have landed or failed, or too much time has passed."""
        if self._reader is not None:
            done, _ = await asyncio.wait([self._reader], timeout=LANDED_S)
            for reader in done:
                reader.result()

    async def close(self) -> None:
        """End the process."""
        if self._process is not None and self._process.returncode is None:
            self._process.kill()
        if self._reader is not None:
            await asyncio.gather(self._reader, return_exceptions=True)

    async def _until(self, what: str, timeout_s: float) -> None:
        deadline = asyncio.get_running_loop().time() + timeout_s
        while what not in self._reached:
            left_s = deadline - asyncio.get_running_loop().time()
            ended = self._reader is None or self._reader.done()
            if ended and self._reader is not None:
                self._reader.result()
            if self._failures or ended or left_s <= 0.0:
                words = "; ".join(self._failures) or f"not all vehicles are {what.replace('_', ' ')}"
                raise LinkError(f"the flight from the ground failed: {words}")
            self._changed.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(left_s):
                    await self._changed.wait()

    async def _read(self) -> None:
        assert self._process is not None and self._process.stdout is not None
        async for line in self._process.stdout:
            facts = json.loads(line)
            match facts["event"]:
                case "landed":
                    self.landed.add(facts["vehicle"])
                case "failed":
                    self._failures.append(f"vehicle {facts['vehicle']}: {facts['reason']}")
                    self._say(self._failures[-1])
                case "progress":
                    continue
                case reached:
                    self._reached.add(reached)
            self._changed.set()
        await self._process.wait()
