"""What signals do to commands: they end what runs, and nothing half done stays behind."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import asyncio


@contextmanager
def signals_raise() -> Iterator[None]:
    """SIGTERM and SIGHUP end the command like an error, so that it takes away what it has half written.

    Raises:
        SystemExit: With 128 + n, where signal n came. A second signal finds the action that was there before.
    """

    def end(number: int, _: object) -> None:
        restore()
        sys.exit(128 + number)

    def restore() -> None:
        for number, action in before.items():
            signal.signal(number, action)

    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    for number, action in before.items():
        if action is not signal.SIG_IGN:  # as under nohup
            signal.signal(number, end)
    try:
        yield
    finally:
        restore()


def stopped_by_signals(loop: asyncio.AbstractEventLoop) -> asyncio.Event:
    """An event that SIGINT or SIGTERM sets; a second signal finds the default action."""
    import asyncio

    stop = asyncio.Event()

    def stop_once() -> None:
        stop.set()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop_once)
    return stop
