"""Flies a campaign in several processes with one thread each.

Shards are started in order and returned when done. The outcome of a run depends only on its plan and its number, so the
number of processes changes only the time.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass

from ridlink.campaign.flight import fly
from ridlink.campaign.plan import Plan
from ridlink.campaign.worlds import Outcomes
from ridlink.errors import RidlinkError

SHARD_RUNS = 64
"""Runs in a shard: some seconds of one process, so that little is lost."""


class WorkerLostError(RidlinkError):
    """A process that flew was lost: killed, or out of memory."""


@dataclass(frozen=True, slots=True)
class Task:
    """Work of one process at a time.

    Args:
        plan: Number of the plan.
        runs: Runs of it.
    """

    plan: int
    runs: range


def tasks_of(plans: Sequence[Plan], runs: int) -> list[Task]:
    """All shards of a campaign."""
    return [
        Task(k, range(first, min(first + SHARD_RUNS, runs)))
        for k in range(len(plans))
        for first in range(0, runs, SHARD_RUNS)
    ]


def fly_tasks(plans: Sequence[Plan], tasks: Sequence[Task], jobs: int) -> Generator[tuple[Task, Outcomes], None, None]:
    """Fly tasks, and yield each when it is done.

    Args:
        plans: Plans, to whose indices the tasks refer.
        tasks: Tasks to fly.
        jobs: Number of processes; with one job, this process flies.

    Raises:
        WorkerLostError: If a process was killed.
    """
    if jobs == 1 or len(tasks) < 2:
        for task in tasks:
            yield task, fly(plans[task.plan], task.runs)
        return
    with _quiet_cleaner():
        pool = ProcessPoolExecutor(
            min(jobs, len(tasks)), multiprocessing.get_context("spawn"), initializer=_begin, initargs=(tuple(plans),)
        )
    try:
        with _deaf_to_ctrl_c():
            flying: dict[Future[Outcomes], Task] = {pool.submit(_fly, task): task for task in tasks}
        while flying:
            for future in wait(flying, return_when=FIRST_COMPLETED).done:
                yield flying.pop(future), future.result()
    except BrokenProcessPool as error:
        raise WorkerLostError("a process that flew was killed, or ran out of memory") from error
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Block Ctrl-C for processes started meanwhile, until they ignore it themselves: see `_begin`."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _quiet_cleaner() -> Iterator[None]:
    """Silence the warning of Python's clean-up process, which runs if this process is ended by a signal."""
    before = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, (before, "ignore:resource_tracker")))
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONWARNINGS"]
        else:
            os.environ["PYTHONWARNINGS"] = before


_plans: tuple[Plan, ...] = ()
"""The plans of a worker, which receives them once."""


def _begin(plans: tuple[Plan, ...]) -> None:
    """Set up a worker: it leaves Ctrl-C to its parent, and ends with it."""
    global _plans
    _plans = plans
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _fly(task: Task) -> Outcomes:
    return fly(_plans[task.plan], task.runs)
