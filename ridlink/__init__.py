"""ridlink: Remote ID that keeps drones apart.

``ridlink.decode(path)`` gives a capture as columns: one structured array for each message.
"""

from __future__ import annotations

import importlib

TYPE_CHECKING = False  # `typing` would take half of the time that importing the package does
if TYPE_CHECKING:
    from typing import Any

    from ridlink.captures.columns import decode

__all__ = ["decode"]


def __dir__() -> list[str]:
    return [*globals(), *__all__]


def __getattr__(name: str) -> Any:
    """``decode`` when it is asked for: importing the package stays instant."""
    if name == "decode":
        return importlib.import_module("ridlink.captures.columns").decode
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
