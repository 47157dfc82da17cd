"""Lines of commands that fly or transmit: whoever stops reading them stops nothing else."""

from __future__ import annotations

import contextlib
import os
import queue
import sys
import threading

QUEUED_LINES = 1000


class Printer:
    """Prints from a thread of its own. What a reader is too slow for is left out; when it has gone, all is."""

    def __init__(self) -> None:
        self._queue: queue.Queue[tuple[str, bool] | None] = queue.Queue(QUEUED_LINES)
        self._thread = threading.Thread(target=self._run, name="printer", daemon=True)
        self._thread.start()

    def put(self, text: str, *, error: bool = False) -> None:
        """Print a text, its line end included, on standard output or standard error."""
        with contextlib.suppress(queue.Full):
            self._queue.put_nowait((text, error))

    def _run(self) -> None:
        while (item := self._queue.get()) is not None:
            text, error = item
            stream = sys.stderr if error else sys.stdout
            if stream is None:  # closed by whoever started us
                continue
            try:
                stream.write(text)
                stream.flush()
            except OSError:  # the reader has gone; the flight goes on
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())

    def close(self) -> None:
        """Print what is queued, for a second at most."""
        try:
            self._queue.put(None, timeout=0.5)
        except queue.Full:
            return
        self._thread.join(1.0)
