"""Where commands write: standard output, or a file that appears when everything is in it."""

from __future__ import annotations

import os
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from ridlink.cli.signals import removed_by_signals


@contextmanager
def whole_output(path: str | None) -> Iterator[BinaryIO]:
    """Standard output, or a file that appears when everything is in it."""
    if path is None or path == "-":
        yield sys.stdout.buffer
        sys.stdout.buffer.flush()
        return
    target = Path(path)
    if target.exists() and not target.is_file():  # a device or pipe cannot be replaced
        with open(target, "wb") as stream:
            yield stream
        return
    unfinished = target.with_name(f".{target.name}.{secrets.token_hex(4)}")
    with removed_by_signals(lambda: unfinished.unlink(missing_ok=True)):
        try:
            with _new(unfinished, path) as stream:
                yield stream
            os.replace(unfinished, target)
        except BaseException:
            unfinished.unlink(missing_ok=True)
            raise


def _new(unfinished: Path, path: str) -> BinaryIO:
    """A new file; why there can be none is said of the path that was asked for."""
    try:
        return open(unfinished, "xb")
    except OSError as error:
        error.filename = path
        raise
