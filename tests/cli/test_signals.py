"""What signals do to a program that writes, and what a second one does."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys

import pytest

from tests.cli.full_pipe import LEAST_BYTES, bytes_in, full_pipe

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


WRITES = """
import sys
from ridlink.cli.campaign_show import say
from ridlink.cli.signals import removed_by_signals

def remove():
    say("7 shards kept")
    raise OSError("nothing to remove")

with removed_by_signals(remove):
    while True:
        sys.stderr.write("flying" + 100_000 * "." + "\\n")
"""


def test_a_signal_that_comes_while_a_line_is_written_says_what_it_left_and_ends_with_its_code() -> None:
    """Its words went into the buffer that was being written: a reentrant call, and exit code 70."""
    with full_pipe() as writing:
        environment = os.environ | {"PYTHONUNBUFFERED": ""}
        with subprocess.Popen([sys.executable, "-c", WRITES], stderr=writing, env=environment) as process:
            text = os.read(writing.reading, LEAST_BYTES)
            while bytes_in(writing.reading) < LEAST_BYTES:  # then it waits in the middle of a line
                assert process.poll() is None
            process.send_signal(signal.SIGINT)
            while process.poll() is None or bytes_in(writing.reading):
                if select.select([writing.reading], [], [], 0.1)[0]:
                    text += os.read(writing.reading, LEAST_BYTES)
        assert process.returncode == 128 + signal.SIGINT
        assert text.endswith(b"campaign: 7 shards kept\n")
