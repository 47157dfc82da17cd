"""The printer between a program and a real pipe."""

from __future__ import annotations

import os
import subprocess
import sys

from tests.cli.full_pipe import full_pipe

PROGRAM = """
import sys
from ridlink.cli.printing import Printer
printer = Printer()
for number in range(int(sys.argv[1])):
    printer.put(f"{number}\\n")
printer.close()
"""


def test_what_nobody_reads_is_bounded_counted_and_said_at_the_end() -> None:
    with full_pipe() as writing:
        command = [sys.executable, "-c", PROGRAM, "3000"]
        done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, timeout=30)
    assert (done.returncode, done.stderr) == (0, "ridlink: left out 3000 lines that nobody read\n")


def test_whoever_reads_late_misses_no_line() -> None:
    with full_pipe() as writing:
        command = [sys.executable, "-c", PROGRAM, "900"]
        with subprocess.Popen(command, stdout=writing, stderr=subprocess.PIPE, text=True) as process:
            text = b""
            while not text.endswith(b"\n899\n"):
                text += os.read(writing.reading, 64)
            assert process.communicate(timeout=30)[1] == ""
    assert [int(line) for line in text.strip(b"\0").split()] == list(range(900))


def test_without_anybody_who_reads_errors_either_it_ends_all_the_same() -> None:
    with full_pipe() as writing:
        done = subprocess.run([sys.executable, "-c", PROGRAM, "3"], stdout=writing, stderr=writing, timeout=30)
    assert done.returncode == 0
