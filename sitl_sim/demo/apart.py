"""Processes that do not outlive the demonstration that started them."""

from __future__ import annotations

import ctypes
import signal

PR_SET_PDEATHSIG = 1
"""Source: Linux, ``prctl(2)``."""

_libc = ctypes.CDLL(None)


def end_with_parent() -> None:
    """In a child, before it becomes another program: SIGTERM when its parent is gone, however that came about.

    Who is killed, or runs out of memory, stops nobody. Its daemons would stay, on ports that the next flight wants.
    """
    _libc.prctl(PR_SET_PDEATHSIG, int(signal.SIGTERM))
