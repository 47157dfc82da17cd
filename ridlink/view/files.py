"""The files of the page, read once: requests are looked up in a table, never on a disk."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.resources import files
from importlib.resources.abc import Traversable

TYPES = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
    "png": "image/png",
    "txt": "text/plain; charset=utf-8",
    "json": "application/json",
}
"""Content types by suffix; of other files only licences are served."""


@dataclass(frozen=True, slots=True)
class PageFile:
    """A file of the page.

    Attributes:
        kind: Its content type.
        content: Its bytes.
        gzipped: The same, compressed.
    """

    kind: str
    content: bytes
    gzipped: bytes = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "gzipped", gzip.compress(self.content, compresslevel=6, mtime=0))


def page_files() -> dict[str, PageFile]:
    """Every file of the page, by its path: ``/`` and ``/static/...``."""
    static = files("ridlink.view") / "static"
    table = {f"/static/{path}": PageFile(_type_of(path), file.read_bytes()) for path, file in _walk(static, "")}
    table["/"] = table["/static/index.html"]
    return table


def _walk(folder: Traversable, prefix: str) -> Iterator[tuple[str, Traversable]]:
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _walk(entry, f"{prefix}{entry.name}/")
        elif entry.name.rpartition(".")[2] in TYPES or "LICENSE" in entry.name:
            yield prefix + entry.name, entry


def _type_of(path: str) -> str:
    return TYPES.get(path.rpartition(".")[2], TYPES["txt"])
