"""Makes untrusted bytes and names safe for a terminal, a log or a page."""

from __future__ import annotations

_ESCAPED = {code: f"\\x{code:02x}" for code in range(256) if not 0x20 <= code <= 0x7E}


def display_text(raw: bytes) -> str:
    """Printable ASCII unchanged, every other byte as ``\\xNN``; the zeros that pad a fixed length are left out."""
    return raw.rstrip(b"\x00").decode("latin-1").translate(_ESCAPED)


def display_name(name: str) -> str:
    """A file name or other text of the user's own alphabet, with control characters as ``\\xNN``.

    Bytes of a name that are no text, which Python keeps as lone surrogates, are also written as ``\\xNN``.
    """
    return "".join(character if character.isprintable() else _escaped(ord(character)) for character in name)


def _escaped(code: int) -> str:
    return f"\\x{code - 0xDC00 if 0xDC80 <= code <= 0xDCFF else code:02x}"
