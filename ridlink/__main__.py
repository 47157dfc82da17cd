"""``ridlink`` and ``python -m ridlink``.

While modules are loaded, Ctrl-C ends the program at once and silently. A KeyboardInterrupt would be shown with a
traceback, or lost in a callback of an import.
"""

from __future__ import annotations

import os

try:
    import signal
    from types import FrameType
except KeyboardInterrupt:
    os._exit(130)


def main() -> None:
    """Entry point: load the command line and run it."""
    interruptible = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # or a shell ignores it
    if interruptible:
        signal.signal(signal.SIGINT, _end)
    from ridlink import cli

    cli.main(_raise_on_interrupt if interruptible else None)


def _end(number: int, _: FrameType | None) -> None:
    os._exit(128 + number)


def _raise_on_interrupt() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)


if __name__ == "__main__":
    main()
