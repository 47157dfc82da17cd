"""A pipe that nobody reads, as a program's standard output."""

from __future__ import annotations

import fcntl
import os
import struct
import termios
from collections.abc import Iterator
from contextlib import contextmanager

LEAST_BYTES = 4096
"""The kernel's smallest pipe."""


class WritingEnd(int):
    """The file descriptor for a program's output.

    Attributes:
        reading: The other end.
    """

    reading: int


@contextmanager
def full_pipe() -> Iterator[WritingEnd]:
    """A pipe into which not a byte more goes until zeros are read."""
    reading, writing = os.pipe()
    try:
        fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, LEAST_BYTES)
        os.write(writing, bytes(LEAST_BYTES))
        end = WritingEnd(writing)
        end.reading = reading
        yield end
    finally:
        os.close(reading)
        os.close(writing)


def bytes_in(reading: int) -> int:
    """How much can be read from a pipe now."""
    (count,) = struct.unpack("i", fcntl.ioctl(reading, termios.FIONREAD, bytes(4)))
    return int(count)
