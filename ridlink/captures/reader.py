"""Opens a capture by path: detects its format, and iterates over its records.

The content decides the format; the suffix counts only if the content is not clear. A pcap file has a magic number, and
lines of hexadecimal are text. A tlog has eight bytes between two frames, a raw stream has none.
"""

from __future__ import annotations

import itertools
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path, PurePath
from typing import BinaryIO, Self, TypeVar

from ridlink.captures.hexlines import looks_like_hex, read_hex
from ridlink.captures.packets import MAGICS, read_pcap
from ridlink.captures.raw import read_raw
from ridlink.captures.records import Record, Rejects
from ridlink.captures.tlog import TIME_LENGTH, read_tlog
from ridlink.errors import CaptureError
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.text import display_name
from ridlink.words import Named

CHUNK_LENGTH = 256 * 1024
HEAD_LENGTH = 64 * 1024
SHORT_HEAD_LENGTH = 1024
ENOUGH_FRAMES = 16

STDIN = "-"

LARGE_BYTES = 2_000_000
"""From this size on, compiled loops save more time than it takes to load them."""

_FOREIGN = {
    b"ULog": "a PX4 ULog",
    b"\xa3\x95\x80\x80": "an ArduPilot dataflash log",
    b"\x1f\x8b": "a gzip file: unpack it first",
    b"\x28\xb5\x2f\xfd": "a zstd file: unpack it first",
    b"BZh": "a bzip2 file: unpack it first",
    b"\xfd7zXZ\x00": "an xz file: unpack it first",
    b"PK\x03\x04": "a zip file: unpack it first",
}


class CaptureKind(Named):
    """Supported formats."""

    TLOG = "tlog"
    MAVLINK = "mavlink"
    PCAP = "pcap"
    HEX = "hex"


_Item = TypeVar("_Item")
_Reader = Callable[[Iterable[bytes], Rejects], Iterator[Record]]
_READERS: dict[CaptureKind, _Reader] = {
    CaptureKind.TLOG: read_tlog,
    CaptureKind.MAVLINK: read_raw,
    CaptureKind.PCAP: read_pcap,
    CaptureKind.HEX: read_hex,
}
_SUFFIXES = {
    ".tlog": CaptureKind.TLOG,
    ".mavlink": CaptureKind.MAVLINK,
    ".raw": CaptureKind.MAVLINK,
    ".pcap": CaptureKind.PCAP,
    ".pcapng": CaptureKind.PCAP,
    ".hex": CaptureKind.HEX,
}


class Capture:
    """An open capture: iterate once over its records, then look at ``rejects``.

    Attributes:
        name: The path, or ``standard input``.
        kind: Its format.
        rejects: Damage found so far.
        size: Length of the file in bytes, ``None`` if unknown.
        position: Bytes read so far.
    """

    def __init__(
        self,
        name: str,
        stream: BinaryIO,
        kind: CaptureKind | None,
        *,
        size: int | None = None,
        before_read: Callable[[], None] | None = None,
    ) -> None:
        self.name = name
        self.rejects = Rejects()
        self.size = size
        self.position = 0
        self._stream = stream
        self._before_read = before_read
        self._head: list[bytes] = []
        if kind is None:
            head = self._read_head()
            kind = detect_kind(head, name)
            self._head = [head]
        self.kind = kind

    def __iter__(self) -> Iterator[Record]:
        """Records in the order of the file.

        Raises:
            CaptureError: At the end, if there was no record, or none of a supported kind.
            OSError: If the file cannot be read any further.
        """
        return self.read_with(_READERS[self.kind])

    def read_with(self, reader: Callable[[Iterable[bytes], Rejects], Iterator[_Item]]) -> Iterator[_Item]:
        """The items of another reader of this format; raises the same errors as iteration."""
        is_empty = True
        try:
            for item in reader(itertools.chain(self._head, self._chunks()), self.rejects):
                is_empty = False
                yield item
        except CaptureError as error:
            raise CaptureError(f"{self.name}: {error}") from error
        if is_empty:
            what = "is empty" if self.position == 0 else self._nothing()
            raise CaptureError(f"{self.name} {what}")

    def _nothing(self) -> str:
        if self.kind in (CaptureKind.TLOG, CaptureKind.MAVLINK):
            return f"has no MAVLink frame ({self.kind})"
        damage = f"; refused: {self.rejects}" if self.rejects else ""
        where = " in UDP or TCP" if self.kind is CaptureKind.PCAP else ""
        return f"has no MAVLink frame{where} and no Remote ID broadcast ({self.kind}){damage}"

    def close(self) -> None:
        """Close the file; standard input stays open."""
        if self._stream is not sys.stdin.buffer:
            self._stream.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _read(self) -> bytes:
        """Available bytes, at most one chunk, without waiting for more of a pipe than some; ``b""`` at the end."""
        if self._before_read is not None:
            self._before_read()
        try:
            chunk: bytes = self._stream.read1(CHUNK_LENGTH)  # type: ignore[attr-defined]
        except OSError as error:
            error.filename = error.filename or self.name
            raise
        self.position += len(chunk)
        return chunk

    def _chunks(self) -> Iterator[bytes]:
        while chunk := self._read():
            yield chunk

    def _read_head(self) -> bytes:
        """Enough of the beginning to detect the format; no more than that from a live pipe."""
        head = b""
        judged = 0
        while len(head) < HEAD_LENGTH and (chunk := self._read()):
            head += chunk
            if len(head) > SHORT_HEAD_LENGTH and len(head) - judged < judged // 16:
                continue  # detection does not run again for every single byte
            judged = len(head)
            if head.startswith(MAGICS) or looks_like_hex(head) or len(_checked_frames(head)) >= ENOUGH_FRAMES:
                break
        return head


