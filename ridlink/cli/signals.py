"""Effects of signals on commands: they end what runs, and leave no unfinished files."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import asyncio


@contextmanager
def removed_by_signals(remove: Callable[[], None]) -> Iterator[None]:
    """A signal that ends the command first removes unfinished output, then ends the process with 128 + n.

    This is no exception: raised at any time, it could be lost in a callback of the compiler or of an import.

    Args:
        remove: Removes the unfinished output.
    """

    def end(number: int, _: object) -> None:
        with suppress(OSError):  # a terminal that has gone is told nothing
            remove()
        os._exit(128 + number)

    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    for number, action in before.items():
        if action is not signal.SIG_IGN:  # as under nohup
            signal.signal(number, end)
    try:
        yield
    finally:
        for number, action in before.items():
            signal.signal(number, action)


def ending_signals() -> list[signal.Signals]:
    """Signals that end a command: SIGINT, SIGTERM, and SIGHUP of a terminal that closes, unless that is ignored."""
    hangup = [] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [signal.SIGHUP]  # as under nohup
    return [signal.SIGINT, signal.SIGTERM, *hangup]


def end_by_interrupts() -> None:
    """Until a loop handles it, Ctrl-C ends the process silently, as SIGTERM does.

    A KeyboardInterrupt could come while the loop is being made, and would be shown with a traceback.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not where a shell had it ignored
        signal.signal(signal.SIGINT, signal.SIG_DFL)


SAME_S = 0.02
"""A repeated signal within this time is the same request: `timeout` sends it to the process, and then to its group."""


def ended_by_signals(loop: asyncio.AbstractEventLoop, end: Callable[[], None]) -> None:
    """The first SIGINT, SIGTERM or SIGHUP begins a clean end; a second SIGINT or SIGTERM ends at once, with 128 + n.

    A second SIGHUP is ignored: the shell of the terminal repeats the one that the kernel has sent. The same signal
    within SAME_S is ignored as well.

    Args:
        loop: The loop that gets the handlers.
        end: Called once, in the loop.
    """
    first: int | None = None

    def on_signal(number: int) -> None:
        nonlocal first
        if first is None:
            first = number
            if number != signal.SIGHUP:  # by a timer, so a repeat in time is ignored even if seen late
                loop.call_later(SAME_S, loop.add_signal_handler, number, os._exit, 128 + number)
            end()
        elif number not in (first, signal.SIGHUP):
            os._exit(128 + number)

    for number in ending_signals():
        loop.add_signal_handler(number, on_signal, number)


def stopped_by_signals(loop: asyncio.AbstractEventLoop) -> asyncio.Event:
    """An event that SIGINT, SIGTERM or SIGHUP sets; a second SIGINT or SIGTERM finds the default action.

    A second SIGHUP does nothing, nor does the same signal within SAME_S, see `ended_by_signals`.
    """
    import asyncio

    stop = asyncio.Event()

    def stop_once(first: int) -> None:
        if stop.is_set():
            return
        stop.set()
        for number in (signal.SIGINT, signal.SIGTERM):
            if number == first:
                loop.call_later(SAME_S, loop.remove_signal_handler, number)
            else:
                loop.remove_signal_handler(number)

    for number in ending_signals():
        loop.add_signal_handler(number, stop_once, number)
    return stop
