"""Writes files as a whole, opens files without waiting, and makes file names from any text."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

UNFINISHED = ".unfinished"
"""Suffix of a file that is not complete yet."""

LONGEST_PART = 120
"""Most characters of a text in a file name, which may have 255 bytes in all."""

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Error numbers of a full disk: only writing fails with them."""


def unfinished(path: Path) -> Path:
    """Temporary path of a file until it is complete; two processes that write the same file use different ones."""
    return path.with_name(f"{path.name}.{os.getpid()}{UNFINISHED}")


def file_part(text: str) -> str:
    """A text as part of a file name, without folders and not too long; different texts give different parts."""
    quoted = quote(text, safe="", errors="surrogatepass")
    if len(quoted) <= LONGEST_PART:
        return quoted
    digest = hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:16]
    return f"{quoted[: LONGEST_PART - 1 - len(digest)]}+{digest}"


def open_at_once(path: str | os.PathLike[str], mode: str, buffering: int = -1) -> BinaryIO:
    """Open a file for writing, for this process alone.

    A pipe without a reader is an error; otherwise the open would wait, deaf to signals.

    Args:
        path: The file.
        mode: ``wb``, or ``xb`` if the file must not exist.
        buffering: As of `open`.

    Raises:
        OSError: If it cannot be opened, or another process has opened it so; what is in it stays then.
    """

    def opened(name: str, flags: int) -> int:
        descriptor = os.open(name, flags & ~os.O_TRUNC | os.O_NONBLOCK, 0o666)
        try:
            os.set_blocking(descriptor, True)
            if stat.S_ISREG(os.fstat(descriptor).st_mode):
                _keep_others_out(descriptor, name)
                os.ftruncate(descriptor, 0)
        except OSError:
            os.close(descriptor)
            raise
        return descriptor

    return open(path, mode, buffering, opener=opened)  # type: ignore[return-value]


def _keep_others_out(descriptor: int, name: str) -> None:
    """Lock a file until this process closes it or ends, whatever processes it has started."""
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EAGAIN):  # anything else: this file system has no locks
            raise OSError(errno.EBUSY, "another program is writing it", name) from error


def write_whole(path: Path, data: bytes) -> None:
    """Write a file under a temporary name, force it to disk, and rename it; an existing file is replaced.

    Raises:
        OSError: If that fails; it names this path, and no temporary file remains.
    """
    working = unfinished(path)
    try:
        with open(working, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(working, path)
    except BaseException as error:
        with suppress(OSError):  # for example where nothing can be written
            working.unlink(missing_ok=True)
        if isinstance(error, OSError):
            error.filename, error.filename2 = str(path), None
        raise
    listing = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(listing)
    finally:
        os.close(listing)


def write_together(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder, all or none; existing ones are replaced.

    Args:
        folder: Folder, which is made if it does not exist.
        files: Contents by path relative to it.

    Raises:
        OSError: If one of them cannot be written; it names that one, and neither files nor new folders remain.
    """
    if folder.exists() and not folder.is_dir():  # `mkdir` would report that it exists
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))
    made: list[Path] = []
    targets = [folder / name for name in files]
    try:
        for target, content in zip(targets, files.values(), strict=True):
            made += reversed([each for each in (target.parent, *target.parent.parents) if not each.exists()])
            target.parent.mkdir(parents=True, exist_ok=True)
            if target.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(target))
            try:
                unfinished(target).write_bytes(content)
            except OSError as error:
                error.filename = str(target)
                raise
        for target in targets:
            os.replace(unfinished(target), target)
    except BaseException:
        for remove in (*(unfinished(target).unlink for target in targets), *(each.rmdir for each in reversed(made))):
            with suppress(OSError):  # for example what was not made yet
                remove()
        raise


@contextmanager
def full_disk_named(path: str) -> Iterator[None]:
    """Name the file or folder being written in errors about a full disk; the kernel names none.

    Args:
        path: The path as the user gave it.
    """
    try:
        yield
    except OSError as error:
        if error.errno in NO_ROOM and error.filename is None:
            error.filename = path
        raise
