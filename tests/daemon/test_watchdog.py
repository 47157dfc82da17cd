"""F26: a loop that stands still is seen by a thread, and a process that does not come back is ended."""

from __future__ import annotations

import subprocess
import sys
import threading

from ridlink.daemon.steady_utc import SteadyUtc
from ridlink.daemon.watchdog import Watchdog
from tests.loopback import PATIENCE_S

STUCK = """
import asyncio, threading
from ridlink.daemon.config import DaemonConfig
from ridlink.daemon.service import AvoidDaemon

async def main():
    daemon = AvoidDaemon(DaemonConfig(vehicle="udpin:127.0.0.1:0", remote_id="udpin:127.0.0.1:0"))
    asyncio.create_task(daemon.run(asyncio.Event()))
    await daemon.ready.wait()
    asyncio.get_running_loop().call_later(0.2, where_it_stands)
    await asyncio.Event().wait()

def where_it_stands():
    threading.Event().wait(60)

asyncio.run(main())
"""


def test_f26_a_stall_is_told_once_with_its_stack_and_life_is_forgiven() -> None:
    stalls: list[str] = []
    told, died = threading.Event(), threading.Event()

    def on_stall(stack: str) -> None:
        stalls.append(stack)
        told.set()

    watchdog = Watchdog(on_stall, lambda _: died.set())
    watchdog.start()
    assert told.wait(PATIENCE_S)
    watchdog.beat()
    assert died.wait(PATIENCE_S)
    watchdog.stop()
    assert len(stalls) in (1, 2) and "test_f26_a_stall" in stalls[0]


def test_f26_a_loop_that_never_comes_back_ends_the_process_with_70_and_says_where() -> None:
    done = subprocess.run([sys.executable, "-c", STUCK], capture_output=True, text=True, timeout=90.0)
    assert done.returncode == 70
    assert "stands still" in done.stderr and "where_it_stands" in done.stderr


def test_f17_a_step_of_the_clock_is_counted_and_nobodys_timestamp_believed_for_a_while() -> None:
    wall = [1000.0]
    utc = SteadyUtc(0.0, lambda: wall[0])
    assert utc.at(1.5) == 1001.5
    for tick in range(1, 50):  # slewed by an NTP daemon: followed
        wall[0] = 1000.0 + 0.1 * tick * 1.001
        utc.check(0.1 * tick)
    assert utc.steps == 0
    now_s = 5.0
    wall[0] = 1005.0 + 3600.0
    utc.check(now_s)
    assert utc.steps == 1 and utc.at(now_s) is None
    while now_s < 14.9:
        now_s += 0.1
        wall[0] += 0.1
        utc.check(now_s)
        assert utc.at(now_s) is None
    wall[0] += 0.3
    utc.check(now_s + 0.3)
    assert utc.at(now_s + 0.3) == wall[0]
