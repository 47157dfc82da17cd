"""A watchdog: a thread that notices when the loop stands still, which a task of that loop could not.

After `STALLED_S` without a sign of life it reports the stack of the loop and requests a hold. After `DEAD_S` it ends
the process, since a restart by a supervisor is faster than waiting. Only time in which the watchdog itself ran counts:
after a process was stopped as a whole, or a machine slept, the daemon holds and does not end.
"""

from __future__ import annotations

import os
import sys
import threading
import time
import traceback
from collections.abc import Callable

STALLED_S = 0.3
DEAD_S = 2.0
LOOK_S = 0.05


def _end(report: str) -> None:
    sys.stderr.write(f"ridlink: the loop stands still for {DEAD_S:g} s, ending\n{report}")
    sys.stderr.flush()
    os._exit(os.EX_SOFTWARE)


class Watchdog:
    """Watches the thread that creates it.

    Args:
        on_stall: Called from the watchdog's thread, once per stall, with the stack of the watched thread.
        on_death: Called with the stack when the stall lasts; by default it ends the process.
    """

    def __init__(self, on_stall: Callable[[str], None], on_death: Callable[[str], None] = _end) -> None:
        self._on_stall, self._on_death = on_stall, on_death
        self._watched = threading.get_ident()
        self._beats = 0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="watchdog", daemon=True)

    def start(self) -> None:
        """Start the watchdog; it expects beats from now on."""
        self._thread.start()

    def beat(self) -> None:
        """Report that the loop runs."""
        self._beats += 1

    def stop(self) -> None:
        """Stop the watchdog; it expects no beats any more."""
        self._over.set()

    def _run(self) -> None:
        seen, still_s, looked_s = self._beats, 0.0, time.monotonic()
        said = False
        while not self._over.wait(LOOK_S):
            now_s = time.monotonic()
            awake_s, looked_s = min(now_s - looked_s, 2.0 * LOOK_S), now_s
            if self._beats != seen:
                seen, still_s, said = self._beats, 0.0, False
                continue
            still_s += awake_s
            if still_s > STALLED_S and not said:
                said = True
                self._on_stall(self._stack())
            if still_s > DEAD_S:
                self._on_death(self._stack())
                return

    def _stack(self) -> str:
        frame = sys._current_frames().get(self._watched)
        return "".join(traceback.format_stack(frame)) if frame is not None else ""
