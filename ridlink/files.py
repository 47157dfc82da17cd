"""Files that appear when everything is in them or are opened without a wait, and names that any text has a part in."""

from __future__ import annotations

import errno
import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

UNFINISHED = ".unfinished"
"""Suffix of what is half written."""

LONGEST_PART = 120
"""Characters of a text in a file name, which has 255 bytes in all."""

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What writing fails with, and reading does not."""


def unfinished(path: Path) -> Path:
    """Where a file of this process is until it is whole: two that write the same are not in each other's way."""
    return path.with_name(f"{path.name}.{os.getpid()}{UNFINISHED}")


def file_part(text: str) -> str:
    """A text as part of the name of a file: no folders, and no longer than a name may be; another text has another."""
    quoted = quote(text, safe="", errors="surrogatepass")
    if len(quoted) <= LONGEST_PART:
        return quoted
    digest = hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:16]
    return f"{quoted[: LONGEST_PART - 1 - len(digest)]}+{digest}"


def open_at_once(path: str | os.PathLike[str], mode: str, buffering: int = -1) -> BinaryIO:
    """A file to write to; a pipe that nobody reads is an error, not a wait that no signal ends.

    Args:
        path: The file.
        mode: ``wb``, or ``xb`` where it must not exist.
        buffering: As of `open`.

    Raises:
        OSError: If it cannot be opened.
    """

    def opened(name: str, flags: int) -> int:
        descriptor = os.open(name, flags | os.O_NONBLOCK, 0o666)
        os.set_blocking(descriptor, True)
        return descriptor

    return open(path, mode, buffering, opener=opened)  # type: ignore[return-value]


def write_whole(path: Path, data: bytes) -> None:
    """Write a file under another name, force it onto the disk, and give it its name; one that has it is replaced.

    Raises:
        OSError: If that fails, of this path; nothing is left of it.
    """
    working = unfinished(path)
    try:
        with open(working, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(working, path)
    except BaseException as error:
        with suppress(OSError):  # as where nothing can be written
            working.unlink(missing_ok=True)
        if isinstance(error, OSError):
            error.filename, error.filename2 = str(path), None
        raise
    listing = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(listing)
    finally:
        os.close(listing)


@contextmanager
def full_disk_named(path: str) -> Iterator[None]:
    """A full disk is said of the file or folder that is written meanwhile; the kernel says it of none.

    Args:
        path: As it was asked for.
    """
    try:
        yield
    except OSError as error:
        if error.errno in NO_ROOM and error.filename is None:
            error.filename = path
        raise
