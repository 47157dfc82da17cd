"""What a second signal does."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

PROGRAM = """
import asyncio, os, signal, sys, time
from ridlink.cli import signals

async def main(how, second, pause_s, still_s):
    loop, stopped = asyncio.get_running_loop(), asyncio.Event()
    if how == "ended":
        signals.ended_by_signals(loop, stopped.set)
    else:
        stopped = signals.stopped_by_signals(loop)
    os.kill(os.getpid(), signal.SIGTERM)
    await stopped.wait()
    if pause_s:  # one turn more of the loop would be a chance more for a busy machine to take 20 ms
        await asyncio.sleep(pause_s)
    os.kill(os.getpid(), second)
    time.sleep(still_s)
    await asyncio.sleep(0.2)
    print("ended in its own time")

asyncio.run(main(sys.argv[1], signal.Signals(int(sys.argv[2])), *map(float, sys.argv[3:])))
"""


@pytest.mark.parametrize("how", ["ended", "stopped"])
@pytest.mark.parametrize(
    ("second", "pause_s", "still_s", "forced"),
    [
        (signal.SIGTERM, 0.0, 0.0, False),  # `timeout` sends its signal to the process, and then to its group
        (signal.SIGTERM, 0.0, 0.1, False),  # what ends holds the loop: the second one is seen late
        (signal.SIGTERM, 0.1, 0.0, True),
        (signal.SIGINT, 0.0, 0.0, True),
        (signal.SIGHUP, 0.1, 0.0, False),
    ],
)
def test_i8_a_second_signal_forces_the_end_but_not_the_same_one_at_once(how, second, pause_s, still_s, forced):
    command = [sys.executable, "-c", PROGRAM, how, str(int(second)), str(pause_s), str(still_s)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    if forced:
        assert done.returncode in (128 + second, -second)  # ended at once by itself, or by the default action
        assert done.stdout == ""
    else:
        assert (done.returncode, done.stdout, done.stderr) == (0, "ended in its own time\n", "")
