"""Lines that contain the bytes of their frame, from which `ridlink encode` restores the same file."""

from __future__ import annotations

from ridlink.captures.messages import MessageRecord


def framed_line(line: bytes, record: MessageRecord) -> bytes:
    """A JSON line with the bytes of its frame, in hexadecimal, as ``frame``.

    A message of 25 bytes has them in ``hex`` already, and a member of a message pack came in the frame of the pack.
    """
    if record.is_broadcast or record.is_member:
        return line
    return b'%b,"frame":"%b"}\n' % (line.removesuffix(b"}\n"), record.frame.raw.hex().encode())
