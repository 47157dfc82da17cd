"""Flying a campaign on many machines: the same shards, handed to the workers of a dask.distributed scheduler.

Shards are flown there and kept here: workers need ridlink in the same version, and no shared disk. A worker that goes
is replaced by the others.
"""

from __future__ import annotations

import logging
from collections.abc import Generator, Sequence
from importlib import import_module
from importlib.metadata import version
from typing import Any

from ridlink.campaign.flight import fly
from ridlink.campaign.plan import Plan
from ridlink.campaign.worlds import Outcomes
from ridlink.campaign_runner.pool import Task, WorkerLostError
from ridlink.errors import ConfigError, LinkError, MissingExtraError

CONNECT_S = 3.0
"""A scheduler that does not answer within this time is not there."""


class Cluster:
    """A scheduler with workers, connected and seen to fly as this machine does.

    Args:
        scheduler: Address, `tcp://HOST:PORT`.

    Raises:
        MissingExtraError: If distributed is not installed.
        LinkError: If the scheduler cannot be reached, or has no workers.
        ConfigError: If the address is none, or a worker has another version of ridlink.
    """

    def __init__(self, scheduler: str) -> None:
        self.scheduler = scheduler
        self._client = _connect(scheduler)
        try:
            _check_workers(self._client, scheduler)
        except BaseException:
            self.close()
            raise

    def fly_tasks(
        self, plans: Sequence[Plan], tasks: Sequence[Task]
    ) -> Generator[tuple[Task, Outcomes], None, None]:  # fmt: skip
        """Fly tasks, and give each as it is done.

        Args:
            plans: What the tasks number.
            tasks: What is flown.

        Raises:
            WorkerLostError: If workers went again and again, or the scheduler did.
        """
        distributed, client = _distributed(), self._client
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

    def close(self) -> None:
        """Leave the scheduler; what it has not flown is not flown."""
        self._client.close(timeout=1.0)


def _distributed() -> Any:
    try:
        return import_module("distributed")
    except ImportError as error:
        raise MissingExtraError("cluster", "--scheduler") from error


def _connect(scheduler: str) -> Any:
    distributed = _distributed()
    # What goes wrong is said once, by whoever called; dask would print a trace of every attempt.
    for name in ("distributed", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    _, scheme, address = scheduler.rpartition("tcp://")
    host, colon, port = address.rpartition(":")
    if not (scheme and scheduler.startswith(scheme) and host and colon and port.isdecimal()):
        raise ConfigError(f"scheduler {scheduler!r}: write it as tcp://HOST:PORT")
    try:
        return distributed.Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise LinkError(f"no dask scheduler answers at {scheduler}; 'dask scheduler' starts one") from error


def _check_workers(client: Any, scheduler: str) -> None:
    """Workers there are, and they fly as this machine would."""
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
