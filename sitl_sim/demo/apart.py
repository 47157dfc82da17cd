"""Makes child processes end with the demonstration that started them."""

from __future__ import annotations

import ctypes
import signal

PR_SET_PDEATHSIG = 1
"""Source: Linux, ``prctl(2)``."""

_libc = ctypes.CDLL(None)


def end_with_parent() -> None:
    """Call it in a child before exec: the child gets SIGTERM when its parent ends in any way.

    A process that is killed or runs out of memory cannot stop its daemons. They would stay, on ports that the next
    flight needs.
    """
    _libc.prctl(PR_SET_PDEATHSIG, int(signal.SIGTERM))
