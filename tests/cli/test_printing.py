"""The printer between a program and a real pipe."""

from __future__ import annotations

import os
import select
import subprocess
import sys

import pytest

from tests.cli.full_pipe import full_pipe

PROGRAM = """
import sys
from ridlink.cli.printing import Printer
printer = Printer()
for number in range(int(sys.argv[1])):
    printer.put(f"{number:{sys.argv[2]}}\\n")
printer.close()
"""


@pytest.fixture(autouse=True, params=["", "1"], ids=["buffered", "unbuffered"])
def _whatever_python_buffers(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a buffer Python aborted, or did not end, where nobody read; without one pieces of lines were lost."""
    monkeypatch.setenv("PYTHONUNBUFFERED", request.param)


def test_what_nobody_reads_is_bounded_counted_and_said_at_the_end() -> None:
    with full_pipe() as writing:
        command = [sys.executable, "-c", PROGRAM, "3000", "1"]
        done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, timeout=30)
    assert (done.returncode, done.stderr) == (0, "ridlink: left out 3000 lines that nobody read\n")


def test_long_lines_are_bounded_by_what_they_hold() -> None:
    queued = PROGRAM.replace("printer.close()", "sys.stderr.write('queued\\n')\nsys.stderr.flush()\nprinter.close()")
    with full_pipe() as writing:
        command = [sys.executable, "-c", queued, "500", "49999"]
        with subprocess.Popen(command, stdout=writing, stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr is not None and process.stderr.readline() == "queued\n"
            text = b""
            while process.poll() is None or select.select([writing.reading], [], [], 0.0)[0]:
                if select.select([writing.reading], [], [], 0.1)[0]:
                    text += os.read(writing.reading, 65536)
            assert process.stderr.read() == "ridlink: left out 420 lines that nobody read\n"
    assert [int(line) for line in text.strip(b"\0").split()] == list(range(80))


def test_whoever_reads_late_misses_no_line() -> None:
    with full_pipe() as writing:
        command = [sys.executable, "-c", PROGRAM, "900", "1"]
        with subprocess.Popen(command, stdout=writing, stderr=subprocess.PIPE, text=True) as process:
            text = b""
            while not text.endswith(b"\n899\n"):
                text += os.read(writing.reading, 64)
            assert process.communicate(timeout=30)[1] == ""
    assert [int(line) for line in text.strip(b"\0").split()] == list(range(900))


def test_without_anybody_who_reads_errors_either_it_ends_all_the_same() -> None:
    with full_pipe() as writing:
        done = subprocess.run([sys.executable, "-c", PROGRAM, "3", "1"], stdout=writing, stderr=writing, timeout=30)
    assert done.returncode == 0


def test_what_the_terminal_has_no_letters_for_is_escaped_and_the_rest_goes_on() -> None:
    program = PROGRAM.replace("for number", "printer.put('Z\\xfcrich\\n')\nfor number")
    command = [sys.executable, "-c", program, "1", "1"]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=30)
    assert (done.returncode, done.stdout, done.stderr) == (0, "Z\\xfcrich\n0\n", "")


def test_a_full_disk_is_told_and_not_taken_for_a_reader_that_has_gone() -> None:
    asked = PROGRAM.replace("printer.close()", "printer.close()\nsys.exit(printer.reader_has_gone)")
    with open("/dev/full", "wb") as full:
        done = subprocess.run([sys.executable, "-c", asked, "3", "1"], stdout=full, stderr=subprocess.PIPE, timeout=30)
    said = b"ridlink: standard output: No space left on device; the lines from there on are lost\n"
    assert (done.returncode, done.stderr) == (0, said)


def test_who_pages_through_results_is_waited_for() -> None:
    """Without any patience the end would come with the first text that is not taken at once."""
    patient = "import ridlink.cli.printing\nridlink.cli.printing.PATIENCE_S = 0.0\n"
    patient += PROGRAM.replace("printer.close()", "printer.patience_s = 600.0\nprinter.close()")
    with full_pipe() as writing:
        command = [sys.executable, "-c", patient, "900", "1"]
        with subprocess.Popen(command, stdout=writing, stderr=subprocess.PIPE) as process:
            assert process.stderr is not None
            assert not select.select([process.stderr], [], [], 2.0)[0], "it ended"
            text = b""
            while not text.endswith(b"\n899\n"):
                text += os.read(writing.reading, 64)
            assert process.communicate(timeout=30)[1] == b""