def is_large(path: str) -> bool:
    """Whether a path is a file so large that compiled loops are faster than reading record by record."""
    return path != STDIN and Path(path).is_file() and Path(path).stat().st_size >= LARGE_BYTES


def open_capture(
    path: str | os.PathLike[str], kind: str = "auto", *, before_read: Callable[[], None] | None = None
) -> Capture:
    """Open a capture.

    Args:
        path: File, or ``-`` for standard input.
        kind: ``tlog``, ``mavlink``, ``pcap``, ``hex``, or ``auto`` to detect it by content and suffix.
        before_read: Called before each read of the file, which may block on a pipe.

    Raises:
        CaptureError: If it is empty or not a supported capture.
        OSError: If it cannot be read.
        ValueError: If the kind is unknown.
    """
    wanted = None if kind == "auto" else CaptureKind(kind)
    if os.fspath(path) == STDIN:
        return Capture("standard input", sys.stdin.buffer, wanted, before_read=before_read)
    stream = open(path, "rb")  # noqa: SIM115 - the capture closes it
    try:
        size = os.fstat(stream.fileno()).st_size or None
        return Capture(display_name(os.fspath(path)), stream, wanted, size=size, before_read=before_read)
    except BaseException:
        stream.close()
        raise


def detect_kind(head: bytes, name: str) -> CaptureKind:
    """Format of a capture that begins with these bytes.

    Args:
        head: The beginning of the file, some 64 KiB if it is that long.
        name: Path. Its suffix decides if the bytes do not; the error names it.

    Raises:
        CaptureError: If the format is not supported.
    """
    if not head:
        raise CaptureError(f"{name} is empty")
    for magic, what in _FOREIGN.items():
        if head.startswith(magic):
            raise CaptureError(f"{name} is {what}; tlog, raw MAVLink, pcap and lines of hex are read")
    if head.startswith(MAGICS):
        return CaptureKind.PCAP
    if looks_like_hex(head):
        return CaptureKind.HEX
    by_suffix = _SUFFIXES.get(PurePath(name).suffix.lower())
    frames = _checked_frames(head)
    gaps = [second.offset - first.offset - len(first.raw) for first, second in itertools.pairwise(frames)]
    timed, bare = gaps.count(TIME_LENGTH), gaps.count(0)
    if timed != bare:
        return CaptureKind.TLOG if timed > bare else CaptureKind.MAVLINK
    if by_suffix is not None:
        return by_suffix
    if not frames:
        raise CaptureError(f"{name} is no capture that ridlink reads: no MAVLink frame near its beginning")
    return CaptureKind.TLOG if frames[0].offset == TIME_LENGTH else CaptureKind.MAVLINK


def _checked_frames(head: bytes) -> list[Frame]:
    found = parse_datagram(head[:HEAD_LENGTH], CRC_EXTRAS, limit=ENOUGH_FRAMES)
    return [item for item in found if isinstance(item, Frame) and item.checked]
