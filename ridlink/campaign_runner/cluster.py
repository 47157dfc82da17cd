"""Flies a campaign on many machines: the same shards, flown by the workers of a dask.distributed scheduler.

Workers fly the shards, and this machine saves them. Workers need the same version of ridlink, but no shared disk. If a
worker is lost, others fly its shards.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import version
from typing import Any

from ridlink.campaign.flight import fly
from ridlink.campaign.plan import Plan
from ridlink.campaign.worlds import Outcomes
from ridlink.campaign_runner.pool import Task, WorkerLostError
from ridlink.errors import ConfigError, LinkError, MissingExtraError

CONNECT_S = 3.0
"""A scheduler that does not answer within this time counts as unreachable."""

PATIENCE_S = 3.0
"""After this waiting time, the user is told what is missing."""


class Cluster:
    """A connected scheduler with workers that are checked to fly as this machine does.

    Args:
        scheduler: Address, `tcp://HOST:PORT`.
        say: Called, from another thread, with what is missing if waiting takes long.

    Raises:
        MissingExtraError: If distributed is not installed.
        LinkError: If the scheduler cannot be reached, or has no workers.
        ConfigError: If the address is invalid, or a worker has another version of ridlink.
    """

    def __init__(self, scheduler: str, say: Callable[[str], None]) -> None:
        self.scheduler = scheduler
        self._say = say
        self._client = _connect(scheduler)
        try:
            with self._said_if_slow(f"waiting for the workers of {scheduler} to say which version they have"):
                _check_workers(self._client, scheduler)
        except BaseException:
            self.close()
            raise

    def fly_tasks(
        self, plans: Sequence[Plan], tasks: Sequence[Task]
    ) -> Generator[tuple[Task, Outcomes], None, None]:  # fmt: skip
        """Fly tasks, and yield each when it is done. If all workers are lost, wait for others.

        Args:
            plans: Plans, to whose indices the tasks refer.
            tasks: Tasks to fly.

        Raises:
            WorkerLostError: If workers are lost repeatedly, or the scheduler is lost.
        """
        distributed, client = _distributed(), self._client
        over = threading.Event()
        threading.Thread(target=self._watch, args=(over,), daemon=True).start()
        try:
            flying = {client.submit(fly, plans[task.plan], task.runs, pure=False): task for task in tasks}
            for future in distributed.as_completed(list(flying), loop=client.loop):
                outcomes = future.result()
                task = flying.pop(future)
                future.release()
                yield task, outcomes
        except distributed.KilledWorker as error:
            raise WorkerLostError("workers that flew were killed again and again, or ran out of memory") from error
        except (OSError, distributed.CancelledError) as error:
            raise WorkerLostError(f"the scheduler {self.scheduler} has gone") from error
        finally:
            over.set()

    def close(self) -> None:
        """Disconnect from the scheduler; unfinished tasks are dropped."""
        self._client.close(timeout=1.0)

    @contextmanager
    def _said_if_slow(self, text: str) -> Iterator[None]:
        timer = threading.Timer(PATIENCE_S, self._say, (text,))
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()

    def _watch(self, over: threading.Event) -> None:
        """Reports once each time that there are no workers."""
        said = ""
        while not over.wait(PATIENCE_S):
            lacking = self._lacking()
            if lacking not in ("", said) and not over.is_set():
                self._say(lacking)
            said = lacking

    def _lacking(self) -> str:
        """What is missing; empty if there are workers."""
        client = self._client
        try:
            if client.sync(client.scheduler.identity, callback_timeout=PATIENCE_S)["workers"]:
                return ""
        except (OSError, TimeoutError, RuntimeError, CancelledError):
            return f"the scheduler {self.scheduler} does not answer; waiting for it"
        return (
            f"the scheduler {self.scheduler} has no workers; waiting for one: 'dask worker {self.scheduler}' starts it"
        )


def _distributed() -> Any:
    try:
        return import_module("distributed")
    except ImportError as error:
        raise MissingExtraError("cluster", "--scheduler") from error


def _connect(scheduler: str) -> Any:
    distributed = _distributed()
    # The caller reports an error once; dask would print a trace of every attempt. Two of its loggers have their own
    # level.
    for name in ("distributed", "distributed.client", "distributed.gc", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    _, scheme, address = scheduler.rpartition("tcp://")
    host, colon, port = address.rpartition(":")
    if not (scheme and scheduler.startswith(scheme) and host and colon and port.isdecimal()):
        raise ConfigError(f"scheduler {scheduler!r}: write it as tcp://HOST:PORT")

    async def knock() -> None:
        # If a port accepts connections but sends nothing, a dask client waits forever.
        async with asyncio.timeout(2.0 * CONNECT_S):
            comm = await distributed.comm.connect(scheduler, timeout=CONNECT_S)
            await comm.close()

    try:
        asyncio.run(knock())
        return distributed.Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise LinkError(f"no dask scheduler answers at {scheduler}; 'dask scheduler' starts one") from error


def _check_workers(client: Any, scheduler: str) -> None:
    """Check that there are workers, and that they fly as this machine would."""
    if not client.scheduler_info()["workers"]:
        raise LinkError(f"the scheduler {scheduler} has no workers; 'dask worker {scheduler}' starts one")
    ours = version("ridlink")
    try:
        found = client.run(version, "ridlink")
    except ImportError as error:
        raise ConfigError("a worker has no ridlink; install the same version on all of them") from error
    for worker, theirs in found.items():
        if theirs != ours:
            raise ConfigError(f"the worker {worker} has ridlink {theirs}, and here is {ours}: rows would differ")
