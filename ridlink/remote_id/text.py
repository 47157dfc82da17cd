"""Bytes that strangers chose, made fit for a terminal, a log or a page."""

from __future__ import annotations

_ESCAPED = {code: f"\\x{code:02x}" for code in range(256) if not 0x20 <= code <= 0x7E}


def display_text(raw: bytes) -> str:
    """Printable ASCII as it is, every other byte as ``\\xNN``; the zeros that fill a fixed length up are left out."""
    return raw.rstrip(b"\x00").decode("latin-1").translate(_ESCAPED)


def display_name(name: str) -> str:
    """A file name or other text of the user's own alphabet, with what a terminal would act on as ``\\xNN``.

    So are bytes of a name that are no text, which Python keeps as lone surrogates.
    """
    return "".join(character if character.isprintable() else _escaped(ord(character)) for character in name)


def _escaped(code: int) -> str:
    return f"\\x{code - 0xDC00 if 0xDC80 <= code <= 0xDCFF else code:02x}"
