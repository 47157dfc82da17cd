"""ridlink: Remote ID that keeps drones apart.

``ridlink.decode(path)`` gives a capture as columns: one structured array for each message. Everything else is imported
from its room, and the rooms are one line:

    bytes                     ridlink.links, ridlink.captures
    -> frames -> messages     ridlink.mavlink
    -> reports                ridlink.remote_id
    -> tracks                 ridlink.traffic, ridlink.own_ship
    -> separation discs       ridlink.separation
    -> admissible velocity    ridlink.avoidance
    -> setpoint -> bytes      ridlink.setpoint; ridlink.engine walks the whole line
"""

from __future__ import annotations

import importlib

TYPE_CHECKING = False  # `typing` would take half of the time that importing the package does
if TYPE_CHECKING:
    from typing import Any

    from ridlink.captures.columns import decode

    __version__: str

__all__ = ["decode"]


def __dir__() -> list[str]:
    return [*globals(), *__all__]


def __getattr__(name: str) -> Any:
    """``decode`` and ``__version__`` when they are asked for: importing the package stays instant."""
    if name == "decode":
        return importlib.import_module("ridlink.captures.columns").decode
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("ridlink")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
